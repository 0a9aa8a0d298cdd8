"""Regrasps in MuJoCo: a limb releases a point, follows a trajectory and captures the next point."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mlivr_gym.errors import SimulationError
from mlivr_gym.motion.joint_path import PHASES
from mlivr_gym.motion.trajectory import FREE, Trajectory
from mlivr_gym.simulation.grippers import can_capture
from mlivr_gym.simulation.guidance import PATIENCE
from mlivr_gym.simulation.joint_controller import Reference
from mlivr_gym.simulation.recording import Capture, Failure
from mlivr_gym.simulation.simulated_robot import CHECK_INTERVAL, SimulatedInterval, SimulatedRobot

RETREAT_SLOWNESS = 2
"""Duration of the way back from a point that was not grasped, relative to the way to it."""

TURNING_DURATIONS = (0.5, 1.0, 2.0, 4.0)
"""Times in which a limb whose path is blocked may turn back [s]: the first that torques permit."""

TORQUE_SHARE = 0.9
"""Largest share of the torque limits that turning back may take."""


class PathWatch(NamedTuple):
    """What looks ahead during a step."""

    period: float
    """Time between two looks [s]."""
    is_blocked: Callable[[Trajectory, int], bool]
    """Returns whether a trajectory is blocked after a sample, given by its index."""


class Simulation(SimulatedRobot):
    """A robot in a cabin that executes the steps of a plan."""

    def execute(
        self, trajectory: Trajectory, step: int = 0, watch: PathWatch | None = None
    ) -> SimulatedInterval:
        """Execute a regrasp: release the point, follow the trajectory, capture the next point.

        The trajectory of a step, with an index for the recording, is on the time grid of the
        simulation and begins at the present stance. If the watch, by default none, finds the path
        blocked, the limb turns back and grasps the point that it left; the failure of the interval
        is then a `"blocked path"`. Raises a `SimulationError` if the trajectory has another time
        grid or starts in another stance.
        """
        limb, point = self._moving(trajectory)
        origin = self.points[limb]
        self._grippers.detach(limb)
        return self._reach(trajectory, (origin, point), step, watch)

    def retreat(self, trajectory: Trajectory, step: int = 0) -> SimulatedInterval:
        """Go back along the last trajectory, whose point was not grasped, and grasp the one left.

        The way back takes `RETREAT_SLOWNESS` times as long, so that its loads are small. `step` is
        the index for the recording.
        """
        limb = self.points.index(FREE)
        origin, aimed = int(trajectory.grasps[0, limb]), int(trajectory.grasps[-1, limb])
        return self._reach(trajectory.backwards(RETREAT_SLOWNESS), (aimed, origin), step)

    def move(self, trajectory: Trajectory) -> SimulatedInterval:
        """Follow a trajectory on which a limb is free throughout, and release what it holds.

        It is on the time grid of the simulation.
        """
        for limb in np.flatnonzero(trajectory.grasps[0] == FREE).tolist():
            if self.points[limb] != FREE:
                self._grippers.detach(limb)
        reference = Reference.of(trajectory, self.robot, self.physics, self.controller)
        return self.run(trajectory, reference)

    def _reach(
        self,
        trajectory: Trajectory,
        ends: tuple[int, int],
        step: int,
        watch: PathWatch | None = None,
        begin: int = 0,
    ) -> SimulatedInterval:
        """Move the free limb from one point to another along a trajectory, and grasp that one.

        Samples before `begin` were followed already.
        """
        limb, (origin, point) = self.points.index(FREE), ends
        reference = Reference.of(trajectory, self.robot, self.physics, self.controller)
        if begin:
            rest = np.arange(begin, len(trajectory.times))
            trajectory, reference = trajectory.at(rest), reference.at(rest)
        elif self.controller.align_references:
            self._joint_controller.align_references(reference.positions[0])
        self._plan_step, allowed = step, ((origin,), (), (point,))
        self._guidance.start(limb, point)
        turned_at: list[int] = []

        def enter(phase: int) -> None:
            self._grippers.set_contacts(limb, allowed[phase])

        def look(sample: int) -> bool:
            if watch is not None and watch.is_blocked(trajectory, sample):
                turned_at.append(sample)
            return bool(turned_at)

        period = CHECK_INTERVAL if watch is None else self.count_time_steps(watch.period)
        runs = [self.run(trajectory, reference, enter, look=(period, look))]
        if turned_at and runs[-1].failure is None:
            back = self._turned_back(trajectory, turned_at[0])
            if back is not None:
                return self._turn_back(runs[-1], back, turned_at[0], ends)
            rest = np.arange(turned_at[0], len(trajectory.times))
            runs.append(self.run(trajectory.at(rest), reference.at(rest), enter))
        if runs[-1].failure is None and self.controller.guidance and not self._guidance.is_close:
            runs.append(self._wait_until_close(trajectory, reference))
        whole = runs[-1].after(*runs[:-1])
        failure = whole.failure or self._grasp_failure(limb, point)
        if failure is not None:
            return whole._replace(failure=failure)
        distance, angle = self.grasp_error(limb, point)
        self._grippers.attach(limb, point)
        name = self.grasp_map.ids[point]
        capture = Capture(self.time, step, limb, name, distance, angle)
        return whole._replace(capture=capture)

    def _turned_back(self, trajectory: Trajectory, sample: int) -> Trajectory | None:
        """Return the motion that turns back soon after a sample; None if the end comes before."""
        limits = TORQUE_SHARE * self.robot.torque_limits.ravel()
        slowest = None
        for duration in TURNING_DURATIONS:
            back = trajectory.turned_back(sample, RETREAT_SLOWNESS, duration)
            if back is None:
                break
            slowest = back
            reference = Reference.of(back, self.robot, self.physics, self.controller)
            if (np.abs(reference.torques[sample:]) <= limits).all():
                break
        return slowest

    def _turn_back(
        self, executed: SimulatedInterval, back: Trajectory, sample: int, ends: tuple[int, int]
    ) -> SimulatedInterval:
        """Return to the point that was left, along a trajectory that turns back at a sample."""
        (origin, point), ids, time = ends, self.grasp_map.ids, self.time
        limb, phase = self.points.index(FREE), PHASES[len(PHASES) - 1 - int(back.phase[sample])]
        returned = self._reach(back, (point, origin), self._plan_step, begin=sample)
        message = f"limb {limb} turned back on its way to point {ids[point]!r}: its path is blocked"
        blocked = Failure("blocked path", time, self._plan_step, phase, limb, message, {})
        failure = returned.failure or blocked
        whole = returned.after(executed)
        return whole._replace(capture=None, failure=failure, has_turned_back=True)

    def stand_still(
        self, trajectory: Trajectory, duration: float, step: int = 0
    ) -> SimulatedInterval:
        """Stand still for a time [s] in the stance in which the last trajectory ended.

        `step` is the index for the recording.
        """
        reference = Reference.of(trajectory, self.robot, self.physics, self.controller)
        if self.controller.align_references:
            self._joint_controller.align_references(reference.positions[-1])
        self._plan_step = step
        return self._stand_still(trajectory, reference, duration)

    def _stand_still(
        self,
        trajectory: Trajectory,
        reference: Reference,
        duration: float,
        until: Callable[[], bool] = lambda: False,
    ) -> SimulatedInterval:
        """Stay at the end of a trajectory for some time [s], or until a condition holds."""
        last = np.full(self.count_time_steps(duration) + 1, len(trajectory.times) - 1)
        return self.run(trajectory.at(last), reference.at(last, 0.0), until=until)

    def _wait_until_close(self, trajectory: Trajectory, reference: Reference) -> SimulatedInterval:
        """Stay at the end of the approach until the gripper is close, for some time at most."""
        longest = PATIENCE / self.controller.guidance
        return self._stand_still(trajectory, reference, longest, lambda: self._guidance.is_close)

    def _moving(self, trajectory: Trajectory) -> tuple[int, int]:
        """Return the limb that moves on a trajectory, and the point that it grasps."""
        if abs(trajectory.period - self.physics.timestep) > 1e-9:
            raise SimulationError(
                f"the trajectory's period is {trajectory.period:g} s; "
                f"the simulation's time step is {self.physics.timestep:g} s"
            )
        if trajectory.grasps[0].tolist() != self.points:
            raise SimulationError(
                f"the trajectory starts from points {trajectory.grasps[0].tolist()}, "
                f"the robot holds {self.points}"
            )
        moving = np.flatnonzero(trajectory.grasps[1] == FREE)
        if len(moving) != 1 or (trajectory.grasps[1:-1] != trajectory.grasps[1]).any():
            raise SimulationError("a trajectory must be that of one step, in which one limb moves")
        return int(moving[0]), int(trajectory.grasps[-1, moving[0]])

    def _grasp_failure(self, limb: int, point: int) -> Failure | None:
        """Return why a gripper cannot grasp a point, or None if it can."""
        (distance, angle), physics = self.grasp_error(limb, point), self.physics
        name, kind = self.grasp_map.ids[point], "refused grasp"
        message = f"limb {limb} reached point {name!r}, which refused it"
        if not can_capture(physics, distance, angle):
            kind = "missed grasp"
            message = (
                f"limb {limb} missed point {name!r} by {1e3 * distance:.1f} mm "
                f"and {np.rad2deg(angle):.2f} deg; it grasps within "
                f"{1e3 * physics.capture_distance:g} mm and "
                f"{np.rad2deg(physics.capture_angle):g} deg"
            )
        elif not self.refuses(point):
            return None
        values = {
            "distance_m": distance, "allowed_distance_m": physics.capture_distance,
            "angle_rad": angle, "allowed_angle_rad": physics.capture_angle,
        }  # fmt: skip
        return Failure(kind, self.time, self._plan_step, PHASES[-1], limb, message, values)
