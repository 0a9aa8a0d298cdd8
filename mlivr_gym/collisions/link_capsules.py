"""Compiled collision checks of one limb: shapes in place, distances, and bounds of motion; see `collisions`.

A limb is a set of capsules fixed to its links. What stands round it is the robot's body, the limb's
own links, other limbs, and boxes. Every query compares the distance of two axes or of an axis and a
box with two lengths: `inner`, radii plus clearance, and `outer`, inner plus what the shapes may
move over an interval. Below `inner` the answer is the cause, from `outer` on `CLEAR`, between them
`UNDECIDED`.

What is clear over an interval need not be looked at again on its parts: queries take the items to
look at as bits, see `bit`, and return those that stay undecided beside the answer.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.distances import CLEAR, SELF, UNDECIDED, box_answer, segments_answer
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.ur import limb_axes

FLUSH = 2e-3
"""A box counts as behind a grasp if it stands out beyond the surface no more than this [m]."""

EVERY = np.int64(-1)
"""Bits of all items."""


@kernel
def bit(k):
    """The bit of item `k`; items from 62 on share one."""
    return np.int64(1) << min(k, 62)


@kernel
def frames_of_branch(p, z, lengths, branch, frames):
    """Link frames in the limb base frame of one inverse-kinematics branch, without forming joint angles.

    Args:
        p: Flange position in the limb base frame [m], shape (3,).
        z: Flange axis, shape (3,).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        branch: Branch label.
        frames: Shape (7, 4, 3), filled for links 0 (fixed) to 6 with origin [m] and axes x, y, z,
            those of the manufacturer's link frames; x and y of link 6 are any pair across the
            flange axis.

    Returns:
        Whether the pose is within reach.
    """
    axes, origins = floats(6, 3), floats(6, 3)
    if not limb_axes(p, z, lengths, branch, axes, origins):
        return False
    a2, a3, d4 = lengths[1], lengths[2], lengths[3]
    _fixed_frames(lengths, -axes[1, 1], axes[1, 0], frames)
    for k in range(3):
        frames[2, 0, k] = origins[1, k]
        frames[2, 1, k] = (origins[2, k] - origins[1, k]) / a2
        frames[3, 0, k] = origins[2, k]
        frames[3, 1, k] = (origins[3, k] - origins[2, k]) / a3
        frames[4, 0, k] = origins[3, k] + d4 * axes[1, k]
        frames[4, 2, k] = -axes[4, k]
        frames[5, 0, k] = origins[4, k]
        frames[5, 2, k] = axes[5, k]
        frames[5, 3, k] = axes[4, k]
        frames[6, 0, k] = p[k]
        frames[6, 3, k] = z[k]
        for link in range(2, 5):
            frames[link, 3, k] = axes[1, k]
    _cross(frames, 2, 3, 1, 2)
    _cross(frames, 3, 3, 1, 2)
    _cross(frames, 4, 2, 3, 1)
    _cross(frames, 5, 2, 3, 1)
    for k in range(3):
        frames[6, 1, k] = frames[5, 1, k]
    _cross(frames, 6, 3, 1, 2)
    return True


@kernel
def frames_of_angles(q, lengths, frames):
    """Link frames in the limb base frame of joint angles `q`, shape (6,) [rad]; see `frames_of_branch`."""
    d1, a2, a3, d4, d5, d6 = lengths
    c1, s1 = np.cos(q[0]), np.sin(q[0])
    _fixed_frames(lengths, c1, s1, frames)
    angle = 0.0
    for link in range(2, 5):
        angle += q[link - 1]
        c, s = np.cos(angle), np.sin(angle)
        frames[link, 1, 0], frames[link, 1, 1], frames[link, 1, 2] = c * c1, c * s1, s
        frames[link, 2, 0], frames[link, 2, 1], frames[link, 2, 2] = -s * c1, -s * s1, c
        frames[link, 3, 0], frames[link, 3, 1], frames[link, 3, 2] = s1, -c1, 0.0
    c5, s5 = np.cos(q[4]), np.sin(q[4])
    for k in range(3):
        frames[2, 0, k] = frames[1, 0, k]
        frames[3, 0, k] = frames[2, 0, k] + a2 * frames[2, 1, k]
        frames[4, 0, k] = frames[3, 0, k] + a3 * frames[3, 1, k] + d4 * frames[4, 3, k]
        frames[5, 0, k] = frames[4, 0, k] - d5 * frames[4, 2, k]
        frames[5, 1, k] = c5 * frames[4, 1, k] + s5 * frames[4, 3, k]
        frames[5, 2, k] = c5 * frames[4, 3, k] - s5 * frames[4, 1, k]
        frames[5, 3, k] = -frames[4, 2, k]
        frames[6, 0, k] = frames[5, 0, k] + d6 * frames[5, 2, k]
        frames[6, 1, k] = frames[5, 1, k]
        frames[6, 2, k] = -frames[5, 3, k]
        frames[6, 3, k] = frames[5, 2, k]


@kernel
def _fixed_frames(lengths, c1, s1, frames):
    """Frames of the limb's base and of the shoulder, whose joint has cosine `c1` and sine `s1`."""
    for link in range(2):
        for row in range(4):
            for k in range(3):
                frames[link, row, k] = 1.0 if row == k + 1 else 0.0
    frames[1, 0, 2] = lengths[0]
    frames[1, 1, 0], frames[1, 1, 1] = c1, s1
    frames[1, 2, 0], frames[1, 2, 1] = -s1, c1


@kernel
def _cross(frames, link, a, b, out):
    """Cross product of two rows of a link's frame into a third."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        frames[link, out, k] = (
            frames[link, a, i] * frames[link, b, j] - frames[link, a, j] * frames[link, b, i]
        )


@kernel
def place(frames, shapes, mount_rotation, mount_position, ends):
    """Ends of a limb's capsules in the body frame, into `ends`, shape (c, 2, 3) [m]."""
    link, local = shapes[0], shapes[1]
    for c in range(len(link)):
        f = link[c]
        for e in range(2):
            x, y, z = local[c, e, 0], local[c, e, 1], local[c, e, 2]
            u = frames[f, 0, 0] + x * frames[f, 1, 0] + y * frames[f, 2, 0] + z * frames[f, 3, 0]
            v = frames[f, 0, 1] + x * frames[f, 1, 1] + y * frames[f, 2, 1] + z * frames[f, 3, 1]
            w = frames[f, 0, 2] + x * frames[f, 1, 2] + y * frames[f, 2, 2] + z * frames[f, 3, 2]
            for k in range(3):
                ends[c, e, k] = (
                    mount_position[k]
                    + mount_rotation[k, 0] * u
                    + mount_rotation[k, 1] * v
                    + mount_rotation[k, 2] * w
                )


@kernel
def to_world(ends, position, rotation, out):
    """Capsule ends from the body frame to the world, shape (c, 2, 3) [m]."""
    for c in range(ends.shape[0]):
        for e in range(2):
            x, y, z = ends[c, e, 0], ends[c, e, 1], ends[c, e, 2]
            for k in range(3):
                out[c, e, k] = (
                    position[k] + rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
                )


@kernel
def against_boxes(ends, motion, todo, stop, radius, world, gripper, point, normal, clearance):
    """Capsules up to `stop` against the boxes of a world.

    Args:
        ends: Capsule ends in the world [m], shape (c, 2, 3).
        motion: How far the ends may move in the world [m], shape (c, 2).
        todo: Bits of the capsules to look at.
        stop: One past the last capsule.
        radius: Radii [m], shape (c,).
        world: `BoxWorld.arrays`.
        gripper: Capsules from this one on are at a grasp, and boxes behind that do not count.
        point: The grasp [m], shape (3,).
        normal: Outward surface normal there, shape (3,).
        clearance: Least distance [m].

    Returns:
        An answer, and the bits of the capsules that are undecided.
    """
    boxes, head, start, items, filled = world
    cell, ni, nj, nk = head[15], int(head[16]), int(head[17]), int(head[18])
    left = np.int64(0)
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
                        x0 > filled[here, 1, 0] or y0 > filled[here, 1, 1] or z0 > filled[here, 1, 2]
                        or x1 < filled[here, 0, 0] or y1 < filled[here, 0, 1] or z1 < filled[here, 0, 2]
                    ):  # fmt: skip
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
                            return int(boxes[b, 22]), left
                        if found == UNDECIDED:
                            # The other boxes matter only if they are touched here.
                            left |= bit(c)
                            at_a = at_b = 0.0
                            x0, x1 = min(ax, bx) - inner, max(ax, bx) + inner
                            y0, y1 = min(ay, by) - inner, max(ay, by) + inner
                            z0, z1 = min(az, bz) - inner, max(az, bz) + inner
    return UNDECIDED if left else CLEAR, left


@kernel
def _turned(boxes, b, x, y, z):
    """A vector in the axes of box `b`."""
    return (
        boxes[b, 12] * x + boxes[b, 15] * y + boxes[b, 18] * z,
        boxes[b, 13] * x + boxes[b, 16] * y + boxes[b, 19] * z,
        boxes[b, 14] * x + boxes[b, 17] * y + boxes[b, 20] * z,
    )


@kernel
def _behind(boxes, b, point, normal):
    """Whether a box lies behind the plane through `point` across `normal`, or stands out of it by `FLUSH` at most."""
    out = 0.0
    for axis in range(3):
        out += (boxes[b, 6 + axis] - point[axis]) * normal[axis]
    u, v, w = _turned(boxes, b, normal[0], normal[1], normal[2])
    return out + abs(u) * boxes[b, 9] + abs(v) * boxes[b, 10] + abs(w) * boxes[b, 11] <= FLUSH


@kernel
def body_against_boxes(position, rotation, travel, swing, body, world, clearance):
    """The body and the mounts of all limbs against the boxes, at and about a base pose; an answer.

    Args:
        position: Base position [m], shape (3,).
        rotation: Base rotation, shape (3, 3).
        travel: How far the base may travel from there [m].
        swing: How far it may turn [rad].
        body: `LimbShapes.body`.
        world: `BoxWorld.arrays`.
        clearance: Least distance [m].
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
def seen_from(row, c, e, shapes, shift, spin):
    """How far end `e` of capsule `c` moves at most, seen from link `row`: its anchor's motion and its link's turn [m]."""
    return shift[row, shapes[4][c, e]] + shapes[5][c, e] * spin[row, shapes[0][c]]


@kernel
def axis_of(ends, c):
    """One end of a capsule's axis and the way to the other."""
    x, y, z = ends[c, 0, 0], ends[c, 0, 1], ends[c, 0, 2]
    return (x, y, z), (ends[c, 1, 0] - x, ends[c, 1, 1] - y, ends[c, 1, 2] - z)


@kernel
def boxes_apart(ends, i, other, j, outer):
    """Whether some plane across an axis keeps two capsules' axes farther apart than `outer` [m]."""
    for k in range(3):
        if (
            min(ends[i, 0, k], ends[i, 1, k]) - max(other[j, 0, k], other[j, 1, k]) > outer
            or min(other[j, 0, k], other[j, 1, k]) - max(ends[i, 0, k], ends[i, 1, k]) > outer
        ):
            return True
    return False


@kernel
def against_body(limb, ends, motion, todo, shift, spin, share, shapes, fixed, clearance):
    """A limb against its own links, the body's box and the fixed capsules on it, in the body frame.

    Args:
        limb: Index of the limb.
        ends: Shape (c, 2, 3) [m].
        motion: How far each end may move in the body frame [m], shape (c, 2).
        todo: Bits of the pairs of own links to look at and, after these, of the capsules to compare
            with the body.
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
    left = np.int64(0)
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
            return SELF, left
        if found == UNDECIDED:
            left |= bit(k)
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
            return SELF, left
        if found == UNDECIDED:
            left |= here
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
                return SELF, left
            if found == UNDECIDED:
                left |= here
    return UNDECIDED if left else CLEAR, left


@kernel
def against_limb(ends, motion, todo, other, other_motion, shapes, clearance):
    """Two limbs against each other: their capsule ends in one frame and how far these may move [m].

    Returns:
        An answer, and the bits of those of the first limb's capsules in `todo` that are undecided.
    """
    radius = shapes[2]
    left = np.int64(0)
    for k in range(3):
        # Limbs that some plane across an axis keeps apart are not looked at in pairs.
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
            return CLEAR, left
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
                return SELF, left
            if found == UNDECIDED:
                left |= bit(i)
    return UNDECIDED if left else CLEAR, left
