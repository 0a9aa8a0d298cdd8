"""Execution of trajectories in MuJoCo.

The controller reads encoders and commands torques at its own rate. The simulation runs up to
`CHECK_INTERVAL` time steps, finds the first failure among them, and returns to the time step at
which it occurs, which ends the walk.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import SimulationError
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.regrasp import PHASES
from mlivr_gym.motion.trajectory import FREE, Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import OrNone
from mlivr_gym.simulation.controller import ControllerParameters
from mlivr_gym.simulation.disturbances import NONE, Disturbance
from mlivr_gym.simulation.dynamics import Physics, dynamics_spec
from mlivr_gym.simulation.failures import FailureMonitor, grasp_failure, with_contact_names
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.grippers import Grippers, can_capture
from mlivr_gym.simulation.guidance import Guidance
from mlivr_gym.simulation.instruments import Instruments
from mlivr_gym.simulation.inverse_dynamics import robot_model
from mlivr_gym.simulation.joint_controller import JointController, Reference
from mlivr_gym.simulation.recording import Capture, Failure, Peaks, Recording
from mlivr_gym.simulation.scene import compile_spec, set_configuration
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

RETREAT_SLOWNESS = 2
"""Duration of the way back from a point that was not grasped, relative to the way to it."""

TURNING_DURATIONS = (0.5, 1.0, 2.0, 4.0)
"""Times in which a limb whose path is blocked may turn back [s]: the first that torques permit."""

TORQUE_SHARE = 0.9
"""Largest share of the torque limits that turning back may take."""

CHECK_INTERVAL = 500
"""Number of time steps between two checks for failures; each check covers every time step."""


class PathWatch(NamedTuple):
    """What looks ahead during a step."""

    period: float
    """Time between two looks [s]."""
    is_blocked: Callable[[Trajectory, int], bool]
    """Returns whether a trajectory is blocked after a sample, given by its index."""


class SimulatedInterval(NamedTuple):
    """Measurements of an interval of the simulation: a regrasp, or a time of standing still."""

    recording: Recording
    """Samples of the measurements."""
    peaks: Peaks
    """Maxima over all time steps."""
    capture: Capture | None
    """The capture of the point; None if it was not captured."""
    failure: Failure | None
    """The failure of the step, or None."""


class Simulation:
    """A robot in a cabin, with its dynamic state.

    Attributes
    ----------
    model
        The MuJoCo model; the simulation moves its anchors and changes its contact bits as
        limbs grasp and release.
    data
        The MuJoCo data.
    physics
        Parameters of grasps and failures.
    controller
        Parameters of the joint controller.
    disturbance
        Difference between the simulated robot and module and the model of the controller.
    time
        Time since the reset [s].
    mass
        Mass of the robot [kg].
    refusing
        Indices of points that no gripper can grasp, which the controller does not know.
    """

    @checked(
        {
            **ARGUMENTS,
            "physics": OrNone(InstanceOf(Physics)),
            "controller": OrNone(InstanceOf(ControllerParameters)),
            "disturbance": OrNone(InstanceOf(Disturbance)),
        }
    )
    def __init__(
        self,
        grasp_map: GraspMap,
        robot: RobotSpec,
        physics: Physics | None = None,
        obstacles: Sequence[Box] = (),
        controller: ControllerParameters | None = None,
        disturbance: Disturbance | None = None,
    ) -> None:
        """Compile the model."""
        self.grasp_map, self.robot, self.physics = grasp_map, robot, physics or Physics()
        self.controller = controller or ControllerParameters()
        self.model = compile_spec(dynamics_spec(grasp_map, robot, self.physics, obstacles))
        self.disturbance = disturbance or NONE.draw(
            0, robot_model(robot).nbody - 1, robot.limbs, len(grasp_map)
        )
        self.disturbance.apply(self.model)
        self.data = mujoco.MjData(self.model)
        self.time, self._time_steps, self._plan_step = 0.0, 0, 0
        self.refusing: frozenset[int] = frozenset()
        self._instruments = Instruments(self.model, robot.limbs)
        self.mass = self._instruments.mass
        model, data = self.model, self.data
        self._grippers = Grippers(
            model, data, grasp_map, robot, self.disturbance, (*grasp_map.boxes, *obstacles)
        )
        self._joint_controller = JointController(model, data, self.controller, self.disturbance)
        self._guidance = Guidance(
            robot, self.controller, self.disturbance, self._grippers, self._joint_controller
        )

    @property
    def points(self) -> list[int]:
        """Index of the point that each limb holds, or `FREE`."""
        return self._grippers.points

    def reset(
        self, position: Array, quaternion: Array, joints: Array, points: Sequence[int]
    ) -> None:
        """Put the robot at rest into a stance, whose points move to their positions in the map.

        Parameters
        ----------
        position
            Base position in the world, shape (3,) [m].
        quaternion
            Base orientation in the world w, x, y, z, shape (4,).
        joints
            Joint angles, shape (N, 6) [rad].
        points
            Index of the point that each limb holds, or `FREE`.

        Raises
        ------
        SimulationError
            If a gripper is not at its point.
        """
        mujoco.mj_resetData(self.model, self.data)
        self._time_steps, self.time = 0, 0.0
        set_configuration(self.model, self.data, position, quaternion, joints)
        self._grippers.reset()
        self._joint_controller.reset()
        for limb, point in enumerate(points):
            if point != FREE:
                self._grippers.reset_point(point)
                distance, angle = self._grippers.error(limb, point)
                if not can_capture(self.physics, distance, angle):
                    raise SimulationError(
                        f"limb {limb} is {1e3 * distance:.1f} mm and {np.rad2deg(angle):.2f} deg "
                        f"from point {self.grasp_map.ids[point]!r} and cannot hold it"
                    )
                self._grippers.attach(limb, point)
                self._grippers.set_contacts(limb, (point,))
        mujoco.mj_forward(self.model, self.data)

    @property
    def configuration(self) -> tuple[Array, Array, Array]:
        """Base position [m], base quaternion w, x, y, z, and joint angles (N, 6) [rad]."""
        base = self.data.qpos[:7].copy()
        return base[:3], base[3:], self.data.qpos[7:].reshape(-1, 6).copy()

    def grasp_error(self, limb: int, point: int) -> tuple[float, float]:
        """Return distance [m] and angle [rad] between a gripper and its grasp on a point."""
        mujoco.mj_forward(self.model, self.data)
        return self._grippers.error(limb, point)

    def execute(
        self, trajectory: Trajectory, step: int = 0, watch: PathWatch | None = None
    ) -> SimulatedInterval:
        """Execute a regrasp: release the point, follow the trajectory, capture the next point.

        If the watch finds the path blocked, the limb turns back and grasps the point that it left;
        the failure of the interval is then a `"blocked path"`.

        Parameters
        ----------
        trajectory
            Trajectory of one step on the time grid of the simulation, from the present stance.
        step
            Index of the step, for the recording.
        watch
            What looks ahead; by default nothing.

        Raises
        ------
        SimulationError
            If the trajectory has another time grid or starts in another stance.
        """
        limb, point = self._moving(trajectory)
        origin = self.points[limb]
        self._grippers.detach(limb)
        return self._reach(trajectory, (origin, point), step, watch)

    def retreat(self, trajectory: Trajectory, step: int = 0) -> SimulatedInterval:
        """Go back along a trajectory whose point was not grasped, and grasp the point it left.

        The way back takes `RETREAT_SLOWNESS` times as long, so that its loads are small.

        Parameters
        ----------
        trajectory
            The trajectory that was executed last.
        step
            Index of the step, for the recording.
        """
        limb = self.points.index(FREE)
        origin, aimed = int(trajectory.grasps[0, limb]), int(trajectory.grasps[-1, limb])
        return self._reach(trajectory.backwards(RETREAT_SLOWNESS), (aimed, origin), step)

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

        period = CHECK_INTERVAL if watch is None else self._count_time_steps(watch.period)
        runs, attempts = [self._run(trajectory, reference, enter, look=(period, look))], 1
        if turned_at and runs[-1].failure is None:
            back = self._turned_back(trajectory, turned_at[0])
            if back is not None:
                return self._turn_back(runs[-1], back, turned_at[0], ends)
            rest = np.arange(turned_at[0], len(trajectory.times))
            runs.append(self._run(trajectory.at(rest), reference.at(rest), enter))
        while runs[-1].failure is None:
            runs += self._wait_until_close(trajectory, reference)
            captured = can_capture(self.physics, *self.grasp_error(limb, point))
            sure = captured and (self._guidance.is_close or not self.controller.guided)
            if sure or attempts == self.controller.attempts or runs[-1].failure is not None:
                break
            attempts += 1
            runs += self._repeat_approach(trajectory, reference)
        recording = Recording.join([run.recording for run in runs])
        peaks, failure = Peaks.join([run.peaks for run in runs]), runs[-1].failure
        failure = failure or self._grasp_failure(limb, point)
        if failure is not None:
            return SimulatedInterval(recording, peaks, None, failure)
        distance, angle = self.grasp_error(limb, point)
        self._grippers.attach(limb, point)
        name = self.grasp_map.ids[point]
        capture = Capture(self.time, step, limb, name, distance, angle, attempts)
        return SimulatedInterval(recording, peaks, capture, None)

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
        message = f"limb {limb} turned back on its way to point {ids[point]!r}, which is blocked"
        blocked = Failure("blocked path", time, self._plan_step, phase, limb, message, {})
        return SimulatedInterval(
            Recording.join([executed.recording, returned.recording]),
            Peaks.join([executed.peaks, returned.peaks]),
            None,
            returned.failure or blocked,
        )

    def stand_still(
        self, trajectory: Trajectory, duration: float, step: int = 0
    ) -> SimulatedInterval:
        """Stand still in the stance in which a trajectory ended.

        Parameters
        ----------
        trajectory
            The trajectory that was executed last.
        duration
            Duration [s].
        step
            Index of the step, for the recording.
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
        last = np.full(self._count_time_steps(duration) + 1, len(trajectory.times) - 1)
        return self._run(trajectory.at(last), reference.at(last, 0.0), until=until)

    def _wait_until_close(
        self, trajectory: Trajectory, reference: Reference
    ) -> list[SimulatedInterval]:
        """Stay at the end of the approach until the gripper is close, or patience ends."""
        if not self.controller.guided or self._guidance.is_close:
            return []
        patience = self.controller.patience
        return [self._stand_still(trajectory, reference, patience, lambda: self._guidance.is_close)]

    def _repeat_approach(
        self, trajectory: Trajectory, reference: Reference
    ) -> list[SimulatedInterval]:
        """Move back above the point and approach it again."""
        approach = np.flatnonzero(trajectory.phase == len(PHASES) - 1)
        back = approach[::-1]
        runs = [self._run(trajectory.at(back), reference.at(back, -1.0))]
        if runs[-1].failure is None:
            runs.append(self._run(trajectory.at(approach), reference.at(approach)))
        return runs

    def _run(
        self,
        trajectory: Trajectory,
        reference: Reference,
        enter: Callable[[int], None] = lambda _: None,
        until: Callable[[], bool] = lambda: False,
        look: tuple[int, Callable[[int], bool]] = (CHECK_INTERVAL, lambda _: False),
    ) -> SimulatedInterval:
        """Simulate until the end, the first failure, or the condition `until`; nothing is grasped.

        `enter` is called with the index of the phase before each interval. `look` has a number of
        time steps, and a function that is called so often with the sample reached; the simulation
        ends if it returns True.
        """
        recordings, peaks, failure = [], [], None
        monitor = FailureMonitor(self.physics, self.robot, self._plan_step)
        count, most = len(trajectory.times) - 1, min(CHECK_INTERVAL, look[0])
        for first, last in _check_intervals(trajectory.phase, count, most):
            phase = int(trajectory.phase[first + 1])
            enter(phase)
            held = [point != FREE for point in self.points]
            states, sensors = self._follow(trajectory, reference, (first, last), until)
            measurements = self._instruments.measure(
                states, sensors, trajectory, first, self._time_steps, self._plan_step
            )
            self._time_steps += len(states)
            self.time = self._time_steps * self.physics.timestep
            failed = monitor.first_failure(measurements, PHASES[phase], held)
            ended = len(states) if failed is None else failed[0] + 1
            recorded, largest = self._instruments.recorded(measurements, ended)
            recordings.append(recorded)
            peaks.append(largest)
            if failed is not None:
                self._restore(states[failed[0]], failed[1].time)
                failure = with_contact_names(failed[1], self.model, self.data)
            if failed is not None or until() or look[1](last):
                break
        return SimulatedInterval(Recording.join(recordings), Peaks.join(peaks), None, failure)

    def _follow(
        self,
        trajectory: Trajectory,
        reference: Reference,
        interval: tuple[int, int],
        until: Callable[[], bool],
    ) -> tuple[Array, Array]:
        """Simulate an interval of a phase, guided during an approach; see `JointController.run`."""
        phase, (first, last) = PHASES[trajectory.phase[interval[0] + 1]], interval
        held, free = [point != FREE for point in self.points], FREE in self.points
        guides = self.controller.guided and phase == "approach" and free
        period = self._count_time_steps(self.controller.sensor_period) if guides else last - first
        followed = []
        for start in range(first, last, period):
            here = np.arange(start, min(start + period, last))
            recovering = free and phase != "approach"
            followed.append(self._joint_controller.run(reference.at(here), held, recovering))
            if guides:
                mujoco.mj_forward(self.model, self.data)
                self._guidance.correct(trajectory, int(here[-1]) + 1)
            if until():
                break
        states, sensors = zip(*followed, strict=True)
        return np.concatenate(states), np.concatenate(sensors)

    def _count_time_steps(self, duration: float) -> int:
        """Return the number of time steps in a duration [s], at least one."""
        return max(round(duration / self.physics.timestep), 1)

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

    def _restore(self, state: Array, time: float) -> None:
        """Set positions and velocities, and nothing else, back to a state at a time [s]."""
        self.time, self._time_steps = time, round(time / self.physics.timestep)
        self.data.time = state[0]
        self.data.qpos[:], self.data.qvel[:] = np.split(state[1:], [self.model.nq])
        mujoco.mj_forward(self.model, self.data)

    def _grasp_failure(self, limb: int, point: int) -> Failure | None:
        """Return why a gripper cannot grasp a point, or None if it can."""
        error, name = self.grasp_error(limb, point), self.grasp_map.ids[point]
        found = grasp_failure(self.physics, limb, name, error, point in self.refusing)
        if found is None:
            return None
        kind, message, values = found
        return Failure(kind, self.time, self._plan_step, PHASES[-1], limb, message, values)


def _check_intervals(phase: IntArray, count: int, most: int) -> Iterator[tuple[int, int]]:
    """Yield first and last time step of intervals within a phase, each of `most` time steps."""
    edges = [0, *(np.flatnonzero(np.diff(phase[1 : count + 1])) + 1).tolist(), count]
    for start, stop in pairwise(edges):
        for first in range(start, stop, most):
            yield first, min(first + most, stop)
