"""The closed loop: sense, plan, take one step, and so on until the goal is reached.

Here "walk" is what the robot does until it arrives, stops or fails; `run_closed_loop` simulates
one, and `mlivr-gym walk` is its command.

The robot knows a map and a goal. Boxes that its map lacks, and points that refuse a grasp, exist
only in the simulation. The cameras look round at every grasp and during every step. At a grasp,
what they saw beside the map becomes an obstacle, and the remainder of the walk is planned anew from
the branches on which the limbs are. During a step, a limb turns back if something new lies where
the robot will move. A limb that is refused, or misses its point, goes back as well. After the
second such attempt the point counts as occupied. If no plan is left in the world that the robot
believes in, it stops where it is and holds all its points.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import cycle
from typing import Any

import numpy as np

from mlivr_gym.arguments import SEED, Function, InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.closed_loop.belief import Belief
from mlivr_gym.closed_loop.depth_camera import ALL_PIXELS, FIELDS, DepthCamera
from mlivr_gym.errors import SettingError, ShapeError
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.planners import Plan, Planner, PlanningResult
from mlivr_gym.planners.query import GOAL_TOLERANCE, QUERY
from mlivr_gym.schema import Integer, ListOf, OrNone
from mlivr_gym.simulation.recording import Failure
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.simulator import PathWatch
from mlivr_gym.simulation.step_executor import StepExecutor
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.values import MAX_PARTS
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import STANCE

ATTEMPTS = 2
"""Number of times that a limb reaches for a point before the point counts as occupied.

In each of them the controller may approach several times, see `ControllerParameters.attempts`.
"""

NOTICED = {"missed grasp": "refused", "refused grasp": "refused", "blocked path": "blocked"}
"""Failures after which the limb goes back to the point that it left, and their kinds of event."""

ARRIVED, STOPPED, FAILED = "arrived", "stopped", "failed"
"""Outcomes of a walk. A robot that stopped holds all its points; one that failed may not."""


@dataclass(frozen=True)
class Event:
    """Something that happened in a closed loop.

    Attributes
    ----------
    kind
        `"sensed"`, `"planned"`, `"step"`, `"refused"`, `"blocked"` or `"end"`.
    time
        Simulated time [s].
    values
        What belongs to it: `"sensed"`, which tells of an obstacle away from those seen before, has
        `hits`, the number of rays that measured a surface, and `boxes`, the number of boxes of all
        that is seen so far; `"planned"` has `steps` and `computing_time` [s], from what was seen to
        the plan; `"step"` has `limb`, `point` and `duration` [s]; `"refused"` and `"blocked"` have
        `limb`, `point` and `failure`, its kind; `"end"` has `outcome` and `reason`.
    """

    kind: str
    time: float
    values: dict[str, Any]


@dataclass
class ClosedLoopRecord:
    """The record of a closed loop.

    Attributes
    ----------
    outcome
        `ARRIVED`, `STOPPED` or `FAILED`.
    reason
        Why the walk ended, in one sentence.
    events
        What happened, in order.
    plans
        Each plan that led the robot elsewhere than the one before, with the number of its steps
        that were taken.
    sensed
        Boxes that were sensed.
    refused
        Ids of the points that count as occupied, since limbs did not get to them or were refused.
    peak_force
        Largest force of a grasp [N].
    duration
        Simulated time [s].
    """

    outcome: str = FAILED
    reason: str = ""
    events: list[Event] = field(default_factory=list)
    plans: list[tuple[Plan, int]] = field(default_factory=list)
    sensed: tuple[Box, ...] = ()
    refused: tuple[str, ...] = ()
    peak_force: float = 0.0
    duration: float = 0.0

    @property
    def steps(self) -> int:
        """Number of steps that ended with a grasp."""
        return sum(event.kind == "step" for event in self.events)

    @property
    def replanning_times(self) -> Array:
        """Computing time of each plan after the first [s]."""
        planned = [
            event.values["computing_time"] for event in self.events if event.kind == "planned"
        ]
        return np.array(planned[1:])

    def add_step(self, plan: Plan) -> None:
        """Record that the first step of a plan was taken; it may continue the plan before it."""
        if self.plans:
            last, taken = self.plans[-1]
            if last.actions[taken:] == plan.actions:
                self.plans[-1] = last, taken + 1
                return
        self.plans.append((plan, 1))

    def to_dict(self) -> dict[str, Any]:
        """Return the record as plain data for JSON."""
        return {
            "outcome": self.outcome,
            "reason": self.reason,
            "steps": self.steps,
            "duration": self.duration,
            "peak_force": self.peak_force,
            "sensed": [box.to_dict() for box in self.sensed],
            "refused": list(self.refused),
            "events": [
                {"kind": event.kind, "time": event.time} | event.values for event in self.events
            ],
        }


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
    plan = partial(planner.plan, goal=goal, cost=cost, goal_tolerance=goal_tolerance)
    loop = _Loop(executor, plan, camera, seed, show)
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
        camera: DepthCamera | None,
        seed: int,
        show: Callable[[Event], None] | None,
    ) -> None:
        self.graph, self.record = executor.graph, ClosedLoopRecord()
        self._executor, self._plan_from, self._show = executor, plan_from, show
        self._camera, self._seed = camera, seed
        self._belief = Belief(self.graph, camera.noise if camera is not None else 0.0)
        self._rng = np.random.default_rng([seed, 3])
        self._attempts = dict[int, int]()

    def run(self, start: Sequence[str | int], refusing: frozenset[int], max_steps: int) -> None:
        """Sense, plan and step until the walk ends."""
        executor, record, ids = self._executor, self.record, self.graph.grasp_map.ids
        state = self.graph.state(start)
        first = self._plan_from(state)  # it chooses the branches of the start
        if first.plan is None:
            self._end(STOPPED, first.message)
            return
        executor.start(state, first.plan if first.plan.steps else None, self._seed)
        self._check_start()
        executor.simulation.refusing = refusing
        attempts = 0
        while not record.reason:
            if self._camera is not None:
                self._sense(self._camera)
            plan = self._plan(executor.state)
            if plan is None:
                break
            if not plan.steps:
                away = executor.configuration[0] - np.array(plan.query.goal)
                self._end(ARRIVED, f"the base is {np.linalg.norm(away):.3f} m from the goal")
            elif attempts == max_steps:
                self._end(STOPPED, f"no arrival within {max_steps} attempted steps")
            else:
                self._step(plan)
                attempts += 1
        record.sensed, record.duration = self._belief.boxes(), executor.simulation.time
        record.refused = tuple(ids[point] for point in sorted(self._belief.refused))

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
        if belief.add_hits(hits, model, data):
            self._note("sensed", hits=len(hits), boxes=len(belief.boxes()))

    def _watch(self) -> PathWatch | None:
        """Return what looks ahead during a step: the cameras, or nothing."""
        camera, fields = self._camera, cycle(FIELDS)
        if camera is None:
            return None

        def is_blocked(trajectory: Trajectory, sample: int) -> bool:
            self._sense(camera, next(fields))
            return self._belief.is_blocked(trajectory, sample)

        return PathWatch(camera.period, is_blocked)

    def _plan(self, state: State) -> Plan | None:
        """Plan the remainder of the walk in what is believed; end the walk if there is no plan."""
        began = time.perf_counter()
        self._belief.update_graph()
        result = self._plan_from(state)
        computing_time = time.perf_counter() - began
        if result.plan is None:
            self._end(STOPPED, result.message)
            return None
        self._note("planned", steps=len(result.plan.steps), computing_time=computing_time)
        return result.plan

    def _step(self, plan: Plan) -> None:
        """Take the first step of a plan, or go back if its point cannot be grasped."""
        executor, record, (limb, name) = self._executor, self.record, plan.actions[0]
        point = self.graph.grasp_map.index(name)
        executor.follow(plan)
        moves = self.graph.successors(executor.state)
        branch_sets = tuple(moves.branch_sets[moves.find(limb, point)].tolist())
        _, executed = executor.step(limb, point, branch_sets, self._watch())
        if isinstance(executed, Failure):
            self._end(STOPPED, executed.message)
            return
        record.peak_force = max(record.peak_force, float(executed.peaks.grasp_force.max()))
        failure = executed.failure
        if failure is None:
            self._note("step", limb=limb, point=name, duration=executor.measures["step_time"])
            record.add_step(plan)
        elif failure.kind in NOTICED:
            self._note(NOTICED[failure.kind], limb=limb, point=name, failure=failure.kind)
            self._attempts[point] = self._attempts.get(point, 0) + 1
            while_returning = None
            if failure.kind != "blocked path":  # from that it has turned back
                back = executor.retreat()
                record.peak_force = max(record.peak_force, float(back.peaks.grasp_force.max()))
                while_returning = back.failure
            if while_returning is not None:
                kind, message = while_returning.kind, while_returning.message
                self._end(FAILED, f"on the way back, {kind}: {message}")
            elif self._attempts[point] == ATTEMPTS:
                self._belief.refuse(point)
        else:
            self._end(FAILED, f"{failure.kind}: {failure.message}")

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
