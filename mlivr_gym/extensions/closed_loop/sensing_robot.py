"""A simulated robot that looks about itself, attempts steps, and goes back when they fail.

It decides nothing: which step to attempt is chosen by the closed loop (`loop`), or by an agent
(`env`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mlivr_gym.errors import ShapeError
from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.record import FAILED, ClosedLoopRecord, Event
from mlivr_gym.motion import Trajectory
from mlivr_gym.planners import Plan
from mlivr_gym.sharing import Independent
from mlivr_gym.simulation import StepExecutor
from mlivr_gym.simulation.recording import Failure, SimulatedInterval
from mlivr_gym.simulation.simulator import PathWatch
from mlivr_gym.stances import State

ATTEMPTS = 2
"""Number of times that a limb reaches for a point before the point counts as occupied."""

NOTICED = {"missed grasp": "refused", "refused grasp": "refused", "blocked path": "blocked"}
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
        self._attempts = dict[int, int]()
        self.refused: str | None = None
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

    def look_round(self) -> None:
        """Look in all directions, and let the graph have what is believed."""
        if self._camera is not None:
            self._sense(self._camera)
        if self.belief.update_graph(self.executor.state):
            self.note("sensed", boxes=len(self.belief.boxes()))

    def _sense(self, camera: DepthCamera) -> None:
        """Look, and believe what is seen."""
        simulation, belief = self.executor.simulation, self.belief
        model, data = simulation.model, simulation.data
        belief.add_hits(camera.measure(model, data, self.graph.robot, self._rng))
        if self.record.footage is not None:
            self.record.footage.looks.append((simulation.time, belief.boxes()))

    def _watch(self, camera: DepthCamera) -> PathWatch:
        """Return what looks ahead during a step: the cameras."""

        def is_blocked(trajectory: Trajectory, sample: int) -> bool:
            self._sense(camera)
            return self.belief.is_blocked(trajectory, sample)

        return PathWatch(camera.period, is_blocked)

    def attempt(self, limb: int, point: int, branch_sets: tuple[int, ...]) -> bool:
        """Take a step to a point and branches; return whether it ended with a grasp.

        If it fails, the limb goes back; the record ends if it cannot. A point to which no swing
        exists counts as occupied.
        """
        executor, camera, name = self.executor, self._camera, self.graph.grasp_map.ids[point]
        self.intervals = []
        step = executor.prepared(limb, point, branch_sets)
        if isinstance(step, Failure):
            self.refused = "blocked"
            self.note(self.refused, limb=limb, point=name, failure=step.kind)
            self.belief.refuse(point)
            return False
        _, executed = executor.take(step, None if camera is None else self._watch(camera))
        self._measure(executed)
        failure = executed.failure
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
                back = executor.retreat()
                self._measure(back)
                if back.failure is not None:
                    self._fail(back.failure, is_back=True)
            if self._attempts[point] % ATTEMPTS == 0 and not self.record.reason:
                self.belief.refuse(point)
        return failure is None

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
