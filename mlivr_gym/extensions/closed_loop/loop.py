"""The closed loop: sense, plan, take one step, and so on until the goal is reached.

The robot knows a map and a goal. Boxes that its map lacks, and points that refuse a grasp, exist
only in the simulation. The cameras look round at every grasp and during every step. What they saw
beside the map becomes an obstacle. The robot goes on with what remains of its plan while that is
possible, and plans anew where it is not, from the branches on which the limbs are.

During a step, a limb turns back if something new lies where the robot will move. A limb that is
refused, or misses its point, goes back as well. After the second attempt in vain the point counts
as occupied. If no plan is left in the world that the robot believes in, it takes what it saw to be
a little smaller; if there is none then either, it stops where it is and holds all its points.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mlivr_gym.arguments import SEED, Function, InstanceOf, checked
from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.record import (
    ARRIVED,
    STOPPED,
    ClosedLoopRecord,
    Event,
    Footage,
)
from mlivr_gym.extensions.closed_loop.sensing_robot import SensingRobot
from mlivr_gym.planners import (
    GOAL_TOLERANCE,
    LIMIT_REACHED,
    PROVED_IMPOSSIBLE,
    QUERY,
    Plan,
    Planner,
    PlanningResult,
    SearchOptions,
)
from mlivr_gym.schema import Flag, Integer, ListOf, OrNone
from mlivr_gym.simulation import Setup, StepExecutor
from mlivr_gym.stances import StanceGraph, State
from mlivr_gym.values import MAX_PARTS
from mlivr_gym.world import Box
from mlivr_gym.world.given_points import STANCE

EFFORT = 1_000_000
"""Effort, see `PathSearch.effort`, which takes some five seconds."""

GOOD = SearchOptions(inflation=3.0, effort=EFFORT // 5)
ANY = SearchOptions(inflation=1e6, effort=4 * EFFORT)
"""Searches of more than two limbs: for a good plan, and if its effort is spent, for any plan."""


@checked(
    {
        **QUERY,
        "unknown": ListOf(InstanceOf(Box), 0, MAX_PARTS),
        "refusing": STANCE,
        "camera": OrNone(InstanceOf(DepthCamera)),
        "setup": OrNone(InstanceOf(Setup)),
        "seed": SEED,
        "max_steps": Integer(1, 100_000),
        "show": OrNone(Function()),
        "filmed": Flag(),
    }
)
def run_closed_loop(
    graph: StanceGraph,
    start: Sequence[str | int],
    goal: Sequence[float],
    cost: str = "steps",
    *,
    goal_tolerance: float = GOAL_TOLERANCE,
    unknown: Sequence[Box] = (),
    refusing: Sequence[str | int] = (),
    camera: DepthCamera | None = None,
    setup: Setup | None = None,
    seed: int = 0,
    max_steps: int = 200,
    show: Callable[[Event], None] | None = None,
    filmed: bool = False,
) -> ClosedLoopRecord:
    """Sense, plan and step until the goal, in a module of which the robot does not know all.

    Parameters
    ----------
    graph
        The stance graph of what the robot knows. What it senses is added to it, and taken away
        again at the end.
    start
        Point id (or index) of each limb.
    goal
        Goal position x, y, z of the base [m].
    cost
        Cost of the plans, `"steps"` or `"base"`.
    goal_tolerance
        Radius of the goal region [m].
    unknown
        Boxes that the robot does not know.
    refusing
        Points, by id or index, that refuse a grasp, which the robot does not know.
    camera
        The depth cameras, by default none: the robot is then blind.
    setup
        Limits, controller, physics and disturbances.
    seed
        Seed of the disturbances and of the noise of the cameras.
    max_steps
        Number of attempted steps after which the robot stops.
    show
        Called with each event.
    filmed
        Keep what a film shows, see `Footage` and `closed_loop_film`.

    Returns
    -------
    ClosedLoopRecord
        The record of the walk.

    Raises
    ------
    MlivrError
        If an argument cannot be used.

    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> from mlivr_gym.extensions.closed_loop.loop import run_closed_loop
    >>> record = run_closed_loop(stance_graph(), ("D2a:4", "D2b:4"), (3.0, 0.0, 0.42))
    >>> record.outcome
    'arrived'
    """
    refusing_points = frozenset(graph.grasp_map.index(point) for point in refusing)
    if held := refusing_points.intersection(graph.indices(start)):
        raise SettingError(
            f"refusing has {graph.grasp_map.ids[min(held)]!r}, which the robot holds at the start"
        )
    executor = StepExecutor(graph, setup or Setup(), (*graph.obstacles, *unknown))
    robot = SensingRobot(executor, camera, seed, show)
    robot.record.footage = Footage() if filmed else None
    query = {"goal": goal, "cost": cost, "goal_tolerance": goal_tolerance}
    try:
        _Loop(robot, query).run(start, refusing_points, max_steps)
    finally:
        robot.belief.withdraw()
    return robot.record


class _Loop:
    """A closed loop in progress: a robot, its query, and the plan that it follows."""

    def __init__(self, robot: SensingRobot, query: dict[str, Any]) -> None:
        self.graph, self.record, self._robot = robot.graph, robot.record, robot
        self._executor, self._belief = robot.executor, robot.belief
        self._planner, self._query = Planner(robot.graph), query
        self._plan: Plan | None = None
        self._taken = 0  # number of its steps that were taken

    def run(self, start: Sequence[str | int], refusing: frozenset[int], max_steps: int) -> None:
        """Sense, plan and step until the walk ends."""
        robot, record, executor = self._robot, self.record, self._executor
        state = self.graph.state(start)
        plan = self._follow(self._planned(state))
        if plan is None:
            return
        # The first plan chooses the branches of the start.
        robot.start(state, plan if plan.steps else None, refusing)
        attempts = 0
        while (plan := self._look_and_plan()) is not None:
            if not plan.steps:
                away = np.linalg.norm(executor.configuration[0] - np.array(plan.query.goal))
                robot.end(ARRIVED, f"the base is {away:.3f} m from the goal")
            elif attempts == max_steps:
                robot.end(STOPPED, f"no arrival within {max_steps} attempted steps")
            else:
                self._step(plan)
                attempts += 1
            if record.reason:
                break
        record.sensed, record.duration = self._belief.boxes(), executor.simulation.time
        ids, record.state = self.graph.grasp_map.ids, executor.state
        record.refused = tuple(ids[point] for point in sorted(self._belief.refused))

    def _look_and_plan(self) -> Plan | None:
        """Look round, and plan the remainder of the walk; if there is no plan, the walk ends."""
        robot = self._robot
        robot.look_round()
        began = time.perf_counter()
        result = self._planned(self._executor.state)
        computing_time = time.perf_counter() - began
        plan = self._follow(result)
        if plan is not None:
            robot.note("planned", steps=len(plan.steps), computing_time=computing_time)
            if self.record.footage is not None:
                self.record.footage.plans.append((self._executor.simulation.time, plan))
        return plan

    def _planned(self, state: State) -> PlanningResult:
        """Return what remains of the plan, else a plan from a state in what is believed now.

        If there is none, the robot is less cautious from now on.
        """
        found = self._remainder(state) or self._search(state)
        if found.plan is None and self._belief.relax():
            self._belief.update_graph(state)
            found = self._remainder(state) or self._search(state)
        return found

    def _remainder(self, state: State) -> PlanningResult | None:
        """Return what remains of the plan, None if it is not possible any more."""
        plan, taken = self._plan, self._taken
        return None if plan is None else self._planner.remainder(plan, taken, state)

    def _search(self, state: State) -> PlanningResult:
        """Return the result of a search for a plan from a state."""
        if self.graph.lists_all:  # until a plan is proved to be the best
            return self._planner.plan(state, **self._query, options=SearchOptions(inflation=1.0))
        found = self._planner.plan(state, **self._query, options=GOOD)
        if found.reason == LIMIT_REACHED:
            found = self._planner.plan(state, **self._query, options=ANY)
        return found

    def _follow(self, result: PlanningResult) -> Plan | None:
        """Follow the plan of a result; if it has none, the walk ends."""
        self._plan, self._taken = result.plan, 0
        if result.plan is None:
            self.record.proved = result.reason in PROVED_IMPOSSIBLE
            self._robot.end(STOPPED, result.message)
        return result.plan

    def _step(self, plan: Plan) -> None:
        """Attempt the first step of a plan."""
        executor, (limb, name) = self._executor, plan.actions[0]
        executor.follow(plan)
        moves, point = self.graph.successors(executor.state), self.graph.grasp_map.index(name)
        branch_sets = tuple(moves.branch_sets[moves.find(limb, point)].tolist())
        if self._robot.attempt(limb, point, branch_sets):
            self._taken = 1
            self.record.add_step(plan)
