"""Executes trajectories in MuJoCo.

One phase after the other runs in MuJoCo's own loop (`mujoco.rollout`): its controls are known
beforehand and everything that is measured is a sensor or part of the state, so no Python runs
between time steps. Afterwards every time step is looked at; a failure ends the walk at the very
step at which it showed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import mujoco
import mujoco.rollout
import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.against_boxes import FLUSH
from mlivr_gym.errors import SimulationError
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.motion.regrasp import PHASES
from mlivr_gym.motion.trajectory import FREE, Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.dynamics import Physics, dynamics_spec, gripper_bit
from mlivr_gym.simulation.failures import FailureWatch
from mlivr_gym.simulation.feedforward import feedforward
from mlivr_gym.simulation.instruments import Instruments, joint_names
from mlivr_gym.simulation.recording import Capture, Failure, Peaks, Recording
from mlivr_gym.simulation.scene import compiled, set_configuration
from mlivr_gym.world.boxes import BOX, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

CHUNK = 500
"""Time steps between two looks for failures; a failure is found at its very step all the same."""

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""Half a turn about the normal, under which a grasp is symmetric."""

STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


class ExecutedStep(NamedTuple):
    """What came of a regrasp."""

    recording: Recording
    """Samples of what was measured."""
    peaks: Peaks
    """Largest values at any time step."""
    capture: Capture | None
    """How the limb grasped its point; None if it did not."""
    failure: Failure | None
    """Why the step failed; None if it did not."""


class Simulation:
    """A robot in a cabin, with its state.

    Attributes:
        model: The MuJoCo model; the simulation moves its anchors and changes its contact bits as
            the robot grasps.
        data: Its data.
        physics: Figures of controller, grasps and failures.
        time: Time since the reset [s].
        mass: Mass of the robot [kg].
        points: Point index each limb holds, or `FREE`.
        joint_actuators: Indices of the joints' actuators, limb by limb, shape (6 N,).
    """

    def __init__(
        self,
        grasp_map: GraspMap,
        robot: RobotSpec,
        physics: Physics | None = None,
        obstacles: Sequence[Box] = (),
    ) -> None:
        """Compile the model."""
        self.grasp_map, self.robot, self.physics = grasp_map, robot, physics or Physics()
        self.model = compiled(dynamics_spec(grasp_map, robot, self.physics, obstacles))
        self.data = mujoco.MjData(self.model)
        self.time = 0.0
        self._steps = 0
        rails = grasp_map.rotations[:, :, 0]
        grasps = grasp_rows(grasp_map.positions, grasp_map.normals, rails, robot.tool_length)
        self._tools: Array = grasps["flange"]["rotation"]
        model = self.model
        self._instruments = Instruments(model, robot.limbs)
        self.mass = self._instruments.mass
        names = joint_names(robot.limbs)
        self.joint_actuators: IntArray = np.array([model.actuator(name).id for name in names])
        self._anchors = [model.body(f"limb{i}/anchor").id for i in range(robot.limbs)]
        boxes = (*grasp_map.boxes, *obstacles)
        self._boxes = np.array(
            [model.geom(scene_name(BOX, box.id)).id for box in boxes], dtype=np.int64
        )
        self._centres = np.array([box.centre for box in boxes]).reshape(-1, 3)
        self._halves = np.array([box.half for box in boxes]).reshape(-1, 3)
        self._axes = np.array([box.rotation for box in boxes]).reshape(-1, 3, 3)
        self._met = model.geom_contype.copy()
        self.points: list[int] = [FREE] * robot.limbs

    def reset(
        self, position: Array, quaternion: Array, joints: Array, points: Sequence[int]
    ) -> None:
        """Put the robot at rest into a stance.

        Args:
            position: Base position [m], shape (3,).
            quaternion: Base orientation w, x, y, z.
            joints: Joint angles [rad], shape (N, 6).
            points: Point index each limb holds, or `FREE`.

        Raises:
            SimulationError: If a gripper is not at its point.
        """
        mujoco.mj_resetData(self.model, self.data)
        self._steps, self.time = 0, 0.0
        set_configuration(self.model, self.data, position, quaternion, joints)
        self.model.geom_contype[:] = self._met
        for limb, point in enumerate(points):
            self._release(limb)
            if point != FREE:
                distance, angle = self.grasp_error(limb, point)
                if not self._within_reach(distance, angle):
                    raise SimulationError(
                        f"limb {limb} is {1e3 * distance:.1f} mm and {np.rad2deg(angle):.2f} deg "
                        f"from point {self.grasp_map.ids[point]!r} and cannot hold it"
                    )
                self._grasp(limb, point)
                self._meets(limb, (point,))
        mujoco.mj_forward(self.model, self.data)

    @property
    def configuration(self) -> tuple[Array, Array, Array]:
        """Base position [m], base quaternion w, x, y, z, and joint angles (N, 6) [rad]."""
        first = self._instruments.base
        base = self.data.qpos[first : first + 7].copy()
        return base[:3], base[3:], self.data.qpos[self._instruments.joints].reshape(-1, 6)

    def execute(self, trajectory: Trajectory, step: int = 0) -> ExecutedStep:
        """Execute a regrasp: release, follow the trajectory, grasp.

        Args:
            trajectory: One step on the time grid of the simulation, from the stance that the robot
                holds.
            step: Index of the step, for the record.

        Raises:
            SimulationError: If the trajectory's time grid or first stance is another.
        """
        limb, to_point = self._moving(trajectory)
        touched: tuple[tuple[int, ...], ...] = ((self.points[limb],), (), (to_point,))
        self._release(limb)
        recording, peaks, failure = self._run(
            trajectory,
            self._control(trajectory),
            step,
            lambda phase: self._meets(limb, touched[phase]),
        )
        if failure is not None:
            return ExecutedStep(recording, peaks, None, failure)
        distance, angle = self.grasp_error(limb, to_point)
        if not self._within_reach(distance, angle):
            return ExecutedStep(
                recording, peaks, None, self._missed(limb, to_point, distance, angle, step)
            )
        capture = Capture(self.time, step, limb, self.grasp_map.ids[to_point], distance, angle)
        self._grasp(limb, to_point)
        return ExecutedStep(recording, peaks, capture, None)

    def rest(self, trajectory: Trajectory, duration: float, step: int = 0) -> ExecutedStep:
        """Hold still in the stance in which a trajectory ended.

        Args:
            trajectory: The trajectory that was executed last.
            duration: How long [s].
            step: Index of the step, for the record.
        """
        count = max(round(duration / self.physics.timestep), 1) + 1
        last: dict[str, Any] = {
            name: np.repeat(getattr(trajectory, name)[-1:], count, axis=0)
            for name in (
                "step",
                "phase",
                "joint_positions",
                "base_positions",
                "base_quaternions",
                "grasps",
            )
        }
        times = np.arange(count, dtype=np.float64) * self.physics.timestep
        still = replace(
            trajectory, times=times, joint_velocities=np.zeros_like(last["joint_positions"]), **last
        )
        recording, peaks, failure = self._run(
            still, still.joint_positions.reshape(count, -1), step, lambda _: None
        )
        return ExecutedStep(recording, peaks, None, failure)

    def _run(
        self, trajectory: Trajectory, control: Array, step: int, enter: Callable[[int], None]
    ) -> tuple[Recording, Peaks, Failure | None]:
        """Simulate until the end or the first failure.

        Args:
            trajectory: The trajectory to follow.
            control: Controls of the joints' actuators, shape (k, 6 N).
            step: Index of the step, for the record.
            enter: What is called with the phase before each piece of it.
        """
        recordings, peaks, failure = [], [], None
        watch = FailureWatch(self.physics, self.robot.limb.limits, step)
        for first, last in _chunks(trajectory.phase, len(control) - 1):
            phase = int(trajectory.phase[first + 1])
            enter(phase)
            states, sensors = self._roll(control[first:last])
            steps = np.arange(self._steps - len(states), self._steps, dtype=np.float64)
            times = steps * self.physics.timestep
            measured = self._instruments.measured(states, sensors, times, trajectory, first)
            found = watch.first(measured, PHASES[phase], [point != FREE for point in self.points])
            ended = len(measured.times) if found is None else found[0] + 1
            recorded, largest = self._instruments.recorded(measured, ended, step, phase)
            recordings.append(recorded)
            peaks.append(largest)
            if found is not None:
                self._restore(states[found[0]], found[1].time)
                failure = self._named(found[1])
                break
        return Recording.join(recordings), Peaks.join(peaks), failure

    def _control(self, trajectory: Trajectory) -> Array:
        """Control of the joints' actuators at each time, shape (k, 6 N)."""
        physics = self.physics
        positions, speeds = trajectory.joint_positions, trajectory.joint_velocities
        torques = np.zeros_like(positions)
        if physics.feedforward:
            torques, shifts = feedforward(self.model, physics, trajectory)
            positions, speeds = (
                positions + shifts,
                speeds + np.gradient(shifts, trajectory.times, axis=0),
            )
        control: Array = positions + (physics.kd * speeds + torques) / physics.kp
        return control.reshape(len(control), -1)

    def grasp_error(self, limb: int, point: int) -> tuple[float, float]:
        """Distance [m] and angle [rad] of a gripper from a point that it might hold."""
        mujoco.mj_forward(self.model, self.data)
        site = self.data.site(f"limb{limb}/grasp")
        turn = Rotation.from_matrix(self._tool(limb, point).T @ site.xmat.reshape(3, 3))
        return float(np.linalg.norm(site.xpos - self.grasp_map.positions[point])), float(
            turn.magnitude()
        )

    def _within_reach(self, distance: float, angle: float) -> bool:
        return distance <= self.physics.capture_distance and angle <= self.physics.capture_angle

    def _tool(self, limb: int, point: int) -> Array:
        """Rotation of a gripper that holds a point: of two, half a turn apart, the nearer one."""
        found = self.data.site(f"limb{limb}/grasp").xmat.reshape(3, 3)
        return max(
            (self._tools[point], self._tools[point] @ HALF_TURN),
            key=lambda tool: float(np.trace(tool.T @ found)),
        )

    def _grasp(self, limb: int, point: int) -> None:
        """Put the anchor on the point and switch the grasp on."""
        quaternion = Rotation.from_matrix(self._tool(limb, point)).as_quat(scalar_first=True)
        anchor = self._anchors[limb]
        self.model.body_pos[anchor], self.model.body_quat[anchor] = (
            self.grasp_map.positions[point],
            quaternion,
        )
        self.model.opt.disableactuator &= ~(2 << limb)
        self.points[limb] = point

    def _release(self, limb: int) -> None:
        self.model.opt.disableactuator |= 2 << limb
        self.points[limb] = FREE

    def _meets(self, limb: int, points: Sequence[int]) -> None:
        """Let a gripper meet every box but those that lie behind the surface of some points."""
        bit, contype = gripper_bit(limb), self.model.geom_contype
        contype[self._boxes] |= bit
        for point in points:
            normal = self.grasp_map.normals[point]
            ahead = (self._centres - self.grasp_map.positions[point]) @ normal
            reach = (np.abs(normal @ self._axes) * self._halves).sum(axis=1)
            contype[self._boxes[ahead + reach <= FLUSH]] &= ~bit

    def _moving(self, trajectory: Trajectory) -> tuple[int, int]:
        """The limb that moves on a trajectory and the point that it grasps."""
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

    def _state(self) -> Array:
        state = np.empty(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self.data, state, STATE)
        return state

    def _restore(self, state: Array, time: float) -> None:
        self.time, self._steps = time, round(time / self.physics.timestep)
        mujoco.mj_setState(self.model, self.data, state, STATE)
        mujoco.mj_forward(self.model, self.data)

    def _roll(self, control: Array) -> tuple[Array, Array]:
        """States before each time step and sensors at it; leaves the data behind the last."""
        ordered = np.zeros((len(control), self.model.nu))
        ordered[:, self.joint_actuators] = control
        state = self._state()
        states, sensors = mujoco.rollout.rollout(
            self.model,
            self.data,
            state,
            ordered,
            initial_warmstart=self.data.qacc_warmstart,
            nstep=len(control),
        )
        self._steps += len(control)
        self.time = self._steps * self.physics.timestep
        return np.concatenate([state[None], states[0, :-1]]), sensors[0]

    def _missed(self, limb: int, point: int, distance: float, angle: float, step: int) -> Failure:
        values = {
            "distance_m": distance, "allowed_distance_m": self.physics.capture_distance,
            "angle_rad": angle, "allowed_angle_rad": self.physics.capture_angle,
        }  # fmt: skip
        allowed = self.physics
        message = (
            f"limb {limb} missed point {self.grasp_map.ids[point]!r} by {1e3 * distance:.1f} mm "
            f"and {np.rad2deg(angle):.2f} deg; it grasps within "
            f"{1e3 * allowed.capture_distance:g} mm and {np.rad2deg(allowed.capture_angle):g} deg"
        )
        return Failure("missed grasp", self.time, step, PHASES[-1], limb, message, values)

    def _named(self, failure: Failure) -> Failure:
        """A collision with the names of what touched."""
        if failure.kind != "collision" or not self.data.ncon:
            return failure
        contact = self.data.contact[int(np.argmin(self.data.contact.dist))]
        names = [self.model.geom(int(geom)).name for geom in contact.geom]
        robot = next(name for name in names if not name.startswith(BOX))
        limb = int(robot[4 : robot.index("/")]) if robot.startswith("limb") else -1
        message = f"{names[0]} and {names[1]} touch, {-1e3 * contact.dist:.2f} mm deep"
        return replace(
            failure, limb=limb, message=message, values={"depth_m": float(-contact.dist)}
        )


def _chunks(phase: IntArray, count: int) -> Iterator[tuple[int, int]]:
    """First and last time step of pieces of at most `CHUNK` within one phase."""
    edges = [0, *(np.flatnonzero(np.diff(phase[1 : count + 1])) + 1).tolist(), count]
    for start, stop in pairwise(edges):
        for first in range(start, stop, CHUNK):
            yield first, min(first + CHUNK, stop)
