"""The closed loop: sense, plan, take one step, and so on until the goal is reached.

Here "walk" is what the robot does until it arrives, stops or fails; `run_closed_loop` simulates
one, and `mlivr-gym walk` is its command.

The robot knows a map and a goal. Boxes that its map lacks, and points that refuse a grasp, exist
only in the simulation. The cameras look round at every grasp and during every step. At a grasp,
what they saw beside the map becomes an obstacle, and the remainder of the walk is planned anew from
the branches on which the limbs are. During a step, a limb turns back if something new lies where
the robot will move, or if the robot is so far off its trajectory that it would touch something. A
limb that is refused, or misses its point, goes back as well and tries again, unless a cheaper plan
was found on the way. After the second such attempt the point counts as occupied. If no plan is left
in the world that the robot believes in, points to which paths were blocked are tried once more;
then it stops where it is and holds all its points. So it does if sensing or planning fails; a limb
that swings then goes back first.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from itertools import count, cycle
from typing import Any

import numpy as np

from mlivr_gym.arguments import SEED, Function, InstanceOf, checked
from mlivr_gym.closed_loop.belief import Belief
from mlivr_gym.closed_loop.course import Course
from mlivr_gym.closed_loop.crew import CrewMember
from mlivr_gym.closed_loop.depth_camera import ALL_PIXELS, FIELDS, DepthCamera
from mlivr_gym.closed_loop.evasion import PROOF, TRIED_IN_TURN, Evasion, Rest
from mlivr_gym.closed_loop.record import ARRIVED, FAILED, STOPPED, ClosedLoopRecord, Event
from mlivr_gym.errors import MlivrError, SettingError, ShapeError
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.planners import Plan, Planner, PlanningResult
from mlivr_gym.planners.planning_result import PROVED_IMPOSSIBLE
from mlivr_gym.planners.query import GOAL_TOLERANCE, QUERY
from mlivr_gym.schema import Integer, ListOf, OrNone, Tuples
from mlivr_gym.simulation.recording import Failure
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.simulated_robot import SimulatedInterval
from mlivr_gym.simulation.simulator import PathWatch
from mlivr_gym.simulation.step_executor import PreparedStep, StepExecutor
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.values import MAX_PARTS
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import STANCE

ATTEMPTS = 2
"""Number of times that a limb reaches for a point before the point counts as occupied.

In each of them the controller may approach several times, see `ControllerParameters.attempts`.
"""

BLIND_PERIOD = 1.0
"""Time between two looks of a robot without cameras [s], which see nothing."""

LOOKS = 4
"""Number of looks during a step after which the robot plans on from where the step leads."""

INFLATION = 2.0
"""Suboptimality bound of the plans of more than two limbs, with a time limit."""

HOLDING_TIME = 2.0
"""Time after which a robot that cannot make way looks again for a step [s]."""

REFUSED = ("missed grasp", "refused grasp")
"""Failures after which the same step is tried again, see `ATTEMPTS`."""

NOTICED = {**dict.fromkeys(REFUSED, "refused"), "blocked path": "blocked"}
"""Failures after which the limb goes back to the point that it left, and their kinds of event."""


@checked(
    {
        **QUERY,
        "unknown": ListOf(InstanceOf(Box), 0, MAX_PARTS),
        "refusing": STANCE,
        "crew": ListOf(InstanceOf(CrewMember), 0, 100),
        "camera": OrNone(InstanceOf(DepthCamera)),
        "setup": OrNone(InstanceOf(Setup)),
        "seed": SEED,
        "max_steps": Integer(1, 100_000),
        "time_limit": OrNone(Tuples((), 0.0)),
        "show": OrNone(Function()),
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
    crew: Sequence[CrewMember] = (),
    camera: DepthCamera | None = None,
    setup: Setup | None = None,
    seed: int = 0,
    max_steps: int = 200,
    time_limit: float | None = None,
    show: Callable[[Event], None] | None = None,
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
    crew
        Crew members who cross the cabin. The robot is told where they are and how they move.
    camera
        The depth cameras, by default none: the robot is then blind.
    setup
        Limits, controller, physics and disturbances.
    seed
        Seed of the disturbances and of the noise of the cameras.
    max_steps
        Number of attempted steps after which the robot stops.
    time_limit
        Maximum time of each planning [s]. More than two limbs follow a plan that is proved within
        `INFLATION`, or the best one found in this time; without a limit, the first one found. If
        none is found, any plan is searched for, `PATIENCE` times as long, before the robot stops.
    show
        Called with each event.

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
    >>> from mlivr_gym.closed_loop.loop import run_closed_loop
    >>> record = run_closed_loop(stance_graph(), ("D2a:4", "D2b:4"), (3.0, 0.0, 0.42))
    >>> record.outcome
    'arrived'
    """
    before = graph.obstacles, graph.occupied
    refusing_points = frozenset(graph.grasp_map.index(point) for point in refusing)
    if held := refusing_points.intersection(graph.indices(start)):
        raise SettingError(
            f"refusing has {graph.grasp_map.ids[min(held)]!r}, which the robot holds at the start"
        )
    executor = StepExecutor(graph, setup or Setup(), (*graph.obstacles, *unknown))
    planner = Planner(graph)
    inflation = INFLATION if graph.limbs > 2 and time_limit is not None else None
    plan = partial(planner.plan, goal=goal, cost=cost, goal_tolerance=goal_tolerance)

    def plan_from(state: State, patience: float) -> PlanningResult:
        limit = None if time_limit is None else patience * time_limit
        return plan(state, inflation=inflation if patience == 1.0 else None, time_limit=limit)

    loop = _Loop(executor, plan_from, (camera, tuple(crew)), seed, show)
    try:
        loop.run(start, refusing_points, max_steps)
    finally:
        graph.remove_obstacles()
        graph.vacate()
        graph.add_obstacles(before[0])
        graph.occupy(sorted(before[1]))
    return loop.record


class _Loop:
    """A closed loop in progress."""

    def __init__(
        self,
        executor: StepExecutor,
        plan_from: Callable[..., PlanningResult],
        around: tuple[DepthCamera | None, tuple[CrewMember, ...]],
        seed: int,
        show: Callable[[Event], None] | None,
    ) -> None:
        self.graph, self.record = executor.graph, ClosedLoopRecord()
        self._executor, self._show = executor, show
        (self._camera, self._crew), self._seed = around, seed
        camera = self._camera
        self._belief = Belief(self.graph, camera.noise if camera is not None else 0.0)
        self._rng = np.random.default_rng([seed, 3])
        self._attempts, self._course = dict[int, int](), Course(self._belief, plan_from)
        self._is_retry = False
        self._fault: Exception | None = None
        self._evasion = Evasion(executor, self._belief.shapes, self._crew)

    def run(self, start: Sequence[str | int], refusing: frozenset[int], max_steps: int) -> None:
        """Sense, plan and step until the walk ends."""
        executor, record, ids = self._executor, self.record, self.graph.grasp_map.ids
        state = self.graph.state(start)
        first = self._course.replan(state)  # it chooses the branches of the start
        if first.plan is None:
            record.proved = first.reason in PROVED_IMPOSSIBLE
            self._end(STOPPED, first.message)
            return
        executor.start(state, first.plan if first.plan.steps else None, self._seed)
        self._check_start()
        executor.simulation.refusing = refusing
        executor.simulation.is_localised = self._camera is not None
        attempts = 0
        while not record.reason:
            plan = self._plan(executor.state)
            if plan is None:
                break
            if self._course.taken == len(plan.steps):
                away = executor.configuration[0] - np.array(plan.query.goal)
                self._end(ARRIVED, f"the base is {np.linalg.norm(away):.3f} m from the goal")
            elif attempts == max_steps:
                self._end(STOPPED, f"no arrival within {max_steps} attempted steps")
            else:
                self._step(plan)
                attempts += 1
        record.sensed, record.duration = self._belief.boxes(), executor.simulation.time
        record.state, occupied = executor.state, self._belief.refused | self._belief.avoided
        record.refused = tuple(ids[point] for point in sorted(occupied))

    def _check_start(self) -> None:
        """Check that nothing touches the robot at the start."""
        data, model = self._executor.simulation.data, self._executor.simulation.model
        if data.ncon:
            names = " and ".join(model.geom(int(geom)).name for geom in data.contact[0].geom)
            raise ShapeError(f"{names} touch at the start; move the box, or start elsewhere")

    def _sense(self, camera: DepthCamera, pixels: slice = ALL_PIXELS) -> None:
        """Look round, and believe what is seen."""
        simulation, belief = self._executor.simulation, self._belief
        model, data = simulation.model, simulation.data
        hits = camera.measure(model, data, self.graph.robot, self._rng, pixels)
        if belief.add_hits(hits, self._executor.configuration):
            self._note("sensed", hits=len(hits), boxes=len(belief.boxes()))

    def _watch(self, after: State) -> PathWatch:
        """Return what looks ahead during a step to a state: the cameras, and the planner."""
        camera, fields, looks = self._camera, cycle(FIELDS), count(1)

        def is_blocked(trajectory: Trajectory, sample: int) -> bool:
            if camera is None:
                return False
            try:
                return look(camera, trajectory, sample)
            except Exception as fault:  # `_plan` raises it again, once all limbs hold
                self._fault = fault
                return True

        def look(camera: DepthCamera, trajectory: Trajectory, sample: int) -> bool:
            self._sense(camera, next(fields))
            present, belief = self._executor.configuration, self._belief
            if belief.is_blocked(trajectory, sample) or belief.will_touch(
                trajectory, sample, present
            ):
                return True
            began = time.perf_counter()
            if next(looks) % LOOKS == 0 and self._course.plan_ahead(after):
                self.record.times_ahead.append(time.perf_counter() - began)
            return False

        return PathWatch(BLIND_PERIOD if camera is None else camera.period, is_blocked)

    def _plan(self, state: State) -> Plan | None:
        """Look round, and plan the remainder of the walk; end the walk if there is no plan."""
        try:
            if self._fault is not None:
                raise self._fault
            if self._camera is not None:
                self._sense(self._camera)
            began = time.perf_counter()
            result = self._course.replan(state, self._is_retry)
            computing_time = time.perf_counter() - began
        except MlivrError as fault:
            self._end(STOPPED, f"sensing or planning failed: {fault}")
            return None
        plan = self._course.plan
        if plan is None:
            is_proved = result.reason in PROVED_IMPOSSIBLE
            self.record.proved = is_proved and not self._belief.avoided
            self._end(STOPPED, result.message)
            return None
        remaining = len(plan.steps) - self._course.taken
        self._note("planned", steps=remaining, computing_time=computing_time)
        return plan

    def _step(self, plan: Plan) -> None:
        """Take the next step of a plan; if a crew member is in the way, make way for it."""
        executor, taken = self._executor, self._course.taken
        limb, name = plan.actions[taken]
        executor.follow(plan if self._course.is_new else None)
        moves, point = self.graph.successors(executor.state), self.graph.grasp_map.index(name)
        branch_sets = tuple(moves.branch_sets[moves.find(limb, point)].tolist())
        prepared = executor.prepared(limb, point, branch_sets)
        if isinstance(prepared, Failure):
            self._note("blocked", limb=limb, point=name, failure=prepared.kind)
            self._belief.avoid(point)
            return
        wait: float | None = 0.0
        if self._crew:
            rest = Rest(executor.state, executor.joints)
            wait = self._evasion.waiting_time(rest, prepared, executor.simulation.time)
        if wait is None:
            self._evade(prepared)
        elif self._move(prepared, wait):
            self._course.taken += 1
            self.record.add_step(plan, taken)

    def _evade(self, prepared: PreparedStep) -> None:
        """Take the first step out of the lanes of crew members in place of a step.

        The robot holds if it is best to stay, or if no way out keeps any distance.
        """
        executor = self._executor
        rest, now = Rest(executor.state, executor.joints), executor.simulation.time
        for margins in TRIED_IN_TURN:
            escape = self._evasion.escape(rest, now, margins)
            if margins == PROOF and escape.steps is None:
                self.record.is_crew_unavoidable |= escape.is_exhausted and now == 0.0
            if escape.steps is not None:
                break
        if escape.steps:
            self._move(*escape.steps[0])
        else:
            self._note("holds", duration=HOLDING_TIME)
            self._measure(executor.hold(HOLDING_TIME, prepared))

    def _measure(self, executed: SimulatedInterval) -> None:
        """Record the largest force, and the smallest distance from crew members."""
        record = self.record
        record.peak_force = max(record.peak_force, float(executed.peaks.grasp_force.max()))
        if self._crew:
            before = np.inf if record.crew_distance is None else record.crew_distance
            record.crew_distance = min(before, self._evasion.distance_during(executed.recording))

    def _move(self, prepared: PreparedStep, wait: float) -> bool:
        """Wait, take a step, and go back if it fails; return whether it ended with a grasp."""
        executor, grasps = self._executor, prepared.trajectory.grasps
        limb = int(np.flatnonzero(grasps[0] != grasps[-1])[0])
        point = int(grasps[-1, limb])
        name = self.graph.grasp_map.ids[point]
        if wait:
            self._note("waits", duration=wait)
        _, executed = executor.take(prepared, self._watch(prepared.after), wait)
        self._measure(executed)
        failure = executed.failure
        self._is_retry = failure is not None and failure.kind in REFUSED
        if failure is None:
            self._note("step", limb=limb, point=name, duration=executor.measures["step_time"])
        elif failure.kind in NOTICED:
            self._note(NOTICED[failure.kind], limb=limb, point=name, failure=failure.kind)
            self._attempts[point] = self._attempts.get(point, 0) + 1
            while_returning = None
            if failure.kind != "blocked path":  # from that it has turned back
                back = executor.retreat()
                self._measure(back)
                while_returning = back.failure
            if while_returning is not None:
                kind, message = while_returning.kind, while_returning.message
                self._end(FAILED, f"on the way back, {kind}: {message}")
            elif self._attempts[point] % ATTEMPTS == 0:
                is_blocked = failure.kind == "blocked path"
                (self._belief.avoid if is_blocked else self._belief.refuse)(point)
        else:
            self._end(FAILED, f"{failure.kind}: {failure.message}")
        return failure is None

    def _note(self, kind: str, **values: Any) -> None:
        """Record an event."""
        began = hasattr(self._executor, "simulation")
        event = Event(kind, self._executor.simulation.time if began else 0.0, values)
        self.record.events.append(event)
        if self._show is not None:
            self._show(event)

    def _end(self, outcome: str, reason: str) -> None:
        """Record the end of the walk."""
        self.record.outcome, self.record.reason = outcome, reason
        self._note("end", outcome=outcome, reason=reason)
