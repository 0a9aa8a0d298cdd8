"""Collision shapes of a URDF or MJCF file: capsules round its links, and a box round its body."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError, shortened
from mlivr_gym.robot.capsule_fit import (
    ROUNDED,
    FittedCapsule,
    Hull,
    capsule_on_axis,
    capsules_of,
    solid_of,
)
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.default_shapes import gripper_capsule
from mlivr_gym.robot.description import Description
from mlivr_gym.robot.file_text import MESH_FORMATS
from mlivr_gym.robot.sizes import MOST_CAPSULES


def solids(file: Description, members: Iterable[int], frame: Array, remedy: str) -> list[Hull]:
    """Return the collision shapes of bodies in a frame of the world, shape (4, 4).

    Raises a `RobotError` that ends with what else can be done if a mesh of them cannot be read.
    """
    data, turn, out = file.data, frame[:3, :3].T, []
    for mesh in file.meshes:
        body = int(file.model.geom_bodyid[mesh.geom.id])
        if body in members and mesh.is_solid and not mesh.is_read:
            fault = (
                "not found; name the folder of its package with package_dirs"
                if Path(mesh.file).suffix.lower() in MESH_FORMATS
                else "neither STL nor OBJ; convert it and name the new file"
            )
            raise RobotError(
                f"the collision mesh {shortened(mesh.file)} of link {file.name_of(body)!r} is "
                f"{fault}, or {remedy}"
            )
    for geom in (geom for body in members for geom in file.solid_geoms(body)):
        solid = solid_of(file.model, geom)
        if solid is not None:
            place = turn @ (data.geom_xpos[geom] - frame[:3, 3])
            out.append(solid.moved(place, turn @ data.geom_xmat[geom].reshape(3, 3)))
    return out


def fitted_capsules(
    file: Description,
    members: Iterable[tuple[str, tuple[int, ...], Array]],
    tool_length: float,
    has_gripper: bool,
) -> tuple[tuple[Capsule, ...], dict[str, float]]:
    """Return capsules round the shapes of a limb, and the largest excess of those of each link [m].

    Members are names of links with their bodies and frames in the world; the grasp is `tool_length`
    from the flange [m]. A limb without a gripper is given the shape of one. Raises a `RobotError`
    if a mesh cannot be read, or no link that moves has a shape.
    """
    remedy = "take capsules='ur5e', simple ones along the links"
    out: list[Capsule] = []
    excess: dict[str, float] = {}
    for link, part, frame in members:
        shapes = solids(file, part, frame, remedy)
        if link in LINKS[6:]:
            fits = [capsule_on_axis(shape) for shape in shapes]
        else:
            fits = [fit for shape in shapes for fit in capsules_of(shape)]
        if fits:
            excess[link] = max(fit.excess for fit in fits)
        out += [_rounded(_link_of(link, fit, tool_length), fit) for fit in fits]
    if not any(capsule.link != "base" for capsule in out):
        raise RobotError(f"no link of the limb has a collision shape; {remedy}")
    if len(out) > MOST_CAPSULES - 1:
        raise RobotError(
            f"the limb has {len(out)} collision shapes; it may have {MOST_CAPSULES - 1}, give "
            "fewer as capsules"
        )
    if not has_gripper:
        out.append(gripper_capsule(tool_length))
    return tuple(out), excess


def _link_of(link: str, fit: FittedCapsule, tool_length: float) -> str:
    """Return the link of a capsule: one that bulges out to the grasp counts as the gripper's.

    The shape in it ends at the flange or before, far from the surface at which the limb grasps.
    """
    bulges = fit.excess > 0.0 and max(fit.start[2], fit.end[2]) + fit.radius > 0.5 * tool_length
    return "gripper" if link == "wrist_3" and bulges else link


def _rounded(link: str, fit: FittedCapsule) -> Capsule:
    """Return a capsule of a link, rounded to nanometres; the radius grows by what that may take."""
    start, end = (tuple((np.round(point, 9) + 0.0).tolist()) for point in (fit.start, fit.end))
    if link in LINKS[6:]:
        start, end = (0.0, 0.0, start[2]), (0.0, 0.0, end[2])
    radius = round(fit.radius + (ROUNDED if fit.excess else 0.0), 9)
    return Capsule(link, start, end, max(radius, ROUNDED))


def box_round(shapes: list[Hull], symmetric: bool) -> tuple[Array, Array]:
    """Return middle and half edges of the box round shapes [m].

    If `symmetric`, its middle is the origin.
    """
    lows = [shape.points.min(axis=0) - shape.radius for shape in shapes]
    highs = [shape.points.max(axis=0) + shape.radius for shape in shapes]
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    if symmetric:
        high = np.maximum(np.abs(low), np.abs(high))
        low = -high
    return np.round(0.5 * (low + high), 9), np.round(0.5 * (high - low), 9)
