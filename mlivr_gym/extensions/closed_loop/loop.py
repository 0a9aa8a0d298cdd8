"""The closed loop: sense, plan, take one step, and so on until the goal is reached.

Here "walk" is what the robot does until it arrives, stops or fails; `run_closed_loop` simulates
one, and `mlivr-gym walk` is its command.

The robot knows a map and a goal. Boxes that its map lacks, and points that refuse a grasp, exist
only in the simulation. The cameras look round at every grasp and during every step. What they saw
beside the map becomes an obstacle, and if that blocks the remainder of the walk, it is planned anew
from the branches on which the limbs are. During a step, a limb turns back if something new lies
where the robot will move, or if the robot is so far off its trajectory that it would touch
something. A limb that is refused, or misses its point, goes back as well and tries again. After the
second such attempt the point counts as occupied. If no plan is left in the world that the robot
believes in, points to which paths were blocked are tried once more; then it stops where it is and
holds all its points. So it does if sensing or planning fails; a limb that swings then goes back
first.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from mlivr_gym.arguments import SEED, Function, InstanceOf, checked
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.extensions.closed_loop.course import Course
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
from mlivr_gym.stances.obstacles import IDS
from mlivr_gym.values import MAX_PARTS
from mlivr_gym.world import Box
from mlivr_gym.world.given_points import STANCE

INFLATION, ANY_PLAN = 3.0, 1e6
"""Suboptimality bound of the plans of more than two limbs, and one that any plan is within."""

LITTLE_EFFORT, EFFORT = 200_000, 1_000_000
"""Effort of each planning of more than two limbs, see `PathSearch.effort`, some half a second, and
that of a search for any plan if none is found, some five seconds."""

FAULT = "sensing or planning failed"
"""Reason of a stop after an error of the package."""


@checked(
    {
        **QUERY,
        "unknown": ListOf(InstanceOf(Box), 0, MAX_PARTS),
        "gone": IDS,
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
    gone: Sequence[str] = (),
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
    gone
        Ids of obstacles of the graph that are not there, which the robot does not know. It gives
        them up when its cameras have looked through them.
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
    if absent := set(gone) - {box.id for box in graph.obstacles}:
        raise SettingError(f"gone has {min(absent)!r}, which is not an obstacle of the graph")
    there = (box for box in graph.obstacles if box.id not in gone)
    executor = StepExecutor(graph, setup or Setup(), (*there, *unknown))
    planner = Planner(graph)
    plan = partial(planner.plan, goal=goal, cost=cost, goal_tolerance=goal_tolerance)

    def plan_from(state: State, patience: float) -> PlanningResult:
        if graph.lists_all:  # until a plan is proved to be the best
            return plan(state, options=SearchOptions(inflation=1.0))
        if patience == 1.0:
            found = plan(state, options=SearchOptions(inflation=INFLATION, effort=LITTLE_EFFORT))
            if found.reason != LIMIT_REACHED:
                return found
        return plan(state, options=SearchOptions(inflation=ANY_PLAN, effort=int(patience * EFFORT)))

    robot = SensingRobot(executor, camera, seed, show)
    course = Course(robot.belief, planner, plan_from)
    robot.record.footage = Footage() if filmed else None
    try:
        _Loop(robot, course).run(start, refusing_points, max_steps)
    finally:
        robot.belief.withdraw()
    return robot.record


class _Loop:
    """A closed loop in progress."""

    def __init__(self, robot: SensingRobot, course: Course) -> None:
        self.graph, self.record, self._robot = robot.graph, robot.record, robot
        self._executor, self._belief = robot.executor, robot.belief
        self._course = course

    def run(self, start: Sequence[str | int], refusing: frozenset[int], max_steps: int) -> None:
        """Sense, plan and step until the walk ends."""
        executor, record, ids = self._executor, self.record, self.graph.grasp_map.ids
        state = self.graph.state(start)
        if self._robot.may_see_through:  # what is gone has no say in the branches of the start
            self._robot.start(state, None, refusing)
            try:
                self._robot.look_round()
            except MlivrError as fault:
                self._robot.end(STOPPED, f"{FAULT}: {fault}")
                return
            self._belief.update_graph(state)
            state = self.graph.state(start)
        first = self._replan(state)  # it chooses the branches of the start
        if first.plan is None:
            record.proved, record.sensed = first.reason in PROVED_IMPOSSIBLE, self._belief.boxes()
            self._robot.end(STOPPED, first.message)
            return
        plan = first.plan if first.plan.steps else None
        self._robot.start(state, plan, refusing)
        attempts = 0
        while not record.reason:
            plan = self._plan(executor.state)
            if plan is None:
                continue
            if self._course.taken == len(plan.steps):
                away = executor.configuration[0] - np.array(plan.query.goal)
                distance = np.linalg.norm(away)
                self._robot.end(ARRIVED, f"the base is {distance:.3f} m from the goal")
            elif attempts == max_steps:
                self._robot.end(STOPPED, f"no arrival within {max_steps} attempted steps")
            else:
                self._step(plan)
                attempts += 1
        record.sensed, record.duration = self._belief.boxes(), executor.simulation.time
        record.state, occupied = executor.state, self._belief.refused | self._belief.avoided
        record.refused = tuple(ids[point] for point in sorted(occupied))

    def _plan(self, state: State) -> Plan | None:
        """Look round, and plan the remainder of the walk; if there is no plan, the walk ends."""
        robot = self._robot
        try:
            if robot.fault is not None:
                raise robot.fault
            robot.look_round()
            began = time.perf_counter()
            result = self._replan(state)
            computing_time = time.perf_counter() - began
        except MlivrError as fault:
            robot.end(STOPPED, f"{FAULT}: {fault}")
            return None
        plan = self._course.plan
        if plan is None:
            is_proved = result.reason in PROVED_IMPOSSIBLE
            self.record.proved = is_proved and not self._belief.avoided
            robot.end(STOPPED, result.message)
            return None
        remaining = len(plan.steps) - self._course.taken
        robot.note("planned", steps=remaining, computing_time=computing_time)
        if self.record.footage is not None:
            self.record.footage.plans.append((self._executor.simulation.time, plan))
        return plan

    def _replan(self, state: State) -> PlanningResult:
        """Plan the remainder of the walk, and record what is doubted for its sake."""
        doubted = len(self._belief.doubted)
        result = self._course.replan(state)
        for box in self._belief.doubted[doubted:]:
            self._robot.note("doubts", box=box)
        return result

    def _step(self, plan: Plan) -> None:
        """Attempt the next step of a plan."""
        executor, taken = self._executor, self._course.taken
        limb, name = plan.actions[taken]
        executor.follow(plan)
        moves, point = self.graph.successors(executor.state), self.graph.grasp_map.index(name)
        branch_sets = tuple(moves.branch_sets[moves.find(limb, point)].tolist())
        prepared = self._robot.prepared(limb, point, branch_sets)
        if prepared is not None and self._robot.attempt(prepared):
            self._course.taken += 1
            self.record.add_step(plan, taken)
