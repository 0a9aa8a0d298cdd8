"""Regrasps in MuJoCo: a limb releases a point, follows a trajectory and captures the next point.

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
from mlivr_gym.motion.joint_path import PHASES
from mlivr_gym.motion.trajectory import FREE, Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import OrNone
from mlivr_gym.simulation.disturbances import Disturbance, DisturbanceRanges
from mlivr_gym.simulation.dynamics import SimulatedRobot, dynamics_spec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.grippers import PATIENCE, Grippers, Guidance
from mlivr_gym.simulation.instruments import FailureMonitor, Instruments, with_contact_names
from mlivr_gym.simulation.inverse_dynamics import robot_model
from mlivr_gym.simulation.joint_controller import JointController, Reference
from mlivr_gym.simulation.parameters import ControllerParameters, Physics
from mlivr_gym.simulation.recording import Capture, Failure, SimulatedInterval
from mlivr_gym.simulation.scene import compile_spec, set_configuration
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

CHECK_INTERVAL = 500
"""Number of time steps between two checks for failures; each check covers every time step."""

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


class Simulation:
    """A robot in a cabin, with its dynamic state, that executes the steps of a plan.

    The simulation moves the anchors of `model` and changes its contact bits as limbs grasp and
    release. The controller knows neither the `disturbance` nor the points that are `refusing` all
    grippers.
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
        spec = dynamics_spec(grasp_map, robot, self.physics, obstacles)
        for site in spec.worldbody.sites:
            spec.delete(site)  # graspable points, whose frames MuJoCo would set at each time step
        self.model = model = compile_spec(spec)
        self.disturbance = disturbance or DisturbanceRanges().draw(
            0, robot_model(robot).nbody - 1, robot.limbs, len(grasp_map)
        )
        self.disturbance.apply(model)
        self.data = mujoco.MjData(model)
        self._time_steps, self._plan_step = 0, 0
        self.refusing: frozenset[int] = frozenset()
        self._rng = np.random.default_rng([self.disturbance.seed, 4])
        self._instruments = Instruments(model, robot.limbs)
        simulated = SimulatedRobot(
            model, self.data, robot, self.physics, self.controller, self.disturbance
        )
        self._grippers = Grippers(simulated, grasp_map, (*grasp_map.boxes, *obstacles))
        self._joint_controller = JointController(simulated)
        self._guidance = Guidance(simulated, self._grippers, self._joint_controller)

    @property
    def time(self) -> float:
        """Time since the reset [s]."""
        return self._time_steps * self.physics.timestep

    @property
    def points(self) -> list[int]:
        """Index of the point that each limb holds, or `FREE`."""
        return self._grippers.points

    @property
    def configuration(self) -> tuple[Array, Array, Array]:
        """Base position [m], base quaternion w, x, y, z, and joint angles (N, 6) [rad]."""
        base = self.data.qpos[:7].copy()
        return base[:3], base[3:], self.data.qpos[7:].reshape(-1, 6).copy()

    def reset(
        self, position: Array, quaternion: Array, joints: Array, points: Sequence[int]
    ) -> None:
        """Put the robot at rest into a stance, whose points move to their positions in the map.

        The base has a position (3,) [m] and quaternion w, x, y, z in the world, joint angles have
        shape (N, 6) [rad]; `points` are the indices of the points that limbs hold, or `FREE`.
        Raises a `SimulationError` if a gripper is not at its point.
        """
        mujoco.mj_resetData(self.model, self.data)
        self._time_steps = 0
        set_configuration(self.model, self.data, position, quaternion, joints)
        self._grippers.reset()
        self._joint_controller.reset()
        for limb, point in enumerate(points):
            if point != FREE:
                self._grippers.reset_point(point)
                distance, angle = self._grippers.error(limb, point)
                if not self.physics.captures(distance, angle):
                    raise SimulationError(
                        f"limb {limb} is {1e3 * distance:.1f} mm and {np.rad2deg(angle):.2f} deg "
                        f"from point {self.grasp_map.ids[point]!r} and cannot hold it"
                    )
                self._grippers.attach(limb, point)
                self._grippers.set_contacts(limb, point)
        mujoco.mj_forward(self.model, self.data)

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
        origin, self._plan_step = self.points[limb], step
        self._grippers.detach(limb)
        self._guidance.start(limb, point)
        return self._reach(trajectory, (origin, point), watch)

    def retreat(self, trajectory: Trajectory, step: int = 0) -> SimulatedInterval:
        """Go back along the last trajectory, whose point was not grasped, and grasp the one left.

        The way back takes `RETREAT_SLOWNESS` times as long, so that its loads are small. `step` is
        the index for the recording.
        """
        limb, self._plan_step = self.points.index(FREE), step
        origin, aimed = int(trajectory.grasps[0, limb]), int(trajectory.grasps[-1, limb])
        self._guidance.start(limb, origin)
        return self._reach(trajectory.backwards(RETREAT_SLOWNESS), (aimed, origin))

    def move(self, trajectory: Trajectory) -> SimulatedInterval:
        """Follow a trajectory on which a limb is free throughout, and release what it holds.

        It is on the time grid of the simulation.
        """
        for limb in np.flatnonzero(trajectory.grasps[0] == FREE).tolist():
            self._grippers.detach(limb)
        return self._run(trajectory, self._reference(trajectory))[0]

    def stand_still(
        self, trajectory: Trajectory, duration: float, step: int = 0
    ) -> SimulatedInterval:
        """Stand still for a time [s] in the stance in which the last trajectory ended.

        `step` is the index for the recording.
        """
        reference, self._plan_step = self._reference(trajectory), step
        if self.controller.align_references:
            self._joint_controller.align_references(reference.positions[-1])
        return self._stay(trajectory, reference, duration)

    def refuses(self, point: int) -> bool:
        """Return whether an attempt to grasp a point fails although the gripper is at it."""
        chance = self.disturbance.ranges.refusal
        return point in self.refusing or (chance > 0.0 and self._rng.uniform() < chance)

    def _reference(self, trajectory: Trajectory) -> Reference:
        """Return the reference of the controller along a trajectory."""
        return Reference.of(trajectory, self.robot, self.physics, self.controller)

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

    def _reach(
        self,
        trajectory: Trajectory,
        ends: tuple[int, int],
        watch: PathWatch | None = None,
        begin: int = 0,
    ) -> SimulatedInterval:
        """Move the free limb from one point to another along a trajectory, and grasp that one.

        Samples before `begin` were followed already.
        """
        limb, point, reference = self.points.index(FREE), ends[1], self._reference(trajectory)
        if begin == 0 and self.controller.align_references:
            self._joint_controller.align_references(reference.positions[0])
        executed, last = self._run(trajectory, reference, begin, ends, watch)
        if executed.failure is None and last < len(trajectory.times) - 1:
            return self._turn_back(trajectory, ends, last).after(executed)
        guided = self.controller.guidance
        if executed.failure is None and guided and not self._guidance.is_close:
            waited = self._stay(trajectory, reference, PATIENCE / guided, until_close=True)
            executed = waited.after(executed)
        if executed.failure is not None:
            return executed
        mujoco.mj_forward(self.model, self.data)
        distance, angle = self._grippers.error(limb, point)
        failure = self._grasp_failure(limb, point, distance, angle)
        if failure is not None:
            return executed._replace(failure=failure)
        self._grippers.attach(limb, point)
        name = self.grasp_map.ids[point]
        capture = Capture(self.time, self._plan_step, limb, name, distance, angle)
        return executed._replace(captures=(capture,))

    def _turn_back(
        self, trajectory: Trajectory, ends: tuple[int, int], sample: int
    ) -> SimulatedInterval:
        """Return to the point that was left, after a sample of a trajectory that is blocked.

        If the end of the trajectory comes before the limb could turn, it goes on to that.
        """
        limits, slowest = TORQUE_SHARE * self.robot.torque_limits.ravel(), None
        for duration in TURNING_DURATIONS:
            back = trajectory.turned_back(sample, RETREAT_SLOWNESS, duration)
            if back is None:
                break
            slowest = back
            if (np.abs(self._reference(back).torques[sample:]) <= limits).all():
                break
        if slowest is None:
            return self._reach(trajectory, ends, begin=sample)
        (origin, point), limb, step = ends, self.points.index(FREE), self._plan_step
        phase = PHASES[len(PHASES) - 1 - int(slowest.phase[sample])]
        name = self.grasp_map.ids[point]
        message = f"limb {limb} turned back on its way to point {name!r}: its path is blocked"
        blocked = Failure("blocked path", self.time, step, phase, limb, message, {})
        self._guidance.start(limb, origin)
        returned = self._reach(slowest, (point, origin), begin=sample)
        failure = returned.failure or blocked
        return returned._replace(captures=(), failure=failure, has_turned_back=True)

    def _grasp_failure(
        self, limb: int, point: int, distance: float, angle: float
    ) -> Failure | None:
        """Return why a gripper at this distance and angle cannot grasp a point, or None."""
        physics, name, kind = self.physics, self.grasp_map.ids[point], "refused grasp"
        message = f"limb {limb} reached point {name!r}, which refused it"
        if not physics.captures(distance, angle):
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

    def _stay(
        self,
        trajectory: Trajectory,
        reference: Reference,
        duration: float,
        until_close: bool = False,
    ) -> SimulatedInterval:
        """Stay at the end of a trajectory for some time [s], or until the gripper is close."""
        last = np.full(self.physics.time_steps(duration) + 1, len(trajectory.times) - 1)
        rest = trajectory.at(last), reference.at(last, 0.0)
        return self._run(*rest, until_close=until_close)[0]

    def _run(
        self,
        trajectory: Trajectory,
        reference: Reference,
        begin: int = 0,
        ends: tuple[int, int] | None = None,
        watch: PathWatch | None = None,
        *,
        until_close: bool = False,
    ) -> tuple[SimulatedInterval, int]:
        """Simulate from a sample until the end or the first failure; nothing is grasped.

        Returned are the measurements, and the sample that was reached: an earlier one than the last
        if `watch` found the path blocked, or the gripper is close. A gripper that moves between two
        `ends` may touch what lies behind them on departure and approach.
        """
        parts, last, model = list[SimulatedInterval](), begin, self.model
        monitor = FailureMonitor(self.physics, self.robot)
        every = CHECK_INTERVAL if watch is None else self.physics.time_steps(watch.period)
        for first, last in _check_intervals(trajectory.phase, begin, min(every, CHECK_INTERVAL)):
            phase = int(trajectory.phase[first + 1])
            if ends is not None:
                limb, point = self.points.index(FREE), (ends[0], FREE, ends[1])[phase]
                self._grippers.set_contacts(limb, point)
            states, sensors = self._follow(trajectory, reference, (first, last), until_close)
            measured, finite = self._instruments.measure(
                states, sensors, trajectory, first, self._time_steps, self._plan_step
            )
            failed = monitor.first_failure(measured, finite)
            if failed is not None:
                index, failure = failed
                self._time_steps += index
                self.data.time = states[index, 0]
                self.data.qpos[:], self.data.qvel[:] = np.split(states[index, 1:], [model.nq])
                mujoco.mj_forward(model, self.data)
                failure = with_contact_names(failure, model, self.data)
                recorded = self._instruments.recorded(measured.part(slice(index + 1)))
                parts.append(SimulatedInterval(*recorded, failure=failure))
                break
            self._time_steps += len(states)
            parts.append(SimulatedInterval(*self._instruments.recorded(measured)))
            if until_close and self._guidance.is_close:
                break
            if watch is not None and watch.is_blocked(trajectory, last):
                break
        return parts[-1].after(*parts[:-1]), last

    def _follow(
        self,
        trajectory: Trajectory,
        reference: Reference,
        interval: tuple[int, int],
        until_close: bool,
    ) -> tuple[Array, Array]:
        """Simulate an interval of a phase, guided during an approach; see `JointController.run`."""
        phase, (first, last) = PHASES[trajectory.phase[interval[0] + 1]], interval
        held, free = [point != FREE for point in self.points], FREE in self.points
        guides = self.controller.guidance > 0.0 and phase == "approach" and free
        recovering = free and phase != "approach"
        period = self.physics.time_steps(self.controller.sensor_period) if guides else last - first
        followed = []
        for start in range(first, last, period):
            stop = min(start + period, last)
            part = reference.at(np.arange(start, stop))
            followed.append(self._joint_controller.run(part, held, recovering))
            if guides:
                mujoco.mj_kinematics(self.model, self.data)
                mujoco.mj_comPos(self.model, self.data)
                self._guidance.correct(trajectory, stop)
            if until_close and self._guidance.is_close:
                break
        states, sensors = zip(*followed, strict=True)
        return np.concatenate(states), np.concatenate(sensors)


def _check_intervals(phase: IntArray, begin: int, most: int) -> Iterator[tuple[int, int]]:
    """Yield first and last sample of intervals within a phase, each of `most` time steps."""
    changes = np.flatnonzero(np.diff(phase[begin + 1 :])) + begin + 1
    for start, stop in pairwise([begin, *changes.tolist(), len(phase) - 1]):
        for first in range(start, stop, most):
            yield first, min(first + most, stop)
