"""Carries plans out many times, each time with a robot and a module that differ otherwise."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

from scipy.stats import binomtest

from mlivr_gym.arguments import Of, checked
from mlivr_gym.motion.arguments import WALK
from mlivr_gym.motion.plan import Plan
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import Listed, Maybe, Whole
from mlivr_gym.simulation.execution import TimedWalk, execute_walk, timed_walk
from mlivr_gym.simulation.recording import Peaks
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap


class RunOutcome(NamedTuple):
    """How one walk went."""

    plan: int
    """Number of the plan."""
    seed: int
    """Seed of the disturbance."""
    failure: str | None
    """Kind of failure, one of `recording.FAILURES`; None if the walk was carried out."""
    message: str | None
    """The failure in one sentence."""
    steps: int
    """Steps of the plan."""
    done: int
    """Steps that ended with a grasp."""
    tries: int
    """Most approaches that a grasp took."""
    time: float
    """Time that passed in the simulation [s]."""
    capture_distance: float
    """Largest distance of a gripper from its point just before it grasped [m]."""
    grasp_force: float
    """Largest force on a grasp [N]."""
    grasp_torque: float
    """Largest torque on a grasp [N m]."""
    joint_torque: float
    """Largest torque of a joint [N m]."""
    base_error: float
    """Largest distance of the base from its trajectory [m]."""


class _Work(NamedTuple):
    """One plan to be carried out with several seeds."""

    plan: int
    walk: TimedWalk
    grasp_map: GraspMap
    robot: RobotSpec
    obstacles: tuple[Box, ...]
    setup: Setup
    seeds: tuple[int, ...]


@checked(
    {
        **WALK,
        "plans": Listed(Of(Plan)),
        "setup": Maybe(Of(Setup)),
        "samples": Whole(1, 10**6),
        "seed": Whole(1, 2**62),
        "workers": Maybe(Whole(1, 4096)),
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
    """Carry plans out many times.

    Sample k of plan p has the seed `seed + p * samples + k`, so that the same arguments give the
    same outcomes, whatever the number of processes. The processes are started afresh: a script that
    uses more than one needs `if __name__ == "__main__":`.

    Parameters
    ----------
    graph
        The stance graph of the plans' robot and map.
    plans
        The plans.
    setup
        How they are carried out; its disturbances are drawn anew each time.
    samples
        How often each plan is carried out.
    seed
        First seed, at least 1.
    workers
        Processes; by default one for each core.

    Yields
    ------
    RunOutcome
        Outcomes, as they come, plan by plan.

    Raises
    ------
    PlanError
        If a plan has no step, or cannot be followed.
    SettingError
        If a number is out of range.

    Example:
        >>> outcomes = list(execute_many(graph, [plan], Setup.of("gentle", disturbances="all"), 20))
        >>> success_rate(outcomes)
    """
    setup, count = setup or Setup(), workers or os.cpu_count() or 1
    works = (
        _Work(
            number,
            timed_walk(graph, plan, setup.timing, setup.physics.timestep),
            graph.grasp_map,
            plan.world.robot,
            plan.world.obstacles,
            setup,
            tuple(seed + number * samples + k for k in range(samples)),
        )
        for number, plan in enumerate(plans)
    )
    if count == 1:
        for work in works:
            yield from _outcomes(work)
        return
    with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
        for outcomes in pool.map(_outcomes, works):
            yield from outcomes


def _outcomes(work: _Work) -> list[RunOutcome]:
    """How one plan goes with several seeds."""
    found = []
    for seed in work.seeds:
        simulation = work.setup.simulation(work.grasp_map, work.robot, work.obstacles, seed)
        done = execute_walk(simulation, work.walk)
        peaks, failure = Peaks.join([step.peaks for step in done]), done[-1].failure
        captures = [step.capture for step in done if step.capture is not None]
        found.append(
            RunOutcome(
                plan=work.plan,
                seed=seed,
                failure=None if failure is None else failure.kind,
                message=None if failure is None else failure.message,
                steps=len(work.walk.steps),
                done=len(captures),
                tries=max((capture.tries for capture in captures), default=0),
                time=simulation.time,
                capture_distance=max((capture.distance for capture in captures), default=0.0),
                grasp_force=float(peaks.grasp_force.max()),
                grasp_torque=float(peaks.grasp_torque.max()),
                joint_torque=float(peaks.joint_torque.max()),
                base_error=peaks.base_error,
            )
        )
    return found


def success_rate(outcomes: Sequence[RunOutcome]) -> dict[str, Any]:
    """Share of walks that were carried out, with its interval, and the failures by kind.

    The interval is Wilson's at 95 % (Journal of the American Statistical Association 22, 1927).
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
