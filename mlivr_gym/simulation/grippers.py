"""The grippers of a simulated robot: grasps, allowed contacts, and errors relative to points.

Points are where the disturbance moves them, which the controller does not know.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.against_boxes import FLUSH
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.motion.trajectory import FREE
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.disturbances import Disturbance
from mlivr_gym.simulation.dynamics import Physics, gripper_bit
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.inverse_dynamics import gripper_jacobian
from mlivr_gym.world.boxes import BOX, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""Half a turn about the surface normal, the symmetry of a grasp."""


class Grippers:
    """The grippers of a simulated robot; `points` has the point that each holds, or `FREE`."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        grasp_map: GraspMap,
        robot: RobotSpec,
        disturbance: Disturbance,
        boxes: Sequence[Box],
    ) -> None:
        """Look up the parts of the model; `boxes` are those of the map and the obstacles."""
        self._model, self._data, self._map = model, data, grasp_map
        rails = grasp_map.rotations[:, :, 0]
        grasps = grasp_rows(grasp_map.positions, grasp_map.normals, rails, robot.tool_length)
        self._disturbance = disturbance
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

    def set_contacts(self, limb: int, points: Sequence[int]) -> None:
        """Let a gripper collide with every box, except those behind the surface at some points."""
        bit, contype = gripper_bit(limb), self._model.geom_contype
        contype[self._boxes] |= bit
        for point in points:
            normal = self._map.normals[point]
            ahead = (self._centres - self._map.positions[point]) @ normal
            reach = (np.abs(normal @ self._axes) * self._halves).sum(axis=1)
            contype[self._boxes[ahead + reach <= FLUSH]] &= ~bit


def displacement(pose: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Return displacement and rotation vector from one pose to another, shape (6,) [m, rad].

    A pose is a position and a rotation matrix; the result is in world axes.
    """
    (position, rotation), (to_position, to_rotation) = pose, other
    quaternion, twist = np.empty(4), np.empty(6)
    mujoco.mju_mat2Quat(quaternion, (to_rotation @ rotation.T).ravel())
    mujoco.mju_quat2Vel(twist[3:], quaternion, 1.0)
    twist[:3] = to_position - position
    return twist


def can_capture(physics: Physics, distance: float, angle: float) -> bool:
    """Return whether a gripper at this distance [m] and angle [rad] from a point can capture it."""
    return distance <= physics.capture_distance and angle <= physics.capture_angle
