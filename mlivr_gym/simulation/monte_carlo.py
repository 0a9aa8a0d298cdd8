"""Monte Carlo simulation: plans are executed many times, each time with another disturbance."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

from scipy.stats import binomtest

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.engines import executor_of
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.plan import Plan
from mlivr_gym.schema import Integer, ListOf, OrNone
from mlivr_gym.simulation.execution import TimedPlan, execute_timed_plan, timed_plan
from mlivr_gym.simulation.recording import Peaks
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.grasp_map import GraspMap


class RunOutcome(NamedTuple):
    """The outcome of one simulated walk."""

    plan: int
    """Index of the plan."""
    seed: int
    """Seed of the disturbance."""
    failure: str | None
    """Kind of the failure, one of `recording.FAILURES`; None if the walk was executed to its
    end."""
    message: str | None
    """The failure in one sentence, or None."""
    steps: int
    """Number of steps of the plan."""
    done: int
    """Number of steps that ended with a grasp."""
    time: float
    """Time at the end of the simulation [s]."""
    capture_distance: float
    """Largest distance between a gripper and its point just before a capture [m]."""
    grasp_force: float
    """Largest force on a grasp [N]."""
    grasp_torque: float
    """Largest torque on a grasp [N m]."""
    joint_torque: float
    """Largest torque of a joint [N m]."""
    base_error: float
    """Largest distance between the base and its trajectory [m]."""


@checked(
    {
        **ARGUMENTS,
        "plans": ListOf(InstanceOf(Plan)),
        "setup": OrNone(InstanceOf(Setup)),
        "samples": Integer(1, 10**6),
        "seed": Integer(1, 2**62),
        "workers": OrNone(Integer(1, 4096)),
    }
)
def execute_many(
    graph: StanceGraph,
    plans: Sequence[Plan],
    setup: Setup | None = None,
    samples: int = 1,
    seed: int = 1,
    workers: int | None = None,
) -> Iterator[RunOutcome]:
    """Execute plans many times, each time with another disturbance.

    Sample k of plan p has the seed `seed + p * samples + k`; the same arguments give the same
    outcomes, whatever the number of processes. New processes are spawned: a script that uses more
    than one needs `if __name__ == "__main__":`.

    Parameters
    ----------
    graph
        The stance graph of the plans' robot and map.
    plans
        The plans.
    setup
        Limits, controller, physics and disturbances; by default `Setup()`.
    samples
        Number of executions of each plan.
    seed
        First seed, at least 1.
    workers
        Number of processes; by default one for each core.

    Yields
    ------
    RunOutcome
        The outcomes, ordered by plan and sample.

    Raises
    ------
    PlanError
        If a plan has no step, or cannot be followed.
    TimingError
        If durations violate a limit.
    SettingError
        If a number is out of range.

    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> from mlivr_gym.planners import Planner
    >>> graph = stance_graph()
    >>> plan = Planner(graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), cost="steps").unwrap()
    >>> setup = Setup.of("gentle", disturbances="all")
    >>> outcomes = list(execute_many(graph, [plan], setup, samples=2, workers=1))
    >>> success_rate(outcomes)["walks"]
    2
    """
    setup, count = setup or Setup(), workers or os.cpu_count() or 1
    run = partial(_outcomes, graph.grasp_map, setup, (seed, samples))
    period = setup.physics.timestep
    works = enumerate(timed_plan(graph, plan, setup.timing, period) for plan in plans)
    if count == 1:
        yield from chain.from_iterable(map(run, works))
        return
    with executor_of("local", count) as executor:
        yield from chain.from_iterable(executor.map(run, works))


def _outcomes(
    grasp_map: GraspMap, setup: Setup, seeds: tuple[int, int], work: tuple[int, TimedPlan]
) -> list[RunOutcome]:
    """Return the outcomes of one plan; `seeds` are the first of all, and the number for a plan."""
    (number, timed), (first, samples), world = work, seeds, work[1].plan.world
    outcomes = []
    for seed in range(first + number * samples, first + (number + 1) * samples):
        simulation = setup.simulation(grasp_map, world.robot, world.obstacles, seed)
        done = execute_timed_plan(simulation, timed)
        peaks, failure = Peaks.join([step.peaks for step in done]), done[-1].failure
        captures = [step.capture for step in done if step.capture is not None]
        outcomes.append(
            RunOutcome(
                plan=number,
                seed=seed,
                failure=None if failure is None else failure.kind,
                message=None if failure is None else failure.message,
                steps=len(timed.steps),
                done=len(captures),
                time=simulation.time,
                capture_distance=max((capture.distance for capture in captures), default=0.0),
                grasp_force=float(peaks.grasp_force.max()),
                grasp_torque=float(peaks.grasp_torque.max()),
                joint_torque=float(peaks.joint_torque.max()),
                base_error=peaks.base_error,
            )
        )
    return outcomes


@checked()
def success_rate(outcomes: Sequence[RunOutcome]) -> dict[str, Any]:
    """Return the share of walks executed to their end, its confidence interval, and the failures.

    The interval is Wilson's at 95 % (Journal of the American Statistical Association 22, 1927).
    Failures are counted by kind. Without outcomes the share is None.
    """
    count = len(outcomes)
    failures = Counter(outcome.failure for outcome in outcomes if outcome.failure is not None)
    done = count - sum(failures.values())
    low, high = 0.0, 1.0
    if count:
        low, high = map(float, binomtest(done, count).proportion_ci(method="wilson"))
    return {
        "walks": count,
        "carried_out": done,
        "share": done / count if count else None,
        "interval": [low, high],
        "failures": dict(sorted(failures.items())),
    }
