"""Collision shapes of a URDF or MJCF file: capsules round its links, and a box round its body."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsule_fit import (
    FittedCapsule,
    Solid,
    capsule_on_axis,
    capsules_of,
    directions,
    moved_solid,
    solid_of,
)
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.description import Description
from mlivr_gym.robot.file_parts import LimbParts, solid_geoms
from mlivr_gym.robot.mounts import MOST_CAPSULES

ROUNDED = 1e-9
"""What rounding may take from a coordinate [m]; the radius of a fitted capsule grows by it."""


def solids(file: Description, numbers: Iterable[int], frame: Array) -> list[Solid]:
    """Return the collision shapes of bodies in a frame of the world, shape (4, 4)."""
    import mujoco

    turn, origin = frame[:3, :3].T, frame[:3, 3]
    out = []
    for geom in (geom for body in numbers for geom in solid_geoms(file, body)):
        solid = solid_of(mujoco, file.model, geom)
        if solid is not None:
            rotation = file.data.geom_xmat[geom].reshape(3, 3)
            place = turn @ (file.data.geom_xpos[geom] - origin)
            out.append(moved_solid(solid, place, turn @ rotation))
    return out


def fitted_capsules(
    file: Description, members: LimbParts, frames: Array
) -> tuple[tuple[Capsule, ...], dict[str, float]]:
    """Return capsules round the shapes of a limb, and the largest excess of those of each link [m].

    Parameters
    ----------
    file
        The file.
    members
        Bodies of the limb.
    frames
        Frames of base and links in the world, shape (7, 4, 4).

    Raises
    ------
    RobotError
        If a mesh was not found, or no link that moves has a shape.
    """
    remedy = (
        "name their folders with package_dirs, or take capsules='ur5e', those of the UR5e "
        "stretched to the limb's lengths"
    )
    if file.missing:
        raise RobotError(
            f"{len(file.missing)} meshes of collision shapes are not found or not STL or OBJ, "
            f"the first is {file.missing[0]!r}; {remedy}"
        )
    out: list[Capsule] = []
    excess: dict[str, float] = {}
    parts = [*members.with_frames(frames), (members.gripper, frames[6])]
    for link, (part, frame) in zip(LINKS, parts, strict=True):
        shapes = solids(file, part, frame)
        if link in LINKS[6:]:
            fits = [capsule_on_axis(shape) for shape in shapes]
        else:
            fits = [fit for shape in shapes for fit in capsules_of(shape)]
        if fits:
            excess[link] = max(fit.excess for fit in fits)
        out += [_rounded(link, fit) for fit in fits]
    if not any(capsule.link != "base" for capsule in out):
        raise RobotError(f"no link of the limb has a collision shape; {remedy}")
    if len(out) > MOST_CAPSULES - 1:
        raise RobotError(
            f"the limb has {len(out)} collision shapes; it may have {MOST_CAPSULES - 1}, give "
            "fewer as capsules"
        )
    return tuple(out), excess


def _rounded(link: str, fit: FittedCapsule) -> Capsule:
    """Return a capsule of a link, its coordinates rounded to nanometres."""
    start, end = (tuple((np.round(point, 9) + 0.0).tolist()) for point in (fit.start, fit.end))
    if link in LINKS[6:]:
        start, end = (0.0, 0.0, start[2]), (0.0, 0.0, end[2])
    radius = round(fit.radius + (ROUNDED if fit.excess else 0.0), 9)
    return Capsule(link, start, end, max(radius, ROUNDED))


def box_round(shapes: list[Solid], symmetric: bool) -> tuple[Array, Array, float]:
    """Return middle and half edges of the box round shapes, and how far it exceeds them [m].

    Parameters
    ----------
    shapes
        The shapes.
    symmetric
        Whether the middle of the box is the origin.
    """
    lows = [shape.points.min(axis=0) - shape.radius for shape in shapes]
    highs = [shape.points.max(axis=0) + shape.radius for shape in shapes]
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    if symmetric:
        high = np.maximum(np.abs(low), np.abs(high))
        low = -high
    middle, half = np.round(0.5 * (low + high), 9), np.round(0.5 * (high - low), 9)
    u = directions()
    of_box = u @ middle + np.abs(u) @ half
    of_shapes = np.max(
        [(u @ shape.points.T).max(axis=1) + shape.radius for shape in shapes], axis=0
    )
    return middle, half, max(0.0, float((of_box - of_shapes).max()))
