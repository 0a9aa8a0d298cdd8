"""The grippers of a simulated robot: grasps, allowed contacts, and the guidance of an approach.

Points are where the disturbance moves them, which the controller does not know. A sensor on the
gripper measures the pose of the point relative to it, with noise. A low-pass filter of the error, a
proportional gain and the inverse Jacobian of the limb move the joint references (position-based
visual servoing).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.against_boxes import FLUSH
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.motion.trajectory import FREE, Trajectory
from mlivr_gym.simulation.dynamics import SimulatedRobot, gripper_bit
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.inverse_dynamics import gripper_jacobian, robot_model
from mlivr_gym.simulation.joint_controller import JointController
from mlivr_gym.world.boxes import BOX, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""Half a turn about the surface normal, the symmetry of a grasp."""

CLOSE_POSITION, CLOSE_ANGLE = 0.001, float(np.deg2rad(0.4))
"""Errors in position [m] and angle [rad] below which the gripper is close to its point."""

REST_SPEEDS = 0.004, 0.01
"""Linear and angular speed below which the gripper counts as at rest [m/s, rad/s]."""

PATIENCE = 6.0
"""Longest time for which a gripper waits at the end of its approach until it is close and at rest,
in time constants of the guidance."""

FILTER_MEMORY = 0.8
"""Weight of the previous error in the low-pass filter, at each reading of the sensor."""

MAX_CHANGE = 0.01
"""Upper bound of the change of a joint reference at one reading [rad]."""


class Grippers:
    """The grippers of a simulated robot; `points` has the point that each holds, or `FREE`."""

    def __init__(
        self, simulated: SimulatedRobot, grasp_map: GraspMap, boxes: Sequence[Box]
    ) -> None:
        """Look up the parts of the model; `boxes` are those of the map and the obstacles."""
        model, robot = simulated.model, simulated.robot
        self._model, self._data, self._map = model, simulated.data, grasp_map
        self._disturbance = simulated.disturbance
        rails = grasp_map.rotations[:, :, 0]
        grasps = grasp_rows(grasp_map.positions, grasp_map.normals, rails, robot.tool_length)
        self._tools: Array = grasps["flange"]["rotation"]
        self._sites = [model.site(f"limb{i}/grasp").id for i in range(robot.limbs)]
        self._anchors = [model.body(f"limb{i}/anchor").id for i in range(robot.limbs)]
        self._boxes = np.array(
            [model.geom(scene_name(BOX, box.id)).id for box in boxes], dtype=np.int64
        )
        self._centres = np.array([box.centre for box in boxes]).reshape(-1, 3)
        self._halves = np.array([box.half for box in boxes]).reshape(-1, 3)
        self._axes = np.array([box.rotation for box in boxes]).reshape(-1, 3, 3)
        self._contype = model.geom_contype.copy()
        self.points: list[int] = [FREE] * robot.limbs
        self.reset()

    def reset(self) -> None:
        """Release all points, and displace each by the disturbance."""
        self._turns: Array = Rotation.from_rotvec(self._disturbance.point_turns).as_matrix()
        self._positions: Array = self._map.positions + self._disturbance.point_offsets
        self._model.geom_contype[:] = self._contype
        for limb in range(len(self.points)):
            self.detach(limb)

    def reset_point(self, point: int) -> None:
        """Move a point back to its position in the map."""
        self._turns[point] = np.eye(3)
        self._positions[point] = self._map.positions[point]

    def pose(self, limb: int) -> tuple[Array, Array]:
        """Return position [m] and rotation of a gripper's grasp frame, as of the last update."""
        site = self._sites[limb]
        return self._data.site_xpos[site].copy(), self._data.site_xmat[site].reshape(3, 3).copy()

    def jacobian(self, limb: int) -> Array:
        """Return the Jacobian of a gripper by base and joints, world axes, shape (6, 6 + 6 N)."""
        return gripper_jacobian(self._model, self._data, limb)

    def relative_speed(self, limb: int, joint_speeds: Array) -> tuple[float, float]:
        """Return linear [m/s] and angular speed [rad/s] of a gripper while the others stand still.

        Velocities of all joints have shape (6 N,) [rad/s].
        """
        holding = [other for other, point in enumerate(self.points) if point != FREE]
        held, here = np.concatenate([self.jacobian(i) for i in holding]), self.jacobian(limb)
        base = np.linalg.lstsq(held[:, :6], -held[:, 6:] @ joint_speeds)[0]
        speed = here[:, :6] @ base + here[:, 6:] @ joint_speeds
        return float(np.linalg.norm(speed[:3])), float(np.linalg.norm(speed[3:]))

    def error(self, limb: int, point: int) -> tuple[float, float]:
        """Return distance [m] and angle [rad] between a gripper and its grasp on a point."""
        position, rotation = self.pose(limb)
        turn = Rotation.from_matrix(self._tool(limb, point).T @ rotation)
        distance = np.linalg.norm(position - self._positions[point])
        return float(distance), float(turn.magnitude())

    def displaced_pose(self, point: int, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Return a pose planned relative to a point of the map, relative to the displaced point."""
        turn = self._turns[point]
        return (
            self._positions[point] + turn @ (position - self._map.positions[point]),
            turn @ rotation,
        )

    def _tool(self, limb: int, point: int) -> Array:
        """Return the closer of the two rotations with which a gripper can hold a point."""
        rotation, tool = self.pose(limb)[1], self._turns[point] @ self._tools[point]
        return max(tool, tool @ HALF_TURN, key=lambda tool: float(np.trace(tool.T @ rotation)))

    def attach(self, limb: int, point: int) -> None:
        """Move the anchor of a limb to a point and switch its compliant grasp on."""
        anchor, rotation = self._anchors[limb], self._tool(limb, point)
        self._model.body_pos[anchor] = self._positions[point]
        self._model.body_quat[anchor] = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
        self._model.opt.disableactuator &= ~(2 << limb)
        self.points[limb] = point

    def detach(self, limb: int) -> None:
        """Switch the compliant grasp of a limb off."""
        self._model.opt.disableactuator |= 2 << limb
        self.points[limb] = FREE

    def set_contacts(self, limb: int, point: int) -> None:
        """Let a gripper collide with all boxes but those behind the surface at a point."""
        bit, contype = gripper_bit(limb), self._model.geom_contype
        contype[self._boxes] |= bit
        if point != FREE:
            normal = self._map.normals[point]
            ahead = (self._centres - self._map.positions[point]) @ normal
            reach = (np.abs(normal @ self._axes) * self._halves).sum(axis=1)
            contype[self._boxes[ahead + reach <= FLUSH]] &= ~bit


class Guidance:
    """Guidance of one limb to one point."""

    def __init__(
        self, simulated: SimulatedRobot, grippers: Grippers, controller: JointController
    ) -> None:
        """Prepare the guidance of the limbs of a simulated robot."""
        self._grippers, self._controller = grippers, controller
        self._parameters = simulated.controller
        self._model = robot_model(simulated.robot)
        self._planned = mujoco.MjData(self._model)
        ranges = simulated.disturbance.ranges
        self._noise = np.repeat([ranges.sensor_position, ranges.sensor_angle], 3)
        self._rng = np.random.default_rng([simulated.disturbance.seed, 2])
        self._filtered: Array | None = None

    def start(self, limb: int, point: int) -> None:
        """Start to guide a limb to a point, given by its index."""
        self._limb, self._point, self._filtered = limb, point, None

    @property
    def is_close(self) -> bool:
        """Whether the measured error is small and the gripper is at rest.

        A grasp stops a gripper at once through its damper. The motion of the gripper relative to
        the points held therefore counts, which includes the slow oscillation of the robot on its
        support limbs.
        """
        if self._filtered is None:
            return False
        away, turned = np.linalg.norm(self._filtered[:3]), np.linalg.norm(self._filtered[3:])
        moves, turns = self._grippers.relative_speed(self._limb, self._controller.speeds)
        found = np.array([away, turned, moves, turns])
        return bool((found < (CLOSE_POSITION, CLOSE_ANGLE, *REST_SPEEDS)).all())

    def correct(self, trajectory: Trajectory, k: int) -> None:
        """Read the sensor at index `k` of the time grid and move the limb's joint references."""
        error = self._error(trajectory, k) + self._noise * self._rng.standard_normal(6)
        filtered = (
            error
            if self._filtered is None
            else FILTER_MEMORY * self._filtered + (1.0 - FILTER_MEMORY) * error
        )
        self._filtered = filtered
        fraction = self._parameters.guidance * self._parameters.sensor_period
        first = 6 * self._limb
        jacobian = self._grippers.jacobian(self._limb)[:, 6 + first : 12 + first]
        change = fraction * np.linalg.lstsq(jacobian, filtered)[0]
        change *= min(1.0, MAX_CHANGE / max(float(np.abs(change).max()), 1e-12))
        self._controller.offset[first : first + 6] += change

    def _error(self, trajectory: Trajectory, k: int) -> Array:
        """Return displacement and rotation vector from the gripper to its reference, (6,) [m, rad].

        They are in world axes.
        """
        data, site = self._planned, self._model.site(f"limb{self._limb}/grasp").id
        data.qpos[:] = np.concatenate([part.ravel() for part in trajectory.configuration(k)])
        mujoco.mj_kinematics(self._model, data)
        to_position, to_rotation = self._grippers.displaced_pose(
            self._point, data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
        )
        position, rotation = self._grippers.pose(self._limb)
        quaternion, twist = np.empty(4), np.empty(6)
        mujoco.mju_mat2Quat(quaternion, (to_rotation @ rotation.T).ravel())
        mujoco.mju_quat2Vel(twist[3:], quaternion, 1.0)
        twist[:3] = to_position - position
        return twist
