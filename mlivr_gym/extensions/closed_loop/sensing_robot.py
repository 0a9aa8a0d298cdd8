"""A simulated robot that looks about itself, attempts steps, and goes back when they fail.

It decides nothing: which step to attempt is chosen by the closed loop (`loop`), or by an agent
(`envs.closed_loop`).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle
from typing import Any

import numpy as np

from mlivr_gym.errors import ShapeError
from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.extensions.closed_loop.depth_camera import ALL_PIXELS, FIELDS, DepthCamera
from mlivr_gym.extensions.closed_loop.record import FAILED, ClosedLoopRecord, Event
from mlivr_gym.motion import Trajectory
from mlivr_gym.planners import Plan
from mlivr_gym.sharing import Independent
from mlivr_gym.simulation import StepExecutor
from mlivr_gym.simulation.recording import Failure
from mlivr_gym.simulation.simulated_robot import SimulatedInterval
from mlivr_gym.simulation.simulator import PathWatch
from mlivr_gym.simulation.step_executor import PreparedStep
from mlivr_gym.stances import State

ATTEMPTS = 2
"""Number of times that a limb reaches for a point before the point counts as occupied."""

BLIND_PERIOD = 1.0
"""Time between two looks of a robot without cameras [s], which see nothing."""

REFUSED = ("missed grasp", "refused grasp")
"""Failures after which the same step is tried again, see `ATTEMPTS`."""

NOTICED = {**dict.fromkeys(REFUSED, "refused"), "blocked path": "blocked"}
"""Failures after which the limb goes back to the point that it left, and their kinds of event."""


class SensingRobot(Independent):
    """A robot in a simulation of which it does not know all.

    Attributes
    ----------
    graph
        The stance graph, of what the robot knows.
    executor
        What carries out its steps.
    belief
        What it believes of the module.
    record
        What happened so far.
    refused
        Kind of event of the last attempt: `"refused"`, `"blocked"`, or None.
    fault
        What was raised while it sensed during a step; None if nothing was. It has gone
        back then.
    intervals
        What was simulated in the last attempt.
    """

    def __init__(
        self,
        executor: StepExecutor,
        camera: DepthCamera | None,
        seed: int,
        show: Callable[[Event], None] | None = None,
    ) -> None:
        """Prepare a robot with or without depth cameras.

        The seed is that of the disturbances and of the noise of the cameras; `show` is called with
        each event.
        """
        self.graph, self.executor, self.record = executor.graph, executor, ClosedLoopRecord()
        self._camera, self._seed, self._show = camera, seed, show
        self._rng = np.random.default_rng([seed, 3])
        self.belief = Belief(self.graph, camera.noise if camera is not None else 0.0)
        self._attempts, self._freed = dict[int, int](), 0
        self.refused: str | None = None
        self.fault: Exception | None = None
        self.intervals: list[SimulatedInterval] = []

    def start(self, state: State, plan: Plan | None, refusing: frozenset[int]) -> State:
        """Put the robot at rest into a state, among points that refuse a grasp.

        Returned is the state with one branch for each limb. Raises a `ShapeError` if something
        touches the robot.
        """
        state = self.executor.start(state, plan, self._seed)
        simulation = self.executor.simulation
        if simulation.data.ncon:
            geoms = simulation.data.contact[0].geom
            names = " and ".join(simulation.model.geom(int(geom)).name for geom in geoms)
            raise ShapeError(f"{names} touch at the start; move the box, or start elsewhere")
        simulation.refusing = refusing
        return state

    @property
    def may_see_through(self) -> bool:
        """Whether the robot may find out that an obstacle of the graph is gone."""
        return self._camera is not None and bool(self.graph.obstacles)

    def look_round(self) -> None:
        """Look in all directions, and believe what is seen; without cameras nothing is."""
        if self._camera is not None:
            self._sense(self._camera)
        if freed := self.belief.freed - self._freed:
            self.note("freed", cubes=freed)
            self._freed += freed

    def _sense(self, camera: DepthCamera, pixels: slice = ALL_PIXELS) -> None:
        """Look, and believe what is seen."""
        simulation, belief = self.executor.simulation, self.belief
        model, data = simulation.model, simulation.data
        hits, origins = camera.measure(model, data, self.graph.robot, self._rng, pixels)
        known = len(belief.gone)
        has_found = belief.add_hits(hits, self.executor.configuration, origins)
        if self.record.footage is not None:
            self.record.footage.looks.append((simulation.time, belief.boxes()))
        for box in belief.gone[known:]:
            self.note("gone", box=box)
        if has_found:
            self.note("sensed", hits=len(hits), boxes=len(belief.boxes()))

    def _watch(self) -> PathWatch:
        """Return what looks ahead during a step: the cameras."""
        camera, fields = self._camera, cycle(FIELDS)

        def is_blocked(trajectory: Trajectory, sample: int) -> bool:
            if camera is None:
                return False
            try:
                self._sense(camera, next(fields))
                present, belief = self.executor.configuration, self.belief
                blocked = belief.is_blocked(trajectory, sample)
                return blocked or belief.will_touch(trajectory, sample, present)
            except Exception as fault:  # whoever attempts the step raises it, once all limbs hold
                self.fault = fault
                return True

        return PathWatch(BLIND_PERIOD if camera is None else camera.period, is_blocked)

    def prepared(self, limb: int, point: int, branch_sets: tuple[int, ...]) -> PreparedStep | None:
        """Return a step to a point and branches; None, and avoid the point, if no swing exists."""
        step = self.executor.prepared(limb, point, branch_sets)
        if not isinstance(step, Failure):
            return step
        self.refused = "blocked"
        self.note(self.refused, limb=limb, point=self._name(point), failure=step.kind)
        self.belief.avoid(point)
        return None

    def attempt(self, step: PreparedStep) -> bool:
        """Take a step, and go back if it fails; return whether it ended with a grasp.

        The record ends if the robot cannot go back.
        """
        executor, grasps = self.executor, step.trajectory.grasps
        limb = int(np.flatnonzero(grasps[0] != grasps[-1])[0])
        point = int(grasps[-1, limb])
        self.intervals = []
        _, executed = executor.take(step, self._watch())
        self._measure(executed)
        failure, name = executed.failure, self._name(point)
        self.refused = None if failure is None else NOTICED.get(failure.kind)
        if executed.has_turned_back and self.refused == "refused":
            self.refused = None  # the point that it left refuses it
        if failure is None:
            self.note("step", limb=limb, point=name, duration=executor.measures["step_time"])
        elif self.refused is None:
            self._fail(failure, is_back=executed.has_turned_back)
        else:
            self.note(self.refused, limb=limb, point=name, failure=failure.kind)
            self._attempts[point] = self._attempts.get(point, 0) + 1
            if self.refused == "refused":  # from what blocks its path it has turned back
                self._retreat()
            if self._attempts[point] % ATTEMPTS == 0 and not self.record.reason:
                is_blocked = self.refused == "blocked"
                (self.belief.avoid if is_blocked else self.belief.refuse)(point)
        return failure is None

    def _retreat(self) -> None:
        """Go back to where the step began; the record ends if that fails."""
        back = self.executor.retreat()
        self._measure(back)
        if back.failure is not None:
            self._fail(back.failure, is_back=True)

    def _fail(self, failure: Failure, is_back: bool) -> None:
        """Record the end of the walk by a failure, which may be on the way back."""
        where = "on the way back, " if is_back else ""
        self.end(FAILED, f"{where}{failure.kind}: {failure.message}")

    def _measure(self, executed: SimulatedInterval) -> None:
        """Record the motion and the largest force."""
        record = self.record
        self.intervals.append(executed)
        if record.footage is not None:
            record.footage.recordings.append(executed.recording)
        record.peak_force = max(record.peak_force, float(executed.peaks.grasp_force.max()))

    def _name(self, point: int) -> str:
        """Return the id of a point."""
        return self.graph.grasp_map.ids[point]

    def note(self, kind: str, **values: Any) -> None:
        """Record an event."""
        began = hasattr(self.executor, "simulation")
        event = Event(kind, self.executor.simulation.time if began else 0.0, values)
        self.record.events.append(event)
        if self._show is not None:
            self._show(event)

    def end(self, outcome: str, reason: str) -> None:
        """Record the end of the walk."""
        self.record.outcome, self.record.reason = outcome, reason
        self.note("end", outcome=outcome, reason=reason)
