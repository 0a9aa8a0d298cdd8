"""Collision shapes of a URDF or MJCF file: capsules round its links, and a box round its body.

A shape is a union of triangles, or of one ball or two: a sphere is one, a capsule two. A shape that
one capsule fits badly is cut in two across one of its two longer principal axes, and each piece is
fitted again. The excess of a capsule is the Hausdorff distance of it and the convex hull of its
shape: of two convex sets, one in the other, it is the largest difference of their support functions
over all directions.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import RobotError, shortened
from mlivr_gym.robot.capsules import LINKS, Capsule, gripper_capsule
from mlivr_gym.robot.description import Description
from mlivr_gym.robot.file_text import MESH_FORMATS
from mlivr_gym.robot.sizes import MOST_CAPSULES

TOLERATED = 0.02
"""Excess above which a shape is cut in two [m]."""

MOST_PIECES = 8
"""Largest number of capsules for one shape."""

GAIN = 0.9
"""A cut must bring the largest excess of the capsules below this share of what it was."""

CUTS = (0.3, 0.5, 0.7)
"""Where along each principal axis a shape may be cut, as shares of its length."""

ROUNDED = 1e-9
"""Excess that counts as none [m]."""

DIRECTIONS = 600
"""Number of directions over which the excess is computed, and of corners of an ellipsoid."""

SEGMENTS = 48
"""Number of corners that stand for the rim of a cylinder."""


class Hull(NamedTuple):
    """A shape, of which what counts is its convex hull."""

    points: Array
    """Corners of the hull, or centres of balls [m], shape (k, 3)."""
    radius: float = 0.0
    """Radius of the balls, of triangles 0 [m]."""
    corners: Array = np.empty((0, 3))
    """Corners of triangles [m], shape (v, 3)."""
    faces: IntArray = np.empty((0, 3), dtype=np.int64)
    """Triangles as numbers of their corners, shape (t, 3); none of balls."""

    def moved(self, position: Array, rotation: Array) -> Hull:
        """Return it in the frame in which its own has a position and a rotation."""
        points, corners = (part @ rotation.T + position for part in (self.points, self.corners))
        return Hull(points, self.radius, corners, self.faces)


class FittedCapsule(NamedTuple):
    """A capsule that contains a solid."""

    start: Array
    """One end of its axis [m], shape (3,)."""
    end: Array
    """The other end [m], shape (3,)."""
    radius: float
    """Radius [m]."""
    excess: float
    """Largest distance of a point of the capsule from the solid's convex hull [m]."""


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
        out += [_rounded(link, fit, tool_length) for fit in fits]
    if all(capsule.link == "base" for capsule in out):
        raise RobotError(f"no link of the limb has a collision shape; {remedy}")
    if len(out) > MOST_CAPSULES - 1:
        raise RobotError(
            f"the limb has {len(out)} collision shapes; it may have {MOST_CAPSULES - 1}, give "
            "fewer as capsules"
        )
    if not has_gripper:
        out.append(gripper_capsule(tool_length))
    return tuple(out), excess


def _rounded(link: str, fit: FittedCapsule, tool_length: float) -> Capsule:
    """Return a capsule of a link, rounded to nanometres; the radius grows by what that may take.

    One of the last link that bulges out to the grasp counts as the gripper's: the shape in it ends
    at the flange or before, far from the surface at which the limb grasps.
    """
    start, end = (tuple((np.round(point, 9) + 0.0).tolist()) for point in (fit.start, fit.end))
    if link in LINKS[6:]:
        start, end = (0.0, 0.0, start[2]), (0.0, 0.0, end[2])
    tip = max(fit.start[2], fit.end[2]) + fit.radius
    if link == "wrist_3" and fit.excess > 0.0 and tip > 0.5 * tool_length:
        link = "gripper"
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


def solid_of(model: Any, geom: int) -> Hull | None:
    """Return a geom of a model in its own frame, None for a plane or another unbounded shape."""
    kinds = mujoco.mjtGeom
    kind, size = kinds(int(model.geom_type[geom])), model.geom_size[geom]
    if kind == kinds.mjGEOM_SPHERE:
        return Hull(np.zeros((1, 3)), float(size[0]))
    if kind == kinds.mjGEOM_CAPSULE:
        return Hull(np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]]), float(size[0]))
    if kind == kinds.mjGEOM_BOX:
        return _hull(np.array(list(product((-1.0, 1.0), repeat=3))) * size)
    if kind == kinds.mjGEOM_CYLINDER:
        angles = 2.0 * np.pi * (np.arange(SEGMENTS) + 0.5) / SEGMENTS
        rim = np.stack([np.cos(angles), np.sin(angles)], axis=1) / np.cos(np.pi / SEGMENTS)
        rims = [np.column_stack([size[0] * rim, np.full(SEGMENTS, z)]) for z in (-size[1], size[1])]
        return _hull(np.vstack(rims))
    if kind == kinds.mjGEOM_ELLIPSOID:
        # The triangles between neighbouring directions cut off less than 1 % of the radius.
        return _hull(directions() * size * 1.01)
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        points = np.asarray(model.mesh_vert[first : first + count], dtype=np.float64)
        first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        faces = model.mesh_face[first : first + count]
        return _hull(points, faces) or Hull(points, 0.0, points, faces)
    return None


@cache
def directions() -> Array:
    """Return unit vectors spread evenly over the sphere, shape (`DIRECTIONS`, 3)."""
    k = np.arange(DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * k / DIRECTIONS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def capsules_of(solid: Hull) -> list[FittedCapsule]:
    """Return capsules that together contain a solid, few of them if they fit well.

    The piece with the largest excess is cut again until each fits or a cut no longer lowers it.
    """
    pieces = [(_fitted(solid), solid)]
    done = 0
    while done < len(pieces) < MOST_PIECES:
        pieces.sort(key=lambda piece: -piece[0].excess)
        fit, worst = pieces[done]
        if fit.excess <= TOLERATED:
            break
        halves = _halves(worst)
        gained = max((half.excess for half, _ in halves), default=np.inf) < GAIN * fit.excess
        if gained:
            pieces[done : done + 1] = halves
        else:
            done += 1
    return [fit for fit, _ in pieces]


def _principal(points: Array) -> tuple[Array, Array]:
    """Return the principal axes of points, as columns, and the middle of their box along these."""
    _, axes = np.linalg.eigh(np.cov(points.T))
    along = points @ axes
    middle: Array = axes @ (0.5 * (along.min(axis=0) + along.max(axis=0)))
    return axes, middle


def _fitted(solid: Hull) -> FittedCapsule:
    """Return the best capsule along a principal axis of the points or an axis of the frame."""
    points = solid.points
    if len(points) <= 2:
        return FittedCapsule(points[0], points[-1], solid.radius, 0.0)
    axes, middle = _principal(points)
    fits = (_along(points, middle, axis) for axis in (*axes.T, *np.eye(3)))
    return _with_excess(points, *min(fits, key=_volume))


def capsule_on_axis(solid: Hull) -> FittedCapsule:
    """Return the smallest capsule on the z axis that contains a solid."""
    found = _along(solid.points, np.zeros(3), np.array([0.0, 0.0, 1.0]))
    return _with_excess(solid.points, *found, solid.radius)


def _with_excess(
    points: Array, start: Array, end: Array, radius: float, around: float = 0.0
) -> FittedCapsule:
    """Return a capsule round balls about points, with its excess; given is that of the points."""
    u = directions()
    excess = float((np.maximum(u @ start, u @ end) + radius - (u @ points.T).max(axis=1)).max())
    return FittedCapsule(start, end, radius + around, excess if excess > ROUNDED else 0.0)


def _along(points: Array, through: Array, axis: Array) -> tuple[Array, Array, float]:
    """Return the smallest capsule round points about a line: ends and radius."""
    axis = axis / np.linalg.norm(axis)
    away = points - through
    height = away @ axis
    across = away - height[:, None] * axis
    far = np.sqrt((across * across).sum(axis=1))
    # A little more than the farthest corner, whatever was rounded.
    radius = float(far.max()) * (1.0 + 1e-9) + 1e-12
    cap = np.sqrt(np.maximum(radius * radius - far * far, 0.0))
    low, high = float((height + cap).min()), float((height - cap).max())
    if low > high:
        low = high = 0.5 * (low + high)
    return through + low * axis, through + high * axis, radius


def _volume(capsule: tuple[Array, Array, float]) -> float:
    start, end, radius = capsule
    length = float(np.linalg.norm(end - start))
    return float(np.pi * radius * radius * (length + 4.0 / 3.0 * radius))


def _halves(solid: Hull) -> list[tuple[FittedCapsule, Hull]]:
    """Return a solid cut in two where two capsules fit best, empty if it cannot be cut."""
    points = solid.points
    best: list[tuple[FittedCapsule, Hull]] = []
    least = np.inf
    for axis in _principal(points)[0].T[1:]:
        low, high = float((points @ axis).min()), float((points @ axis).max())
        for share in CUTS:
            middle = (low + share * (high - low)) * axis
            sides = [_kept(solid, middle, side * axis) for side in (1.0, -1.0)]
            halves = [(_fitted(side), side) for side in sides if side is not None]
            excess = max((fit.excess for fit, _ in halves), default=np.inf)
            if len(halves) == 2 and excess < least:
                least, best = excess, halves
    return best


def _hull(points: Array, faces: IntArray | None = None) -> Hull | None:
    """Return the solid of some triangles, by default those of the convex hull; None if flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return None
    return Hull(points[hull.vertices], 0.0, points, hull.simplices if faces is None else faces)


def _kept(solid: Hull, point: Array, axis: Array) -> Hull | None:
    """Return what remains of a solid on the side of a plane to which an axis points, None if flat.

    Triangles that pass the plane are cut.
    """
    height = (solid.corners - point) @ axis
    inside = (height >= 0.0)[solid.faces]
    count = inside.sum(axis=1)
    corners, faces, used = [solid.corners], [solid.faces[count == 3]], len(solid.corners)
    for kept in (1, 2):
        # Turned so that the first corner is the one that is alone on its side.
        cut, alone = solid.faces[count == kept], inside[count == kept] == (kept == 1)
        order = (alone.argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(cut, order, axis=1).T
        ab, ac = used + np.arange(2 * len(a)).reshape(2, -1)
        for other in (b, c):
            share = height[a] / (height[a] - height[other])
            along = solid.corners[other] - solid.corners[a]
            corners.append(solid.corners[a] + share[:, None] * along)
        used += 2 * len(a)
        remaining = [(a, ab, ac)] if kept == 1 else [(ab, b, c), (ab, c, ac)]
        faces += [np.stack(triangle, axis=1) for triangle in remaining]
    rows = np.concatenate(faces)
    is_used = np.zeros(used, dtype=bool)
    is_used[rows] = True
    return _hull(np.concatenate(corners)[is_used], (np.cumsum(is_used) - 1)[rows])
