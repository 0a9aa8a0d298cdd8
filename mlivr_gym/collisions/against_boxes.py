"""Comparison of capsules with the boxes of a grid (compiled).

Every comparison checks the distance between two axes, or between an axis and a box, against two
lengths: `inner`, the radii plus the clearance, and `outer`, which adds how far the shapes may move
over an interval. Below `inner` the result is the cause of the collision, from `outer` on it is
`CLEAR`, and between them it is `UNDECIDED`.

Capsules that are clear over an interval need not be compared again on its halves. Functions for
many capsules therefore take a set of capsules to compare, see `bit_sets`, and return, after the
result, the set of those that are undecided.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.box_grid import BoundingBox, BoxGrid, GridBox
from mlivr_gym.collisions.distances import CLEAR, SELF, UNDECIDED, compare_capsule_with_box
from mlivr_gym.collisions.joint_lines import BaseMove, base_travel
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.collisions.placement import axis_of, capsule_axis
from mlivr_gym.compiled.bit_sets import has, only
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record, Vector
from mlivr_gym.kinematics.poses import Pose, columns, dot, minus, out_of, vector

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

FLUSH = 2e-3
"""A box lies behind a grasp if it protrudes from the surface by no more than this [m]."""

FAR = 0.35
"""Travel from which on only a collision in the middle is looked for [m]: all that is within reach
of a wide search takes long to compare, and is seldom clear. Affects the speed only."""


class GraspSurface(Record):
    """The grasp at which a gripper is, where it may touch the boxes behind the surface."""

    applies: bool
    """Whether the gripper is at a grasp."""
    point: Vector
    """Grasped point in the world [m]."""
    normal: Vector
    """Outward surface normal at that point."""


@kernel
def set_grasp_surface(surface: GraspSurface, point: Triple, normal: Triple) -> None:
    """Set the grasp at which a gripper is: its point and outward surface normal."""
    surface.applies = True
    for k in range(3):
        surface.point[k], surface.normal[k] = point[k], normal[k]


@kernel
def compare_with_grid(
    axis: tuple[Triple, Triple],
    inner: float,
    motion: tuple[float, float],
    grid: BoxGrid,
    surface: GraspSurface,
    at_grasp: bool,
) -> int:
    """Compare a capsule with the boxes of a grid: `CLEAR`, `UNDECIDED`, or the collision's cause.

    The axis has two ends in the world [m], which may move as far as `motion` says [m], linear in
    between; `inner` is the radius plus the clearance [m]. With `at_grasp`, boxes behind the surface
    of a grasp are omitted.
    """
    frame, (a, b), (at_a, at_b) = grid.frames[0], axis, motion
    outer = inner + max(at_a, at_b)
    low, high = segment_bounds(axis, outer)
    if is_inside(low, high, frame.empty_region) or not overlaps(low, high, frame.hull):
        return CLEAR
    o, edge, cells = frame.origin, frame.edge, frame.cells
    boxes, start, items, fill_bounds = grid.boxes, grid.start, grid.items, grid.fill_bounds
    i0, i1 = max(int((low[0] - o[0]) / edge), 0), min(int((high[0] - o[0]) / edge), cells[0] - 1)
    j0, j1 = max(int((low[1] - o[1]) / edge), 0), min(int((high[1] - o[1]) / edge), cells[1] - 1)
    k0, k1 = max(int((low[2] - o[2]) / edge), 0), min(int((high[2] - o[2]) / edge), cells[2] - 1)
    undecided = False
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for k in range(k0, k1 + 1):
                cell = (i * cells[1] + j) * cells[2] + k
                if not overlaps(low, high, fill_bounds[cell]):
                    continue
                for entry in range(start[cell], start[cell + 1]):
                    box = boxes[items[entry]]
                    if not overlaps(low, high, box.bounds):
                        continue
                    if at_grasp and lies_behind(box, surface):
                        continue
                    p = in_box_axes(box, minus(a, vector(box.centre)))
                    d = in_box_axes(box, minus(b, a))
                    result = compare_capsule_with_box(p, d, vector(box.half), inner, (at_a, at_b))
                    if result == SELF:
                        return int(box.cause)
                    if result == UNDECIDED:
                        # From now on only boxes closer than `inner` at the midpoint matter.
                        undecided = True
                        at_a = at_b = 0.0
                        low, high = segment_bounds(axis, inner)
    return UNDECIDED if undecided else CLEAR


@kernel
def segment_bounds(axis: tuple[Triple, Triple], reach: float) -> tuple[Triple, Triple]:
    """Return the lower and upper corner of the box that encloses a segment with a margin [m]."""
    a, b = axis
    return (
        (min(a[0], b[0]) - reach, min(a[1], b[1]) - reach, min(a[2], b[2]) - reach),
        (max(a[0], b[0]) + reach, max(a[1], b[1]) + reach, max(a[2], b[2]) + reach),
    )


@kernel
def is_inside(low: Triple, high: Triple, bounds: BoundingBox) -> bool:
    """Return whether an axis-aligned box lies strictly inside a bounding box."""
    a, b = bounds.low, bounds.high
    strictly: bool = low[0] > a[0] and low[1] > a[1] and low[2] > a[2]
    return strictly and high[0] < b[0] and high[1] < b[1] and high[2] < b[2]


@kernel
def overlaps(low: Triple, high: Triple, bounds: BoundingBox) -> bool:
    """Return whether an axis-aligned box intersects a bounding box."""
    a, b = bounds.low, bounds.high
    meets: bool = low[0] <= b[0] and low[1] <= b[1] and low[2] <= b[2]
    return meets and high[0] >= a[0] and high[1] >= a[1] and high[2] >= a[2]


@kernel
def in_box_axes(box: GridBox, v: Triple) -> Triple:
    """Return a vector in the axes of a box."""
    if not box.is_rotated:
        return v
    x, y, z = columns(box.rotation)
    return dot(x, v), dot(y, v), dot(z, v)


@kernel
def lies_behind(box: GridBox, surface: GraspSurface) -> bool:
    """Return whether a box protrudes by at most `FLUSH` from the surface at a grasp."""
    normal = vector(surface.normal)
    out = dot(minus(vector(box.centre), vector(surface.point)), normal)
    u, v, w = in_box_axes(box, normal)
    lies: bool = out + dot((abs(u), abs(v), abs(w)), vector(box.half)) <= FLUSH
    return lies


@kernel
def compare_limb_with_boxes(
    limb: LimbModel,
    ends: Array,
    travel: Array,
    base: Pose,
    pending: int,
    grid: BoxGrid,
    clearance: float,
    surface: GraspSurface,
) -> tuple[int, int]:
    """Compare the capsules of a limb with the boxes of a grid.

    Their ends are in the body frame of a base in the world, shape (c, 2, 3), their travel in the
    world, (c, 2) [m]. The boxes behind the surface are omitted for the gripper. Returns a result,
    and the undecided capsules of the set `pending`.
    """
    undecided = 0
    for c in range(limb.capsule_count):
        if not has(pending, c):
            continue
        moves, (a, b) = (travel[c, 0], travel[c, 1]), axis_of(ends, c)
        is_far = max(moves[0], moves[1]) > FAR
        if is_far:
            moves = 0.0, 0.0
        axis, at_grasp = (out_of(base, a), out_of(base, b)), surface.applies and c >= limb.gripper
        inner = limb.capsules[c].radius + clearance
        result = compare_with_grid(axis, inner, moves, grid, surface, at_grasp)
        if result > UNDECIDED:
            return result, undecided
        if is_far or result == UNDECIDED:
            undecided |= only(c)
    return UNDECIDED if undecided else CLEAR, undecided


@kernel
def compare_base_with_boxes(
    robot: RobotModel,
    base: Pose,
    move: BaseMove,
    half: float,
    grid: BoxGrid,
    clearance: float,
    nothing: GraspSurface,
) -> int:
    """Compare the body and the mounts of all limbs with boxes while the base moves.

    It moves to either side by half an interval of its way, 0 if it rests; `move` is not read then.
    `nothing` is a record that is not read, since the base is at no grasp.
    """
    undecided = False
    for c in range(robot.base_capsule_count):
        capsule, moves = robot.base_capsules[c], (0.0, 0.0)
        a, b = capsule_axis(capsule.ends)
        if half > 0.0:
            moves = base_travel(move, half, a), base_travel(move, half, b)
        is_far = max(moves[0], moves[1]) > FAR
        if is_far:
            moves = 0.0, 0.0
        axis, at_grasp = (out_of(base, a), out_of(base, b)), c < 0
        inner = capsule.radius + clearance
        result = compare_with_grid(axis, inner, moves, grid, nothing, at_grasp)
        if result > UNDECIDED:
            return result
        undecided = undecided or is_far or result == UNDECIDED
    return UNDECIDED if undecided else CLEAR
