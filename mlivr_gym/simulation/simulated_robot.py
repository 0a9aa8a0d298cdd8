"""A robot in MuJoCo that follows references, observed at every time step.

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
from mlivr_gym.simulation.controller import ControllerParameters
from mlivr_gym.simulation.disturbances import NONE, Disturbance
from mlivr_gym.simulation.dynamics import Physics, dynamics_spec
from mlivr_gym.simulation.failures import FailureMonitor, with_contact_names
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

CHECK_INTERVAL = 500
"""Number of time steps between two checks for failures; each check covers every time step."""


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
    has_turned_back: bool = False
    """Whether the limb turned back, since its path was blocked; the failure may be on its way."""

    def after(self, *before: SimulatedInterval) -> SimulatedInterval:
        """Return this interval with the measurements of those before it in front of its own."""
        parts = (*before, self)
        return self._replace(
            recording=Recording.join([part.recording for part in parts]),
            peaks=Peaks.join([part.peaks for part in parts]),
        )


class SimulatedRobot:
    """A robot in a cabin, with its dynamic state; `Simulation` moves its limbs.

    The simulation moves the anchors of `model` and changes its contact bits as limbs grasp and
    release. `time` is that since the reset [s], `mass` that of the robot [kg]. The controller knows
    neither the `disturbance` nor the points that are `refusing` all grippers.
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
        self.model = compile_spec(spec)
        self.disturbance = disturbance or NONE.draw(
            0, robot_model(robot).nbody - 1, robot.limbs, len(grasp_map)
        )
        self.disturbance.apply(self.model)
        self.data = mujoco.MjData(self.model)
        self.time, self._time_steps, self._plan_step = 0.0, 0, 0
        self.refusing: frozenset[int] = frozenset()
        self._rng = np.random.default_rng([self.disturbance.seed, 4])
        self._instruments = Instruments(self.model, robot.limbs)
        self.mass = self._instruments.mass
        model, data = self.model, self.data
        self._grippers = Grippers(
            model, data, grasp_map, robot, self.disturbance, (*grasp_map.boxes, *obstacles)
        )
        self._joint_controller = JointController(
            model, data, robot, self.controller, self.disturbance, self.physics
        )
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

        The base has a position (3,) [m] and quaternion w, x, y, z in the world, joint angles have
        shape (N, 6) [rad]; `points` are the indices of the points that limbs hold, or `FREE`.
        Raises a `SimulationError` if a gripper is not at its point.
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

    def refuses(self, point: int) -> bool:
        """Return whether an attempt to grasp a point fails although the gripper is at it."""
        chance = self.disturbance.ranges.refusal
        return point in self.refusing or (chance > 0.0 and self._rng.uniform() < chance)

    def grasp_error(self, limb: int, point: int) -> tuple[float, float]:
        """Return distance [m] and angle [rad] between a gripper and its grasp on a point."""
        mujoco.mj_forward(self.model, self.data)
        return self._grippers.error(limb, point)

    def run(
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
        guides = self.controller.guidance > 0.0 and phase == "approach" and free
        period = self.count_time_steps(self.controller.sensor_period) if guides else last - first
        followed = []
        for start in range(first, last, period):
            stop = min(start + period, last)
            recovering = free and phase != "approach"
            followed.append(
                self._joint_controller.run(reference.at(np.arange(start, stop)), held, recovering)
            )
            if guides:
                mujoco.mj_kinematics(self.model, self.data)
                mujoco.mj_comPos(self.model, self.data)
                self._guidance.correct(trajectory, stop)
            if until():
                break
        states, sensors = zip(*followed, strict=True)
        return np.concatenate(states), np.concatenate(sensors)

    def count_time_steps(self, duration: float) -> int:
        """Return the number of time steps in a duration [s], at least one."""
        return max(round(duration / self.physics.timestep), 1)

    def _restore(self, state: Array, time: float) -> None:
        """Set positions and velocities, and nothing else, back to a state at a time [s]."""
        self.time, self._time_steps = time, round(time / self.physics.timestep)
        self.data.time = state[0]
        self.data.qpos[:], self.data.qvel[:] = np.split(state[1:], [self.model.nq])
        mujoco.mj_forward(self.model, self.data)


def _check_intervals(phase: IntArray, count: int, most: int) -> Iterator[tuple[int, int]]:
    """Yield first and last time step of intervals within a phase, each of `most` time steps."""
    edges = [0, *(np.flatnonzero(np.diff(phase[1 : count + 1])) + 1).tolist(), count]
    for start, stop in pairwise(edges):
        for first in range(start, stop, most):
            yield first, min(first + most, stop)
