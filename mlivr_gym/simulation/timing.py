"""Time scaling of the steps of a plan.

With `Limits` each path segment is as fast as the limits allow. With `Durations` each phase has a
given duration, and one that violates a limit is refused.
"""

from __future__ import annotations

from functools import reduce

import numpy as np
from scipy.interpolate import PPoly

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.errors import PlanError, TimingError
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.time_scaling import Durations, duration_of, quintic, stretch
from mlivr_gym.motion.trajectory import TimedPath, Trajectory, trajectory
from mlivr_gym.schema import OrNone
from mlivr_gym.simulation.parameters import Limits
from mlivr_gym.simulation.path_dynamics import SegmentDynamics, segment_dynamics
from mlivr_gym.simulation.time_optimal import time_optimal_scaling
from mlivr_gym.stances.stance_graph import StanceGraph

TIMING = OrNone(InstanceOf(Limits, Durations))
"""Validator of the argument that determines the time scaling."""

ROUNDING = 1e-6
"""Relative amount by which a given duration may fall short of the shortest one."""


def timed_path(path: JointPath, timing: Limits | Durations | None = None) -> TimedPath:
    """Return a step with a time scaling for each of its path segments.

    The timing is by default `Limits()`. Raises a `TimingError` if durations violate the default
    limits, or `Limits.step_duration` is shorter than the limits allow.
    """
    limits = timing if isinstance(timing, Limits) else Limits()
    dynamics = [segment_dynamics(path, segment, limits) for segment in path.segments]
    if isinstance(timing, Durations):
        # By their shortest durations, so that all segments are equally far from their limits.
        shares = [one.binding(quintic(1.0)).duration for one in dynamics[1:-1]]
        given = timing.time_scalings(np.array(shares))
        bindings = [one.binding(scaling) for one, scaling in zip(dynamics, given, strict=True)]
        pairs = zip(bindings, given, strict=True)
        factors = [one.duration / duration_of(scaling) for one, scaling in pairs]
        worst = int(np.argmax(factors))
        if factors[worst] > 1.0 + ROUNDING:
            shortest = timing.total * factors[worst]
            raise TimingError(timing.total, bindings[worst].description, shortest)
        return TimedPath(path, given)
    scalings = tuple(shortest_scaling(one, limits) for one in dynamics)
    shortest = sum(map(duration_of, scalings))
    if limits.step_duration is not None:
        if limits.step_duration < shortest * (1.0 - ROUNDING):
            bindings = [one.binding(quintic(1.0)) for one in dynamics]
            slowest = max(bindings, key=lambda binding: binding.duration)
            raise TimingError(limits.step_duration, slowest.description, shortest)
        factor = limits.step_duration / shortest
        scalings = tuple(stretch(scaling, factor) for scaling in scalings)
    return TimedPath(path, scalings)


def shortest_scaling(dynamics: SegmentDynamics, limits: Limits) -> PPoly:
    """Return the shortest time scaling of a segment within limits, for the profile of the limits.

    The quintic is also a candidate for the profile `"fastest"`: it can be shorter than the
    time-optimal time scaling with limited rise time.
    """
    plain = quintic(dynamics.binding(quintic(1.0)).duration)
    if limits.profile == "quintic":
        return plain
    fast = time_optimal_scaling(dynamics, limits.rise_time)
    return min(fast, plain, key=duration_of)


@checked({**ARGUMENTS, "timing": TIMING})
def step_trajectory(
    graph: StanceGraph,
    plan: Plan,
    index: int,
    timing: Limits | Durations | None = None,
    period: float = 0.002,
) -> Trajectory:
    """Compute the trajectory of one step of a plan.

    The timing is by default `Limits()`, `period` the spacing of the time grid [s], and steps count
    from 0. Raises a `PlanError` if the plan has no such step, or it cannot be followed inside the
    joint limits, and a `TimingError` if durations violate a limit.
    """
    timed = timed_path(plan.joint_path(index), timing)
    return trajectory(graph.grasp_map, plan.stances[index : index + 2], timed, period)


def step_trajectories(
    graph: StanceGraph, plan: Plan, timing: Limits | Durations | None, period: float
) -> tuple[Trajectory, ...]:
    """Compute the trajectory of each step of a plan; for arguments and errors see the others."""
    if not plan.steps:
        raise PlanError("the plan has no step: it starts at its goal")
    indices = range(len(plan.steps))
    return tuple(step_trajectory(graph, plan, index, timing, period) for index in indices)


@checked({**ARGUMENTS, "timing": TIMING})
def plan_trajectory(
    graph: StanceGraph,
    plan: Plan,
    timing: Limits | Durations | None = None,
    period: float = 0.01,
) -> Trajectory:
    """Compute the trajectory of a whole plan.

    The timing is by default `Limits()`, and `period` the spacing of the time grid [s]. Raises a
    `PlanError` if the plan has no step, or a step cannot be followed inside the joint limits, and a
    `TimingError` if durations violate a limit.
    """
    steps = step_trajectories(graph, plan, timing, period)
    return reduce(lambda whole, step: step.after(whole), steps)
