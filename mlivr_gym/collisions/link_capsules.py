"""Collision checks of the capsules of one limb (compiled).

They are compared with the robot's body, with each other, with other limbs and with boxes. Every
query compares the distance of two axes or of an axis and a box with two lengths: `inner`, radii
plus clearance, and `outer`, inner plus what the shapes may move over an interval. Below `inner` the
answer is the cause, from `outer` on `CLEAR`, between them `UNDECIDED`.

What is clear over an interval need not be compared again on its parts: queries take the items to
compare as bits, see `bit`, and return those that stay undecided beside the answer.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.distances import CLEAR, SELF, UNDECIDED, box_answer, segments_answer
from mlivr_gym.collisions.link_frames import to_world
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

FLUSH = 2e-3
"""A box counts as behind a grasp if it stands out of the surface no more than this [m]."""

EVERY = -1
"""Bits of all items."""


@kernel
def bit(k: int) -> int:
    """The bit of item `k`; items from 62 on share one."""
    return 1 << min(k, 62)


@kernel
def against_boxes(
    ends: Array, motion: Array, todo: int, stop: int, radius: Array, world: tuple[Any, ...],
    gripper: int, point: Array, normal: Array, clearance: float,
) -> tuple[int, int]:  # fmt: skip
    """Capsules up to `stop` against the boxes of a world.

    Args:
        ends: Capsule ends in the world [m], shape (c, 2, 3).
        motion: How far the ends may move in the world [m], shape (c, 2).
        todo: Bits of the capsules to compare.
        stop: One past the last capsule.
        radius: Radii [m], shape (c,).
        world: `BoxWorld.arrays`.
        gripper: Capsules from this one on are at a grasp, and boxes behind that do not count.
        point: The grasp in the world [m], shape (3,).
        normal: Outward surface normal there in the world, shape (3,).
        clearance: Least distance [m].

    Returns:
        An answer, and the bits of the capsules that are undecided.
    """
    boxes, head, start, items, filled = world
    cell, ni, nj, nk = head[15], int(head[16]), int(head[17]), int(head[18])
    undecided = 0
    for c in range(stop):
        if not todo & bit(c):
            continue
        inner = radius[c] + clearance
        at_a, at_b = motion[c, 0], motion[c, 1]
        outer = inner + max(at_a, at_b)
        ax, ay, az = ends[c, 0, 0], ends[c, 0, 1], ends[c, 0, 2]
        bx, by, bz = ends[c, 1, 0], ends[c, 1, 1], ends[c, 1, 2]
        x0, x1 = min(ax, bx) - outer, max(ax, bx) + outer
        y0, y1 = min(ay, by) - outer, max(ay, by) + outer
        z0, z1 = min(az, bz) - outer, max(az, bz) + outer
        if (
            x0 > head[0]
            and y0 > head[1]
            and z0 > head[2]
            and x1 < head[3]
            and y1 < head[4]
            and z1 < head[5]
        ):
            continue
        if (
            x1 < head[6]
            or y1 < head[7]
            or z1 < head[8]
            or x0 > head[9]
            or y0 > head[10]
            or z0 > head[11]
        ):
            continue
        i0, i1 = max(int((x0 - head[12]) / cell), 0), min(int((x1 - head[12]) / cell), ni - 1)
        j0, j1 = max(int((y0 - head[13]) / cell), 0), min(int((y1 - head[13]) / cell), nj - 1)
        k0, k1 = max(int((z0 - head[14]) / cell), 0), min(int((z1 - head[14]) / cell), nk - 1)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    here = (i * nj + j) * nk + k
                    if (
                        x0 > filled[here, 1, 0]
                        or y0 > filled[here, 1, 1]
                        or z0 > filled[here, 1, 2]
                        or x1 < filled[here, 0, 0]
                        or y1 < filled[here, 0, 1]
                        or z1 < filled[here, 0, 2]
                    ):
                        continue
                    for entry in range(start[here], start[here + 1]):
                        b = items[entry]
                        if (
                            x0 > boxes[b, 3] or y0 > boxes[b, 4] or z0 > boxes[b, 5]
                            or x1 < boxes[b, 0] or y1 < boxes[b, 1] or z1 < boxes[b, 2]
                        ):  # fmt: skip
                            continue
                        if c >= gripper and _behind(boxes, b, point, normal):
                            continue
                        px, py, pz = ax - boxes[b, 6], ay - boxes[b, 7], az - boxes[b, 8]
                        dx, dy, dz = bx - ax, by - ay, bz - az
                        if boxes[b, 21] > 0.0:
                            px, py, pz = _turned(boxes, b, px, py, pz)
                            dx, dy, dz = _turned(boxes, b, dx, dy, dz)
                        found = box_answer(
                            (px, py, pz),
                            (dx, dy, dz),
                            (boxes[b, 9], boxes[b, 10], boxes[b, 11]),
                            inner,
                            at_a,
                            at_b,
                        )
                        if found == SELF:
                            return int(boxes[b, 22]), undecided
                        if found == UNDECIDED:
                            # The other boxes matter only if they are touched here.
                            undecided |= bit(c)
                            at_a = at_b = 0.0
                            x0, x1 = min(ax, bx) - inner, max(ax, bx) + inner
                            y0, y1 = min(ay, by) - inner, max(ay, by) + inner
                            z0, z1 = min(az, bz) - inner, max(az, bz) + inner
    return UNDECIDED if undecided else CLEAR, undecided


@kernel
def _turned(boxes: Array, b: int, x: float, y: float, z: float) -> Triple:
    """A vector in the axes of box `b`."""
    return (
        boxes[b, 12] * x + boxes[b, 15] * y + boxes[b, 18] * z,
        boxes[b, 13] * x + boxes[b, 16] * y + boxes[b, 19] * z,
        boxes[b, 14] * x + boxes[b, 17] * y + boxes[b, 20] * z,
    )


@kernel
def _behind(boxes: Array, b: int, point: Array, normal: Array) -> bool:
    """Whether a box lies behind the plane through `point` across `normal`, within `FLUSH`."""
    out = 0.0
    for axis in range(3):
        out += (boxes[b, 6 + axis] - point[axis]) * normal[axis]
    u, v, w = _turned(boxes, b, normal[0], normal[1], normal[2])
    behind: bool = (
        out + abs(u) * boxes[b, 9] + abs(v) * boxes[b, 10] + abs(w) * boxes[b, 11] <= FLUSH
    )
    return behind


@kernel
def body_against_boxes(
    position: Array, rotation: Array, travel: float, swing: float, body: tuple[Any, ...],
    world: tuple[Any, ...], clearance: float,
) -> int:  # fmt: skip
    """The body and the mounts of all limbs against the boxes, at and about a base pose.

    Args:
        position: Base position in the world [m], shape (3,).
        rotation: Base rotation in the world, shape (3, 3).
        travel: How far the base may travel from there [m].
        swing: How far it may turn [rad].
        body: `LimbShapes.body`.
        world: `BoxWorld.arrays`.
        clearance: Least distance [m].

    Returns:
        An answer.
    """
    local, radius = body
    count = len(radius)
    ends, motion = floats(count, 2, 3), floats(count, 2)
    to_world(local, position, rotation, ends)
    for c in range(count):
        for e in range(2):
            rho = np.sqrt(local[c, e, 0] ** 2 + local[c, e, 1] ** 2 + local[c, e, 2] ** 2)
            motion[c, e] = travel + swing * rho
    return against_boxes(
        ends, motion, EVERY, count, radius, world, count, position, position, clearance
    )[0]  # fmt: skip


@kernel
def seen_from(
    row: int, c: int, e: int, shapes: tuple[Any, ...], shift: Array, spin: Array
) -> float:
    """How far end `e` of capsule `c` moves at most, seen from link `row` [m].

    Its anchor moves by `shift`, and its link turns by `spin` about the anchor.
    """
    moved: float = shift[row, shapes[4][c, e]] + shapes[5][c, e] * spin[row, shapes[0][c]]
    return moved


@kernel
def axis_of(ends: Array, c: int) -> tuple[Triple, Triple]:
    """One end of a capsule's axis and the vector from there to the other."""
    x, y, z = ends[c, 0, 0], ends[c, 0, 1], ends[c, 0, 2]
    return (x, y, z), (ends[c, 1, 0] - x, ends[c, 1, 1] - y, ends[c, 1, 2] - z)


@kernel
def boxes_apart(ends: Array, i: int, other: Array, j: int, outer: float) -> bool:
    """Whether some plane across an axis keeps two capsules' axes farther apart than `outer` [m]."""
    for k in range(3):
        if (
            min(ends[i, 0, k], ends[i, 1, k]) - max(other[j, 0, k], other[j, 1, k]) > outer
            or min(other[j, 0, k], other[j, 1, k]) - max(ends[i, 0, k], ends[i, 1, k]) > outer
        ):
            return True
    return False


@kernel
def against_body(
    limb: int, ends: Array, motion: Array, todo: int, shift: Array, spin: Array, share: float,
    shapes: tuple[Any, ...], fixed: tuple[Any, ...], clearance: float,
) -> tuple[int, int]:  # fmt: skip
    """A limb against itself, the body's box and the capsules fixed to the body.

    Args:
        limb: Index of the limb.
        ends: Capsule ends in the body frame [m], shape (c, 2, 3).
        motion: How far each end may move in the body frame [m], shape (c, 2).
        todo: Bits of the pairs of the limb's capsules to compare and, after these, of the capsules
            to compare with the body.
        shift: How far anchors move, seen from each link, see `motion_bounds.joint_motion`.
        spin: How far links turn, seen from each link.
        share: Share of that motion that counts.
        shapes: `LimbShapes.arrays`.
        fixed: `LimbShapes.fixed`.
        clearance: Least distance [m].

    Returns:
        An answer, and the bits of what is undecided.
    """
    link, radius, pairs = shapes[0], shapes[2], shapes[3]
    undecided = 0
    for k in range(pairs.shape[0]):
        if not todo & bit(k):
            continue
        i, j = pairs[k, 0], pairs[k, 1]
        inner = radius[i] + radius[j] + clearance
        at_p = share * seen_from(link[i], j, 0, shapes, shift, spin)
        at_u = share * seen_from(link[i], j, 1, shapes, shift, spin)
        if boxes_apart(ends, i, ends, j, inner + max(at_p, at_u)):
            continue
        q, v = axis_of(ends, i)
        p, u = axis_of(ends, j)
        found = segments_answer(p, u, q, v, inner, 0.0, at_p, at_u)
        if found == SELF:
            return SELF, undecided
        if found == UNDECIDED:
            undecided |= bit(k)
    mounts, mount_radius, half, least_link = fixed
    for c in range(len(link)):
        here = bit(len(pairs) + c)
        if link[c] < 2 or not todo & here:
            continue
        inner = radius[c] + clearance
        outer = inner + max(motion[c, 0], motion[c, 1])
        p, u = axis_of(ends, c)
        found = box_answer(p, u, (half[0], half[1], half[2]), inner, motion[c, 0], motion[c, 1])
        if found == SELF:
            return SELF, undecided
        if found == UNDECIDED:
            undecided |= here
        for m in range(mounts.shape[0]):
            if link[c] < least_link[limb, m] or boxes_apart(
                ends, c, mounts, m, outer + mount_radius[m]
            ):
                continue
            q, v = axis_of(mounts, m)
            found = segments_answer(
                p, u, q, v, inner + mount_radius[m], 0.0, motion[c, 0], motion[c, 1]
            )
            if found == SELF:
                return SELF, undecided
            if found == UNDECIDED:
                undecided |= here
    return UNDECIDED if undecided else CLEAR, undecided


@kernel
def against_limb(
    ends: Array, motion: Array, todo: int, other: Array, other_motion: Array,
    shapes: tuple[Any, ...], clearance: float,
) -> tuple[int, int]:  # fmt: skip
    """Two limbs against each other.

    Args:
        ends: Capsule ends of the first limb [m], shape (c, 2, 3).
        motion: How far each of them may move [m], shape (c, 2).
        todo: Bits of the first limb's capsules to compare.
        other: Capsule ends of the second limb in the same frame [m], shape (c, 2, 3).
        other_motion: How far each of them may move [m], shape (c, 2).
        shapes: `LimbShapes.arrays`.
        clearance: Least distance [m].

    Returns:
        An answer, and the bits of those of the first limb's capsules in `todo` that are undecided.
    """
    radius = shapes[2]
    undecided = 0
    for k in range(3):
        # Limbs that some plane across an axis keeps apart are not compared in pairs.
        low = other_low = np.inf
        high = other_high = -np.inf
        for i in range(len(radius)):
            for e in range(2):
                if todo & bit(i):
                    reach = radius[i] + motion[i, e]
                    low, high = min(low, ends[i, e, k] - reach), max(high, ends[i, e, k] + reach)
                reach = radius[i] + other_motion[i, e]
                other_low = min(other_low, other[i, e, k] - reach)
                other_high = max(other_high, other[i, e, k] + reach)
        if low - other_high > clearance or other_low - high > clearance:
            return CLEAR, undecided
    for i in range(len(radius)):
        if not todo & bit(i):
            continue
        p, u = axis_of(ends, i)
        for j in range(len(radius)):
            inner = radius[i] + radius[j] + clearance
            more = max(other_motion[j, 0], other_motion[j, 1])
            outer = inner + more + max(motion[i, 0], motion[i, 1])
            if boxes_apart(ends, i, other, j, outer):
                continue
            q, v = axis_of(other, j)
            found = segments_answer(p, u, q, v, inner, more, motion[i, 0], motion[i, 1])
            if found == SELF:
                return SELF, undecided
            if found == UNDECIDED:
                undecided |= bit(i)
    return UNDECIDED if undecided else CLEAR, undecided
