"""The body of a whole robot from a URDF or MJCF file, and how its limbs are mounted on it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.description import Description
from mlivr_gym.robot.file_arms import FileArm, body_frame, body_name
from mlivr_gym.robot.file_limb import FileLimb
from mlivr_gym.robot.file_parts import body_parts
from mlivr_gym.robot.file_shapes import box_round, solids
from mlivr_gym.robot.link_frames import inverse, rigid
from mlivr_gym.robot.rigid import RigidBody, box_inertia, joined
from mlivr_gym.values import Triple

EVEN = 1e-6
"""Largest deviation of axes and positions [m] that counts as mounted at equal angles."""


class FileBody(NamedTuple):
    """The body of a robot with its limbs in the body's frame."""

    limbs: tuple[FileLimb, ...]
    """The limbs, in order round the body if they are mounted evenly."""
    mount_radius: float | None
    """Distance of their bases from the z axis [m] if they are mounted evenly."""
    edges: float | Triple
    """Edge of the body, or its three edges [m]."""
    solid: RigidBody
    """Mass, centre and inertia in the body's frame."""
    inertia: tuple[float, ...] | None
    """The inertia, None if it is that of a homogeneous box [kg m^2]."""


def body_of(
    file: Description,
    arms: tuple[FileArm, ...],
    limbs: tuple[FileLimb, ...],
    size: float | Triple | None,
) -> FileBody:
    """Return the body of a whole robot, by its arms and its limbs with their mounts in the world.

    If the limbs are mounted evenly its x axis points to limb 0, and its z axis is that round which
    they lie; else its axes are those of the root link, and its origin the middle of its shapes. Its
    edge or three edges may be given [m]; else it is the box round its shapes. Raises a `RobotError`
    if the body has no mass, or no shape and no size.
    """
    members = body_parts(file, arms)
    name = body_name(file.model, members[0])
    root = body_frame(file.data, members[0])
    even = _even_frame(limbs, root[:3, :3])
    frame = root if even is None else even[0]
    shapes = solids(file, members, frame)
    if not shapes and size is None:
        raise RobotError(f"the body {name!r} has no collision shape; give body_size [m]")
    if size is None:
        middle, half = box_round(shapes, even is not None)
        frame = frame.copy()
        frame[:3, 3] += frame[:3, :3] @ middle
        x, y, z = (2.0 * half).tolist()
        size = x if x == y == z else (x, y, z)
    solid = joined(file.model, file.data, members, frame)
    if not solid.mass:
        raise RobotError(
            f"link {name!r}, the body, has no mass; give it an inertial with the mass [kg] and the "
            "inertia [kg m^2]"
        )
    to_body = inverse(frame)
    limbs = tuple(replace(limb, mount=to_body @ limb.mount) for limb in limbs)
    if even is not None:
        limbs = tuple(_upright(limbs[k]) for k in even[2])
    radius = None if even is None else even[1]
    return FileBody(limbs, radius, size, solid, _body_inertia(solid, size))


def _body_inertia(solid: RigidBody, size: float | Triple) -> tuple[float, ...] | None:
    """Return the inertia of a body, None if it is that of a homogeneous box."""
    box = box_inertia(solid.mass, np.broadcast_to(np.asarray(size, dtype=np.float64), 3))
    same = np.allclose(solid.inertia, box, rtol=1e-9, atol=1e-9)
    return None if same and np.allclose(solid.centre, 0.0, atol=1e-9) else solid.inertia


def _even_frame(
    limbs: tuple[FileLimb, ...], axes: Array
) -> tuple[Array, float, tuple[int, ...]] | None:
    """Return the frame in which limbs are mounted evenly round z, their radius and their order."""
    count = len(limbs)
    outward = np.array([limb.mount[:3, 2] for limb in limbs])
    positions = np.array([limb.mount[:3, 3] for limb in limbs])
    centre = positions.mean(axis=0)
    radius = float(((positions - centre) * outward).sum(axis=1).mean())
    if radius < 0.0 or np.abs(positions - centre - radius * outward).max() > EVEN:
        return None
    for z in axes.T[::-1]:
        if np.abs(outward @ z).max() > EVEN:
            continue
        x = outward[0]
        angles = np.arctan2(outward @ np.cross(z, x), outward @ x)
        # What rounding leaves below 0 stays there, so that limb 0 comes first.
        angles = (angles + EVEN) % (2.0 * np.pi) - EVEN
        order = np.argsort(angles)
        gaps = np.diff([*angles[order], 2.0 * np.pi])
        if np.abs(gaps - 2.0 * np.pi / count).max() <= 10.0 * EVEN:
            frame = rigid(np.stack([x, np.cross(z, x), z], axis=1), centre)
            return frame, round(radius, 9), tuple(order.tolist())
    return None


def _upright(limb: FileLimb) -> FileLimb:
    """Return a limb whose base has its x axis along the body's z axis."""
    x, y = limb.mount[2, 0], limb.mount[2, 1]
    angle = float(np.arctan2(y, x))
    return limb if abs(angle) < EVEN else limb.turned(angle)
