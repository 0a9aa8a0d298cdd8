"""Motions of one limb while the base stands still: planned, timed and carried out in MuJoCo.

A limb that picks a bag up, folds with it or stows it moves from knot to knot on lines in joint
space, at rest at each. The ends at a handle are lines along its normal. Between them RRT-Connect
finds knots. Configurations `RESOLUTION` apart keep the clearance from everything; between them a
motion is not certified, unlike the steps of a walk.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, pairwise

import numpy as np
from scipy.interpolate import PPoly

from mlivr_gym.arrays import Array
from mlivr_gym.collisions import lies_behind
from mlivr_gym.extensions.cargo.rrt_connect import connected
from mlivr_gym.kinematics import Angles, all_angles_at, grasp_rows, joints_along, pose
from mlivr_gym.kinematics.poses import poses
from mlivr_gym.motion import FREE, Trajectory, quintic
from mlivr_gym.robot import Cargo, RobotSpec
from mlivr_gym.simulation import Limits, Physics, scene_spec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.inverse_dynamics import compute_inverse_dynamics
from mlivr_gym.simulation.path_dynamics import sampled_times
from mlivr_gym.simulation.scene import compile_spec, set_configuration
from mlivr_gym.stances import StanceGraph
from mlivr_gym.world import BOX, Box, scene_name

RESOLUTION = 0.02
"""Distance of the configurations that are checked, in the joint that moves most [rad]."""

LINE_SAMPLES = 12
"""Number of configurations on a line along a normal."""

MAX_JUMP = 0.3
"""Largest change of a joint between two of these [rad]."""


@dataclass(frozen=True)
class Handle:
    """What a limb grasps: a point of the map, or the middle of a face of a bag."""

    point: Array
    """Position [m], shape (3,)."""
    normal: Array
    """Unit vector out of the face, shape (3,)."""
    rail: Array
    """Unit vector across it along which the gripper closes, shape (3,)."""


class LimbMover:
    """Plans motions of one limb of a robot whose base stands still.

    With cargo, the gripper of the limb holds it.
    """

    def __init__(
        self,
        graph: StanceGraph,
        limb: int,
        obstacles: tuple[Box, ...],
        cargo: Cargo | None = None,
    ) -> None:
        """Compile the scene of the graph's robot with boxes in addition to those of its map."""
        self.graph, self.limb = graph, limb
        self._depth = 0.0 if cargo is None else float(cargo.edges[2])
        robot, boxes = graph.robot, (*graph.grasp_map.boxes, *obstacles)
        spec = scene_spec(graph.grasp_map, robot, obstacles)
        name = f"limb{limb}"
        if cargo is not None:
            place = cargo.centre_below(robot.tool_length)
            bag = spec.body(f"{name}/gripper").add_body(name=f"{name}/cargo", pos=place)
            bag.add_geom(
                name=f"{name}/cargo/0", type=mujoco.mjtGeom.mjGEOM_BOX, size=0.5 * cargo.edges,
                contype=1, conaffinity=3, mass=0.0,
            )  # fmt: skip
            spec.add_exclude(bodyname1=f"{name}/wrist_3", bodyname2=f"{name}/cargo")
        self._model = compile_spec(spec)
        self._data = mujoco.MjData(self._model)
        names = [self._model.geom(g).name for g in range(self._model.ngeom)]
        moving = [one.startswith(f"{name}/") and "/base/" not in one for one in names]
        self._moving = np.array(moving)
        self._at_hand = np.array(
            [one.startswith((f"{name}/gripper", f"{name}/cargo")) for one in names]
        )
        self._model.geom_margin[self._moving] = graph.settings.clearance
        self._boxes = {names.index(scene_name(BOX, box.id)): box for box in boxes}
        self._low, self._high = robot.every_limb[limb].windows.T

    def stand(self, position: Array, quaternion: Array, joints: Array) -> None:
        """Put the base and the other limbs where they stay; `joints` has shape (N, 6) [rad]."""
        set_configuration(self._model, self._data, position, quaternion, joints)
        self._base = pose(position, self._data.body("base").xmat.reshape(3, 3))

    def is_clear(self, joints: Array, at: Handle | None = None) -> bool:
        """Return whether the limb keeps the clearance at its joint angles, shape (6,) [rad].

        At a handle the gripper may touch what lies behind it, and cargo what lies behind its foot.
        """
        model, data = self._model, self._data
        data.qpos[7 + 6 * self.limb : 13 + 6 * self.limb] = joints
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        contact = data.contact
        for pair, distance in zip(contact.geom.tolist(), contact.dist.tolist(), strict=True):
            first, second = sorted(pair, key=lambda geom: bool(self._moving[geom]))
            if not self._moving[second] or distance >= self.graph.settings.clearance:
                continue
            box = self._boxes.get(first)
            if at is None or box is None or not self._at_hand[second]:
                return False
            if not lies_behind(box, at.point - self._depth * at.normal, at.normal):
                return False
        return True

    def _is_line_clear(self, first: Array, last: Array, at: Handle | None = None) -> bool:
        count = int(np.ceil(np.abs(last - first).max() / RESOLUTION)) + 1
        return all(self.is_clear(q, at) for q in np.linspace(first, last, count))

    def _is_clear_along(self, knots: Array, at: Handle | None = None) -> bool:
        return all(self._is_line_clear(first, last, at) for first, last in pairwise(knots))

    def reaches(self, handle: Handle, held: Array | None = None) -> list[Array]:
        """Return lines along the normal down to a handle, each clear, shape (k, 6) [rad].

        They are on different branches and flips. With `held`, the joint angles at the handle, only
        theirs is one.
        """
        robots, lift = self.graph.checks.robots, self.graph.robot.lift
        grasp = grasp_rows(handle.point, handle.normal, handle.rail, self.graph.robot.tool_length)
        flange, found = grasp["flange"], []
        at_point = Angles.rows(8)
        all_angles_at(robots, self.limb, self._base, flange[()], at_point)
        heights = np.linspace(0.0, lift, LINE_SAMPLES)[:, None]
        flanges = poses(
            flange["position"] + heights * handle.normal,
            np.tile(flange["rotation"], (LINE_SAMPLES, 1, 1)),
        )
        bases = np.array([self._base])
        for branch, flip in np.ndindex(8, 2):
            q = at_point["q"][branch] + [0.0, 0.0, 0.0, 0.0, 0.0, flip * np.pi]
            q = self._low + np.mod(q - self._low, 2.0 * np.pi)
            if held is not None:
                turns = (q - held) / (2.0 * np.pi)
                if not (np.abs(turns - np.round(turns)) < 1e-4).all():
                    continue
                q = held
            if not (np.isfinite(q).all() and (q <= self._high).all()):
                continue
            line = joints_along(robots, self.limb, bases, flanges, branch, q)[::-1]
            if len(line) < LINE_SAMPLES:
                continue
            inside = (line >= self._low).all() and (line <= self._high).all()
            smooth = np.abs(np.diff(line, axis=0)).max() < MAX_JUMP
            if inside and smooth and self._is_clear_along(line, handle):
                found.append(line)
        return found

    def connect(self, first: Array, last: Array, seed: int = 0) -> Array | None:
        """Return knots of a clear path between joint angles, (k, 6) [rad], or None."""
        limits = np.column_stack([self._low, self._high])
        return connected(first, last, limits, self._is_line_clear, seed)


def limb_trajectory(
    graph: StanceGraph,
    limb: int,
    knots: Array,
    start: tuple[Array, Array, Array, tuple[int, ...]],
    robot: RobotSpec,
    limits: Limits,
) -> Trajectory:
    """Return a limb's motion over knots (k, 6) [rad], a quintic at rest at both ends on each line.

    It begins at `start`: base position [m], base quaternion, joint angles (N, 6) [rad] and the
    point of each limb; `robot` has the masses that are moved. Without gravity and from rest, forces
    and torques scale with the inverse square of the time: each line takes the shortest time within
    the limits.
    """
    position, quaternion, joints, points = start
    period, parts = Physics().timestep, list[Array]()
    holding = [i for i in range(robot.limbs) if i != limb]
    for first, last in pairwise(knots):
        s = sampled_times(quintic(1.0))
        rows = _rows(joints, limb, (first, last), quintic(1.0), s)
        where = np.tile(np.concatenate([position, quaternion]), (len(s), 1))
        moving = np.pad(rows[1:].reshape(2, len(s), -1), ((0, 0), (0, 0), (6, 0)))
        loads = compute_inverse_dynamics(
            robot, holding, np.column_stack([where, rows[0].reshape(len(s), -1)]),
            moving[:1], moving[1:],
        )  # fmt: skip
        force, torque = (np.linalg.norm(loads.wrenches[0][..., part], axis=-1).max()
                         for part in (slice(3), slice(3, 6)))  # fmt: skip
        share = (np.abs(loads.torques[0]) / robot.torque_limits).max() / limits.torque
        squares = (share, force / limits.grasp_force, torque / limits.grasp_torque)
        speed = np.abs(rows[1, :, limb]).max(axis=0) / robot.speed_limits[limb]
        duration = max(np.sqrt(max(squares)), speed.max() / limits.speed, 2.0 * period)
        count = int(np.ceil(duration / period))
        times: Array = period * np.arange(min(len(parts), 1), count + 1, dtype=np.float64)
        parts.append(_rows(joints, limb, (first, last), quintic(count * period), times))
    angles, speeds, accelerations = np.concatenate(parts, axis=1)
    count = len(angles)
    grasps = np.tile(np.array(points), (count, 1))
    grasps[:, limb] = FREE
    return Trajectory(
        times=period * np.arange(count, dtype=np.float64), step=np.zeros(count, dtype=np.int64),
        phase=np.ones(count, dtype=np.int64), joint_positions=angles, joint_velocities=speeds,
        joint_accelerations=accelerations, base_positions=np.tile(position, (count, 1)),
        base_quaternions=np.tile(quaternion, (count, 1)), base_velocities=np.zeros((count, 6)),
        base_accelerations=np.zeros((count, 6)), grasps=grasps,
        point_ids=tuple(graph.grasp_map.ids), joint_names=tuple(chain(*robot.named_joints)),
    )  # fmt: skip


def _rows(
    joints: Array, limb: int, line: tuple[Array, Array], scaling: PPoly, times: Array
) -> Array:
    """Return angles, speeds and accelerations of all joints on a line, shape (3, k, N, 6)."""
    rows = np.zeros((3, len(times), *joints.shape))
    rows[0] = joints
    for order in range(3):
        rows[order, :, limb] = scaling(times, order)[:, None] * (line[1] - line[0])
    rows[0, :, limb] += line[0]
    return rows
