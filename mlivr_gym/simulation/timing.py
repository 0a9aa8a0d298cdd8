"""How fast the steps of a plan are carried out.

By default as fast as `Limits` allow; with `Durations` each part takes the time that is given, and
one that breaks a limit is refused.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import PPoly

from mlivr_gym.arguments import Of, checked
from mlivr_gym.errors import PlanError, TimingError
from mlivr_gym.motion.arguments import WALK
from mlivr_gym.motion.clocks import Durations, duration_of, quintic, stretched
from mlivr_gym.motion.path_segments import path_segments
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.regrasp import RegraspPath, planned_regrasp
from mlivr_gym.motion.trajectory import TimedPath, Trajectory, trajectory
from mlivr_gym.schema import Maybe
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.simulation.path_dynamics import SegmentDynamics, segment_dynamics
from mlivr_gym.simulation.time_optimal import time_optimal_clock
from mlivr_gym.stances.stance_graph import StanceGraph

TIMING = Maybe(Of(Limits, Durations))
"""How fast steps are carried out."""

ROUNDING = 1e-6
"""A duration that falls short of the shortest by a smaller share is not refused."""


def timed_path(path: RegraspPath, timing: Limits | Durations | None = None) -> TimedPath:
    """A step with clocks for its segments.

    Parameters
    ----------
    path
        The step.
    timing
        `Limits`, by default the default ones, or `Durations`.

    Raises
    ------
    TimingError
        If durations break the default limits, or the limits' own step duration is
        shorter than they allow.
    PlanError
        If a limb that holds cannot follow the base.
    """
    limits = timing if isinstance(timing, Limits) else Limits()
    segments = path_segments(path)
    dynamics = [
        segment_dynamics(path.graph.robot, path.regrasp, segment, limits) for segment in segments
    ]
    if isinstance(timing, Durations):
        clocks = timing.clocks(segments)
        _check(dynamics, clocks, timing)
        return TimedPath(path, segments, clocks)
    clocks = tuple(shortest_clock(one, limits) for one in dynamics)
    shortest = sum(map(duration_of, clocks))
    if limits.step_duration is not None:
        if limits.step_duration < shortest * (1.0 - ROUNDING):
            slowest = max(dynamics, key=lambda one: one.binding(quintic(1.0)).duration)
            raise TimingError(
                limits.step_duration, slowest.binding(quintic(1.0)).description, shortest
            )
        factor = limits.step_duration / shortest
        clocks = tuple(stretched(clock, factor) for clock in clocks)
    return TimedPath(path, segments, clocks)


def shortest_clock(dynamics: SegmentDynamics, limits: Limits) -> PPoly:
    """The shortest clock of a segment within limits, of the limits' profile.

    The fastest of its kind may be longer than the shortest quintic where the rise time binds.
    """
    plain = quintic(dynamics.binding(quintic(1.0)).duration)
    if limits.profile == "quintic":
        return plain
    fast = time_optimal_clock(dynamics, limits.rise_time)
    return min(fast, plain, key=duration_of)


def _check(
    dynamics: Sequence[SegmentDynamics], clocks: Sequence[PPoly], durations: Durations
) -> None:
    """Refuse durations that break a limit, with those that would do."""
    found = [one.binding(clock) for one, clock in zip(dynamics, clocks, strict=True)]
    factors = [one.duration / duration_of(clock) for one, clock in zip(found, clocks, strict=True)]
    worst = int(np.argmax(factors))
    if factors[worst] > 1.0 + ROUNDING:
        raise TimingError(
            durations.total, found[worst].description, durations.total * factors[worst]
        )


@checked({**WALK, "timing": TIMING})
def step_trajectory(
    graph: StanceGraph,
    plan: Plan,
    index: int,
    timing: Limits | Durations | None = None,
    period: float = 0.002,
) -> Trajectory:
    """The trajectory of one step of a plan; see `timed_path` and `trajectory.trajectory`."""
    path = RegraspPath(graph, planned_regrasp(graph, plan, index))
    return trajectory(timed_path(path, timing), period)


@checked({**WALK, "timing": TIMING})
def plan_trajectory(
    graph: StanceGraph,
    plan: Plan,
    timing: Limits | Durations | None = None,
    period: float = 0.01,
) -> Trajectory:
    """The trajectory of a whole plan.

    Parameters
    ----------
    graph
        The stance graph of the plan's robot and map.
    plan
        The plan, with at least one step.
    timing
        `Limits`, by default the default ones, or `Durations`.
    period
        Spacing of the time grid [s].

    Raises
    ------
    PlanError
        If the plan has no step, or a step cannot be followed inside the joint limits.
    TimingError
        If durations break a limit.

    Example:
        >>> save_csv(plan_trajectory(graph, plan, period=0.1), "walk.csv")
    """
    if not plan.steps:
        raise PlanError("the plan has no step: it starts at its goal")
    whole = step_trajectory(graph, plan, 0, timing, period)
    for index in range(1, len(plan.steps)):
        whole = step_trajectory(graph, plan, index, timing, period).after(whole)
    return whole
