"""Collision shapes of a URDF or MJCF file: capsules round its links, and a box round its body."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.any_limb import AnyLimb
from mlivr_gym.robot.capsule_fit import (
    ROUNDED,
    FittedCapsule,
    Hull,
    capsule_on_axis,
    capsules_of,
    moved_solid,
    solid_of,
)
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.chain_limb import ChainLimb
from mlivr_gym.robot.default_shapes import gripper_capsule
from mlivr_gym.robot.description import Description
from mlivr_gym.robot.file_arms import body_frame, body_name
from mlivr_gym.robot.file_parts import LimbParts, solid_geoms
from mlivr_gym.robot.link_frames import inverse, link_frames
from mlivr_gym.robot.mounts import MOST_CAPSULES
from mlivr_gym.robot.validators import APART
from mlivr_gym.robot.visuals import MOST_VISUALS, Visual


def solids(file: Description, numbers: Iterable[int], frame: Array) -> list[Hull]:
    """Return the collision shapes of bodies in a frame of the world, shape (4, 4)."""
    turn, origin = frame[:3, :3].T, frame[:3, 3]
    out = []
    for geom in (geom for body in numbers for geom in solid_geoms(file, body)):
        solid = solid_of(file.model, geom)
        if solid is not None:
            rotation = file.data.geom_xmat[geom].reshape(3, 3)
            place = turn @ (file.data.geom_xpos[geom] - origin)
            out.append(moved_solid(solid, place, turn @ rotation))
    return out


def fitted_capsules(
    file: Description, members: LimbParts, frames: Array, tool_length: float
) -> tuple[tuple[Capsule, ...], dict[str, float]]:
    """Return capsules round the shapes of a limb, and the largest excess of those of each link [m].

    Frames of base and links in the world have shape (7, 4, 4); the grasp is `tool_length` from the
    flange [m]. Raises a `RobotError` if a mesh was not found, or no link that moves has a shape.
    """
    remedy = (
        "name their folders with package_dirs, or take capsules='ur5e', simple ones along the links"
    )
    if file.missing:
        raise RobotError(
            f"{len(file.missing)} meshes of collision shapes are not found or not STL or OBJ, "
            f"the first is {file.missing[0]!r}; {remedy}"
        )
    out: list[Capsule] = []
    excess: dict[str, float] = {}
    for link, part, frame in members.on(frames):
        shapes = solids(file, part, frame)
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
    return tuple(out), excess


def limb_visuals(file: Description, members: LimbParts, frames: Array) -> tuple[Visual, ...]:
    """Return the meshes that show a limb; `frames` of base and links have shape (7, 4, 4)."""
    found = tuple(
        mesh.seen_from(link, inverse(frame) @ body_frame(file.data, body))
        for link, part, frame in members.on(frames)
        for body in part
        for mesh in file.visuals.get(body_name(file.model, body), ())
    )
    return found[:MOST_VISUALS]


def links_apart(
    file: Description, members: LimbParts, base: Array, limb: AnyLimb
) -> tuple[tuple[str, str], ...]:
    """Return the pairs of `APART` whose shapes in the file never meet, whatever the joint angles.

    The base of the limb has a frame in the world, shape (4, 4). The upper arm moves in a plane
    beside joint 1, the wrist point lies beside the forearm by d4, and the flange axis beside wrist
    1 by d5. Of arms whose axes are not those of UR none is sought.
    """
    seen = limb.as_ur if isinstance(limb, ChainLimb) else None
    if seen is None:
        return ()
    limb, frames = seen.limb, base @ link_frames(seen.limb, seen.zero)
    shapes = {link: solids(file, part, frame) for link, part, frame in members.on(frames)}

    def farthest(link: str, measure: Callable[[Array], Array]) -> float:
        return max(
            (float(measure(s.points).max()) + s.radius for s in shapes[link]), default=-np.inf
        )

    def across(points: Array) -> Array:
        return np.hypot(points[:, 0], points[:, 1])

    base_top = farthest("base", lambda points: points[:, 2])
    wrist_reach = farthest("wrist_2", lambda points: np.linalg.norm(points, axis=1))
    beside_wrist = limb.d5 - farthest("wrist_1", lambda points: -points[:, 1])
    gripper = max(farthest("gripper", across), gripper_capsule(0.0).radius)
    gaps = {
        ("base", "upper_arm"): _beside(shapes["upper_arm"], limb.d1 - base_top)
        - farthest("base", across),
        ("forearm", "wrist_2"): limb.d4
        - _highest(shapes["forearm"], limb.a3, abs(limb.d5) + wrist_reach)
        - farthest("wrist_2", across),
        ("wrist_1", "wrist_3"): beside_wrist - farthest("wrist_3", across),
        # A capsule of wrist 3 that bulges out counts as the gripper's, see `_link_of`.
        ("wrist_1", "gripper"): beside_wrist - max(gripper, farthest("wrist_3", across)),
    }
    return tuple(pair for pair in APART if gaps[pair] > 0.0)


def _highest(shapes: list[Hull], x: float, radius: float) -> float:
    """Return the largest height over z = 0 of what is nearer to the line at x, y = 0 [m].

    Of the forearm, that is what wrist 2 can reach, which turns about its end.
    """
    most = -np.inf
    for shape in shapes:
        points = _samples(shape)
        close = np.hypot(points[:, 0] - x, points[:, 1]) - shape.radius < radius
        most = max(most, float(points[close, 2].max(initial=-np.inf)) + shape.radius)
    return most


def _beside(shapes: list[Hull], radius: float) -> float:
    """Return the least height over the plane z = 0 of what is farther from the z axis [m].

    Along joint 2, the upper arm's z axis, only what is farther from it than the base lies below can
    be beside the base.
    """
    least = np.inf
    for shape in shapes:
        points = _samples(shape)
        far = np.hypot(points[:, 0], points[:, 1]) + shape.radius > radius
        least = min(least, float(points[far, 2].min(initial=np.inf)) - shape.radius)
    return least


def _samples(shape: Hull) -> Array:
    """Return points spread over a shape's triangles, or over the lines between its corners."""
    if shape.triangles is None:
        a, b = (shape.points[k] for k in np.triu_indices(len(shape.points)))
        share = np.linspace(0.0, 1.0, 11)[:, None, None]
        return (a + share * (b - a)).reshape(-1, 3)
    grid = [(i, j, 6 - i - j) for i in range(7) for j in range(7 - i)]
    points: Array = np.array(grid) @ shape.triangles / 6.0
    return points.reshape(-1, 3)


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
