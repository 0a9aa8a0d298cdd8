"""Quantities that follow from the fields of a robot."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.capsules import Capsule
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.robot.default_shapes import default_capsules, farthest_part
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.limb_dynamics import LimbDynamics, arm_of, dynamics_by_lengths
from mlivr_gym.robot.link_frames import rigid
from mlivr_gym.robot.mounts import Mount, even_mounts, even_rotations
from mlivr_gym.robot.rigid import RigidBody, box_inertia, combined
from mlivr_gym.robot.visuals import Visual
from mlivr_gym.values import MIN_SIZE, Triple


class DerivedFigures:
    """Properties of a `RobotSpec` that its fields determine, whatever its build."""

    name: str
    limbs: int
    limb: Limb
    span: float
    body_mass: float
    source: str
    gripper_mass: float
    body_centre: Triple
    body_inertia: tuple[float, ...] | None
    mount_radius: float
    tool_length: float
    capsules: tuple[Capsule, ...] | None
    visuals: tuple[Visual, ...] | None
    body_size: float | Triple
    dynamics: LimbDynamics | None
    mounts: tuple[Mount, ...] | None
    apart: tuple[tuple[str, str], ...]
    joint_names: tuple[tuple[str, ...], ...] | None
    cargo: Cargo | None

    @cached_property
    def mounted(self) -> tuple[Mount, ...]:
        """Each limb with its place, its kinematics and its capsules, N of them.

        `Mount.dynamics` is None where it follows from the lengths, see `dynamics_of`. Where the
        first joint of a limb is held, its place is that of the first joint that moves.
        """
        mounts = self.mounts or even_mounts(self.limbs, self.mount_radius)
        return tuple(map(self._completed, mounts))

    def _completed(self, mount: Mount) -> Mount:
        """Return a mount with what it does not name itself."""
        limb, shapes, dynamics, seen = mount.limb, mount.capsules, mount.dynamics, mount.visuals
        if limb is None:
            limb, shapes, dynamics = self.limb, shapes or self.capsules, dynamics or self.dynamics
            seen = seen or self.visuals
        if shapes is None:
            shapes = default_capsules(limb, self.tool_length)
        whole = replace(mount, limb=limb, capsules=shapes, dynamics=dynamics, visuals=seen)
        return _on_base(whole, limb)

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether plans are the same after a turn by one limb about the body's z axis.

        Its limbs are equal and evenly mounted, that of limb 0 along the body's x axis, and the body
        of more than two limbs is a cube. Cargo must lie on the axis of two limbs.
        """
        if self.cargo is not None and (self.limbs > 2 or self.cargo_frame[:2, 3].any()):
            return False
        if self.limbs > 2 and not isinstance(self.body_size, float):
            return False
        return self.mounts is None or self._is_evenly_mounted

    @property
    def _is_evenly_mounted(self) -> bool:
        """Whether all mounts and limbs are those of limb 0, turned about the body's z axis."""
        turns = even_rotations(self.limbs)
        turns = turns @ turns[0].T
        first, every = self.mounted[0], self.mounted
        return (
            all((one.limb, one.capsules) == (first.limb, first.capsules) for one in every)
            and np.allclose(self.mount_rotations, turns @ first.rotation, atol=MIN_SIZE)
            and np.allclose(self.mount_positions, turns @ first.position, atol=MIN_SIZE)
            and first.position[0] >= MIN_SIZE > abs(first.position[1])
        )

    def is_apart(self, first: str, second: str) -> bool:
        """Return whether the shapes of two links of a limb never meet, see `RobotSpec.apart`."""
        return any({first, second} == set(pair) for pair in self.apart)

    @property
    def named_joints(self) -> tuple[tuple[str, ...], ...]:
        """Names of the joints that move, N times six: those of the file the robot is read from.

        Joint k of limb i of another robot is `"limb{i}/joint{k}"`.
        """
        return self.joint_names or usual_joints(self.limbs)

    def to_dict(self) -> dict[str, Any]:
        """Return the description as plain data."""
        raise NotImplementedError

    @property
    def every_limb(self) -> tuple[Limb, ...]:
        """Kinematics of each limb, N of them."""
        return tuple(mount.limb or self.limb for mount in self.mounted)

    @property
    def mount_rotations(self) -> Array:
        """Limb base axes in the body frame, shape (N, 3, 3); z is the axis of the first joint."""
        return np.array([mount.rotation for mount in self.mounted])

    @property
    def mount_positions(self) -> Array:
        """Limb base origins in the body frame [m], shape (N, 3)."""
        return np.array([mount.position for mount in self.mounted])

    @property
    def mount_directions(self) -> Array:
        """Where the shoulders lie across the body's z axis, from their middle [m], shape (N, 2).

        What is below a nanometre counts as 0: rounding must not choose a direction.
        """
        lengths = np.array([limb.shoulder_height for limb in self.every_limb])
        shoulders = self.mount_positions + lengths[:, None] * self.mount_rotations[:, :, 2]
        across: Array = (shoulders - shoulders.mean(axis=0))[:, :2]
        return np.where(np.abs(across) < MIN_SIZE, 0.0, across)

    @property
    def joint_limits(self) -> Array:
        """Joint limits of every limb [rad], shape (N, 6, 2)."""
        return np.array([limb.limits for limb in self.every_limb])

    @property
    def body_edges(self) -> Array:
        """Edges of the body along x, y and z [m], shape (3,)."""
        return np.broadcast_to(np.asarray(self.body_size, dtype=np.float64), 3).copy()

    @property
    def body_solid(self) -> RigidBody:
        """Mass, centre and inertia of the body with cargo and locked limb, in the body frame."""
        inertia = self.body_inertia or box_inertia(self.body_mass, self.body_edges)
        body = RigidBody(self.body_mass, self.body_centre, inertia)
        if self.cargo is None:
            return body
        bag = self.cargo.solid.moved(self.cargo_frame)
        return combined([body, bag, *self.cargo.limb_solids(self.gripper_mass, self.tool_length)])

    @property
    def cargo_frame(self) -> Array:
        """Frame of the middle of the cargo in the body frame, shape (4, 4); of the body if none."""
        if self.cargo is None:
            return np.eye(4)
        return self.cargo.frame_on(self.body_edges, self.tool_length)

    @property
    def body_radius(self) -> float:
        """Distance of the body's corners from its middle [m]."""
        edges = self.body_edges
        if (edges == edges[0]).all():
            return float(np.sqrt(0.75) * edges[0])
        return 0.5 * float(np.linalg.norm(edges))

    @property
    def reach(self) -> float:
        """An upper bound of the distance of a grasp from the body's origin [m]."""
        if self.mounts is None:
            return self.mount_radius + self.limb.reach + self.tool_length
        away = np.linalg.norm(self.mount_positions, axis=1).tolist()
        reach = max(r + limb.reach for r, limb in zip(away, self.every_limb, strict=True))
        return float(reach + self.tool_length)

    @property
    def extent(self) -> float:
        """An upper bound of the distance of any part of the robot from the body's middle [m]."""
        farthest = self.body_radius
        if self.cargo is not None:
            # The capsules that cover the cargo protrude by less than a quarter of its edges.
            frame = self.cargo_frame
            corner = np.abs(frame[:3, :3].T @ frame[:3, 3]) + 0.75 * self.cargo.edges
            farthest = max(farthest, float(np.linalg.norm(corner)))
            for _, ends, radius in self.cargo.limb_capsules:
                farthest = max(farthest, float(np.linalg.norm(ends, axis=1).max()) + radius)
        for mount, limb in zip(self.mounted, self.every_limb, strict=True):
            away = self.mount_radius
            if self.mounts is not None:
                away = float(np.linalg.norm(mount.position))
            farthest = max(
                away + farthest_part(limb, mount.capsules or (), self.tool_length), farthest
            )
        return farthest

    def dynamics_of(self, limb: int) -> LimbDynamics:
        """Return the masses, inertias and joint limits of a limb, by its number from 0.

        Raises a `RobotError` if they are not given and the limb's lengths are those of no arm that
        ships: another arm's figures would be wrong without notice.
        """
        given = self.mounted[limb].dynamics
        return given or dynamics_by_lengths(self.every_limb[limb], self.name, self.source)

    @property
    def torque_limits(self) -> Array:
        """Largest torque of every joint [N m], shape (N, 6), see `dynamics_of`."""
        return np.array([self.dynamics_of(i).torque_limits for i in range(self.limbs)])

    @property
    def speed_limits(self) -> Array:
        """Largest speed of every joint [rad/s], shape (N, 6), see `dynamics_of`."""
        return np.array([self.dynamics_of(i).speed_limits for i in range(self.limbs)])

    @property
    def dynamics_source(self) -> str:
        """Whose masses, inertias, torque and speed limits a simulation takes, for each limb."""
        told = []
        for limb, mount in zip(self.every_limb, self.mounted, strict=True):
            arm = arm_of(limb)
            given = "given with the robot" if mount.dynamics is not None else None
            told.append(given or (f"those of the {arm}, by its lengths" if arm else "not known"))
        return told[0] if len(set(told)) == 1 else "; ".join(told)


def usual_joints(limbs: int) -> tuple[tuple[str, ...], ...]:
    """Return the names of the joints of limbs that are read from no file."""
    return tuple(tuple(f"limb{i}/joint{k}" for k in range(1, 7)) for i in range(limbs))


def _on_base(mount: Mount, limb: Limb) -> Mount:
    """Return a mount at the base of the joints that move, see `Limb.base_in_mount`."""
    if limb.held_joint != 1:
        return mount
    base = rigid(mount.rotation, mount.position) @ limb.base_in_mount
    return replace(mount, position=base[:3, 3].tolist(), rotation=base[:3, :3].tolist())
