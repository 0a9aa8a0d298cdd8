"""Postures: the base pose that belongs to a stance.

Body z lies along the mean outward normal of the held points; yaw (and, for N > 2,
which way round) follows from the Procrustes fit of the mounts' azimuths to the
grasps; the origin is the grasps' centroid plus a height along the normal. Heights
and rolls about the line through the grasps are tried, and the candidate with the
largest margin `min(w_m / w_m_min over limbs, w_b / w_b_min)` is kept, with its branch for
each limb; of equal ones the first. Between opposite walls the mean normal vanishes: there the body
rolls all the way round the line through the grasps.

The result depends on the relative geometry of the grasps alone. It is worked out in
the frame of the first grasp on figures rounded to `RESOLUTION`, once for each geometry.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.base_path import STRAIGHT, certify, expand_classes, flange_in_limb, turn, within_limits
from mlivr_gym.compiled import kernel
from mlivr_gym.grasp_map import GraspMap
from mlivr_gym.manipulability import inverse_root_determinant, limb_information
from mlivr_gym.robot import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.ur_kinematics import SINGULAR, branch_terms

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

RESOLUTION = 1e-7
"""Relative positions [m] and directions that agree within this count as equal."""

OPPOSED = 0.2
"""Mean normals shorter than this belong to stances between opposite walls."""

OPPOSED_HEIGHTS = (0.15, 0.25, 0.35, 0.45)
"""Distances of the base from the line through the grasps tried there [m]."""

OPPOSED_ROLLS = 12
"""Rolls over the full circle tried there."""

TIE = 1e-9
"""A candidate must be better by this share to replace an earlier one."""


@dataclass(frozen=True)
class Postures:
    """Postures of k stances.

    Attributes:
        position: Base positions [m], shape (k, 3).
        rotation: Base rotations, shape (k, 3, 3).
        w_m: Limb manipulability, shape (k, N); 0 where the stance cannot be held.
        w_b: Base manipulability, shape (k,).
        branch: Branch of each limb that gives the margin, shape (k, N).
        mask: Branches and flips each limb may hold on, 16-bit masks, shape (k, N).
    """

    position: Array
    rotation: Array
    w_m: Array
    w_b: Array
    branch: IntArray
    mask: IntArray

    @property
    def reachable(self) -> NDArray[np.bool_]:
        """Whether inverse kinematics has a solution, shape (k,)."""
        return self.w_b > 0.0

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Postures:
        """Postures of the chosen stances."""
        return Postures(
            self.position[index],
            self.rotation[index],
            self.w_m[index],
            self.w_b[index],
            self.branch[index],
            self.mask[index],
        )


def base_frames(grasps: Array, normals: Array, rails: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Unrolled body axes of stances.

    Two limbs: x along the line through the grasps, z along the mean normal's part across that line. More limbs: z
    along the mean normal, or against it where that order of the mounts fits better; x by the Procrustes fit.

    Args:
        grasps: Held points from their centroid [m], shape (k, N, 3).
        normals: Shape (k, N, 3).
        rails: Rail directions at the first grasps, shape (k, 3).

    Returns:
        Body axes as columns, shape (k, 3, 3); outward directions (k, 3); roll axes (k, 3); whether the held walls
        are opposed (k,).
    """
    count = grasps.shape[1]
    line = grasps[:, 0].copy()
    degenerate = (line**2).sum(axis=1) < 1e-12
    line[degenerate] = rails[degenerate]
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    out = normals.mean(axis=1)
    if count == 2:
        out = _across(out, line)
    opposed = (out**2).sum(axis=1) < OPPOSED**2
    sides = np.cross(normals[:, 0], rails)
    around = _across(rails, line)
    along_rail = (around**2).sum(axis=1) < 1e-6
    around[along_rail] = _across(sides, line)[along_rail]
    out[opposed] = around[opposed]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    e1 = _across(rails, out)
    upright = (e1**2).sum(axis=1) < 1e-6
    e1[upright] = _across(sides, out)[upright]
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    e2 = np.cross(out, e1)
    mounts = np.exp(-2j * np.pi * np.arange(count) / count)
    grasp = np.einsum("kni,ki->kn", grasps, e1) + 1j * np.einsum("kni,ki->kn", grasps, e2)
    fit, mirrored = grasp @ mounts, grasp.conj() @ mounts
    other = np.abs(mirrored) > np.abs(fit) * (1.0 + TIE) + TIE
    yaw = np.angle(np.where(other, mirrored.conj(), fit))[:, None]
    x = np.cos(yaw) * e1 + np.sin(yaw) * e2
    z = np.where(other[:, None], -out, out)
    return np.stack([x, np.cross(z, x), z], axis=2), out, line, opposed


def _across(vectors: Array, axes: Array) -> Array:
    """Parts of `vectors` at right angles to the unit `axes`, both (k, 3)."""
    return vectors - axes * (vectors * axes).sum(axis=1, keepdims=True)


@kernel
def limb_choices(
    grasps, normals, tool_length, position, rotation, mount_rotations, mount_positions, lengths, l_c, p, z, w
):
    """Flange poses in the limb frames and `w_m` of the four shoulder and wrist choices, for one base pose.

    Args:
        grasps: Shape (N, 3) [m].
        normals: Shape (N, 3).
        tool_length: Flange to grasp [m].
        position: Base position [m], shape (3,).
        rotation: Shape (3, 3).
        mount_rotations: Shape (N, 3, 3).
        mount_positions: Shape (N, 3) [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        l_c: Characteristic length [m].
        p: Filled with flange positions [m], shape (N, 3).
        z: Filled with flange axes, shape (N, 3).
        w: Filled, shape (N, 4); 0 out of reach.

    Returns:
        The least over the limbs of the best choice.
    """
    unit = abs(lengths[1] * lengths[2]) / l_c**3
    terms = np.empty((4, 4))
    grip, approach = np.empty(3), np.empty(3)
    least = np.inf
    for i in range(grasps.shape[0]):
        for axis in range(3):
            approach[axis] = -normals[i, axis]
            grip[axis] = grasps[i, axis] + tool_length * normals[i, axis]
        flange_in_limb(
            grip, approach, position, rotation, approach, 0.0, mount_rotations[i], mount_positions[i], p[i], z[i]
        )
        branch_terms(p[i], z[i], lengths, terms)
        best = 0.0
        for c in range(4):
            w[i, c] = unit * np.sqrt(terms[c, 3]) if terms[c, 3] > SINGULAR * SINGULAR else 0.0
            best = max(best, w[i, c])
        least = min(least, best)
    return least


@kernel
def combined(information, branch, scratch):
    """`w_b` of one branch for each limb from their `K^-1`, shape (N, 8, 6, 6); `scratch` has shape (2, 6, 6)."""
    for row in range(6):
        for col in range(row + 1):
            total = 0.0
            for i in range(len(branch)):
                total += information[i, branch[i], row, col]
            scratch[0, row, col] = total
    return inverse_root_determinant(scratch[0], scratch[1])


@kernel
def _best_branches(w, information, scale_m, scale_b, floor, branch, trial, scratch):
    """Branches of the largest margin above `floor` for one base pose; returns the margin and its `w_b`.

    `w_b` is formed only where `w_m` leaves room for a better margin; `trial` has shape (N,).
    """
    count = len(branch)
    best, best_wb = floor, 0.0
    top = np.inf
    for i in range(count):
        largest = 0.0
        for c in range(4):
            largest = max(largest, w[i, c])
        top = min(top, largest / scale_m)
    for combination in range(2 * 8**count):
        # The first round takes those whose least `w_m` is the largest there is.
        least = top * (1.0 - TIE) if combination < 8**count else 0.0
        bound = np.inf
        rest = combination
        for i in range(count):
            trial[i] = rest & 7
            rest >>= 3
            bound = min(bound, w[i, trial[i] >> 1])
        bound /= scale_m
        if bound > best * (1.0 + TIE) and bound >= least:
            w_b = combined(information, trial, scratch)
            margin = min(bound, w_b / scale_b)
            if margin > best * (1.0 + TIE):
                best, best_wb = margin, w_b
                for i in range(count):
                    branch[i] = trial[i]
    return best, best_wb


@kernel
def solve_geometries(
    start, stop, grasps, normals, frames, outs, lines, opposed, mount_rotations, mount_positions, lengths,
    tool_length, l_c, heights, rolls, wide_heights, wide_rolls, scale_m, scale_b, position, rotation, w_m, w_b, branch,
):  # fmt: skip
    """Best posture of each geometry from `start` to `stop`.

    Args:
        start: First geometry.
        stop: One past the last.
        grasps: Held points from their centroid [m], shape (k, N, 3).
        normals: Shape (k, N, 3).
        frames: Unrolled body axes, shape (k, 3, 3).
        outs: Outward directions, shape (k, 3).
        lines: Roll axes, shape (k, 3).
        opposed: Whether the walls are opposed, shape (k,).
        mount_rotations: Shape (N, 3, 3).
        mount_positions: Shape (N, 3) [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        tool_length: Flange to grasp [m].
        l_c: Characteristic length [m].
        heights: Heights tried [m].
        rolls: Rolls tried [rad].
        wide_heights: Heights tried between opposed walls [m].
        wide_rolls: Rolls tried there [rad].
        scale_m: Limb manipulability that counts as margin 1.
        scale_b: Base manipulability that counts as margin 1.
        position: Filled, from the centroid, shape (k, 3).
        rotation: Filled, shape (k, 3, 3).
        w_m: Filled, shape (k, N); 0 where nothing is in reach.
        w_b: Filled, shape (k,).
        branch: Filled, shape (k, N).
    """
    count = grasps.shape[1]
    most = max(len(heights) * len(rolls), len(wide_heights) * len(wide_rolls))
    w_class = np.empty((most, count, 4))
    bounds = np.empty(most)
    p, z = np.empty((most, count, 3)), np.empty((most, count, 3))
    turned, origins = np.empty((most, 3, 3)), np.empty((most, 3))
    information, scratch = np.empty((count, 8, 6, 6)), np.empty((2, 6, 6))
    found, trial = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    for g in range(start, stop):
        try_rolls = wide_rolls if opposed[g] else rolls
        try_heights = wide_heights if opposed[g] else heights
        candidates = len(try_rolls) * len(try_heights)
        for c in range(candidates):
            roll = try_rolls[c // len(try_heights)]
            height = try_heights[c % len(try_heights)]
            cosine, sine = np.cos(roll), np.sin(roll)
            for col in range(3):
                turned[c, 0, col], turned[c, 1, col], turned[c, 2, col] = turn(
                    lines[g], cosine, sine, frames[g, 0, col], frames[g, 1, col], frames[g, 2, col]
                )
            up = turn(lines[g], cosine, sine, outs[g, 0], outs[g, 1], outs[g, 2])
            for axis in range(3):
                origins[c, axis] = height * up[axis]
            bounds[c] = limb_choices(
                grasps[g], normals[g], tool_length, origins[c], turned[c], mount_rotations, mount_positions,
                lengths, l_c, p[c], z[c], w_class[c],
            ) / scale_m  # fmt: skip
        margin = 0.0
        w_b[g] = 0.0
        for i in range(count):
            w_m[g, i] = 0.0
        while True:
            c = 0
            for other in range(1, candidates):
                if bounds[other] > bounds[c]:
                    c = other
            if bounds[c] <= margin * (1.0 + TIE) or bounds[c] <= 0.0:
                break
            bounds[c] = 0.0
            for i in range(count):
                for b in range(8):
                    if w_class[c, i, b >> 1] > margin * scale_m:
                        limb_information(
                            p[c, i], z[c, i], lengths, b, mount_rotations[i], mount_positions[i], l_c,
                            information[i, b],
                        )  # fmt: skip
            better, better_wb = _best_branches(w_class[c], information, scale_m, scale_b, margin, found, trial, scratch)
            if better > margin:
                margin = better
                w_b[g] = better_wb
                for axis in range(3):
                    position[g, axis] = origins[c, axis]
                    for col in range(3):
                        rotation[g, axis, col] = turned[c, axis, col]
                for i in range(count):
                    branch[g, i] = found[i]
                    w_m[g, i] = w_class[c, i, found[i] >> 1]


@kernel
def branch_masks(
    start, stop, grasps, normals, position, rotation, branch, mount_rotations, mount_positions, lengths,
    limited, tool_length, lift, l_c, w_m_min, w_b_min, floor, mask,
):  # fmt: skip
    """Branches and flips on which each limb may hold at a posture, a product set.

    A branch belongs if `w_m` meets the threshold, if the limb can depart along the surface normal on it with
    `w_m` above the floor, and if every combination with the other limbs' branches meets the
    threshold of `w_b`. The set grows from the posture's own branches in a fixed order.

    Args:
        start: First stance.
        stop: One past the last.
        grasps: Shape (k, N, 3) [m].
        normals: Shape (k, N, 3).
        position: Base positions, shape (k, 3) [m].
        rotation: Shape (k, 3, 3).
        branch: The postures' own branches, shape (k, N).
        mount_rotations: Shape (N, 3, 3).
        mount_positions: Shape (N, 3) [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        limited: Whether `mask` comes with the branches that the joint limits allow.
        tool_length: Flange to grasp [m].
        lift: Departure along the normal [m].
        l_c: Characteristic length [m].
        w_m_min: Threshold of `w_m`.
        w_b_min: Threshold of `w_b`.
        floor: Least `w_m` on the departure.
        mask: Filled, shape (k, N); 0 for every limb if the posture's own branches do not belong.
    """
    count = grasps.shape[1]
    p, z, w = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 4))
    grip, approach, lifted = np.empty(3), np.empty(3), np.empty(3)
    information, scratch = np.empty((count, 8, 6, 6)), np.empty((2, 6, 6))
    members = np.empty((8**count, count), dtype=np.int64)
    kind = np.int64(STRAIGHT)
    allowed, kept = np.empty((count, 8), dtype=np.bool_), np.empty((count, 8), dtype=np.bool_)
    for g in range(start, stop):
        limb_choices(
            grasps[g], normals[g], tool_length, position[g], rotation[g], mount_rotations, mount_positions,
            lengths, l_c, p, z, w,
        )  # fmt: skip
        for i in range(count):
            classes = np.int64(0)
            for c in range(4):
                if w[i, c] >= w_m_min and w[i, c] >= floor and w[i, c] > 0.0:
                    classes |= 1 << c
            for axis in range(3):
                approach[axis] = -normals[g, i, axis]
                grip[axis] = grasps[g, i, axis] + tool_length * normals[g, i, axis]
                lifted[axis] = position[g, axis] - lift * normals[g, i, axis]
            if classes:
                classes = certify(
                    grip, approach, position[g], rotation[g], lifted, rotation[g], kind, position[g],
                    mount_rotations[i], mount_positions[i], lengths, floor * l_c**3, classes,
                )  # fmt: skip
            bits = expand_classes(classes)
            if limited:
                bits &= mask[g, i]
            mask[g, i] = bits
            for b in range(8):
                allowed[i, b] = (bits | bits >> 8) >> b & 1
                kept[i, b] = False
                if allowed[i, b]:
                    limb_information(
                        p[i], z[i], lengths, b, mount_rotations[i], mount_positions[i], l_c, information[i, b]
                    )
        _grow(allowed, information, branch[g], w_b_min, members, scratch, kept)
        for i in range(count):
            bits = 0
            for b in range(8):
                if kept[i, b]:
                    bits |= 0x0101 << b
            mask[g, i] &= bits


@kernel
def _grow(allowed, information, own, w_b_min, members, scratch, kept):
    """Product set reached from `own` by adding branches one at a time, every combination at or above `w_b_min`.

    `members`, shape (8^N, N), takes the combinations of the set; `kept`, shape (N, 8), says which branches are in it.
    """
    count = len(own)
    for i in range(count):
        members[0, i] = own[i]
        if not allowed[i, own[i]]:
            return
    for i in range(count):
        kept[i, own[i]] = True
    size = 1
    for i in range(count):
        for b in range(8):
            if not allowed[i, b] or kept[i, b]:
                continue
            end = size
            for k in range(size):
                if members[k, i] == own[i]:
                    for j in range(count):
                        members[end, j] = members[k, j]
                    members[end, i] = b
                    if combined(information, members[end], scratch) < w_b_min:
                        end = -1
                        break
                    end += 1
            if end > 0:
                size = end
                kept[i, b] = True


@kernel
def departure_limits(
    grasps, tools, position, rotation, mount_rotations, mount_positions, lengths, limits, tool_length, lift, mask
):
    """Branches and flips on which each limb can depart inside its joint limits, into `mask`, shape (k, N)."""
    for g in range(grasps.shape[0]):
        for i in range(grasps.shape[1]):
            z = tools[g, i, :, 2].copy()
            mask[g, i] = within_limits(
                grasps[g, i] - tool_length * z, tools[g, i], position[g], rotation[g], position[g] + lift * z, rotation[g],
                STRAIGHT, position[g], mount_rotations[i], mount_positions[i], lengths, limits, 0xFFFF,
            )  # fmt: skip


class PostureSolver:
    """Postures of stances on a map, each relative geometry solved once."""

    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Keep the figures of map, robot and thresholds in the kernels' form."""
        self.grasp_map, self.robot, self.settings = grasp_map, robot, settings
        self.mount_rotations = robot.mount_rotations
        self.mount_positions = robot.mount_positions
        self.lengths = robot.limb.lengths
        self.tools = tool_rotations(grasp_map)
        self._rows: dict[bytes, int] = {}
        self._solved = _Table(robot.limbs)

    @property
    def geometries(self) -> int:
        """Number of relative geometries solved so far."""
        return len(self._rows)

    def solve(self, stances: IntArray) -> Postures:
        """Postures of stances given as point indices, shape (k, N)."""
        rows, inverse = self._group(stances)
        new: list[int] = []
        where = np.empty(len(rows), dtype=np.int64)
        for r, row in enumerate(rows):
            key = row.tobytes()
            found = self._rows.get(key)
            if found is None:
                found = self._rows[key] = len(self._rows)
                new.append(r)
            where[r] = found
        if new:
            self._solve_new(rows[np.array(new)])
        local = self._solved.take(where[inverse])
        frames = self.grasp_map.rotations[stances[:, 0]]
        return Postures(
            position=self.grasp_map.positions[stances[:, 0]] + np.einsum("kij,kj->ki", frames, local.position),
            rotation=frames @ local.rotation,
            w_m=local.w_m,
            w_b=local.w_b,
            branch=local.branch,
            mask=local.mask,
        )

    def _group(self, stances: IntArray) -> tuple[IntArray, NDArray[np.intp]]:
        """Distinct relative geometries as whole multiples of `RESOLUTION`, and which one each stance has."""
        positions, rotations = self.grasp_map.positions, self.grasp_map.rotations
        first = stances[:, :1]
        frames = rotations[stances[:, 0]]
        moved = np.einsum("kij,kni->knj", frames, positions[stances[:, 1:]] - positions[first])
        normals = np.einsum("kij,kni->knj", frames, rotations[stances[:, 1:], :, 2])
        rails = np.einsum("kij,kni->knj", frames, rotations[stances[:, 1:], :, 0])
        rows = np.rint(np.concatenate([moved, normals, rails], axis=2) / RESOLUTION).astype(np.int64)
        rows = np.ascontiguousarray(rows.reshape(len(stances), -1))
        rng = np.random.default_rng(0)
        mix = rng.integers(1, 2**62, rows.shape[1], dtype=np.int64) | 1
        with np.errstate(over="ignore"):
            code = (rows * mix).sum(axis=1)
        _, index, inverse = np.unique(code, return_index=True, return_inverse=True)
        if not np.array_equal(rows[index[inverse]], rows):
            _, index, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        return rows[index], inverse

    def _solve_new(self, rows: IntArray) -> None:
        robot, settings = self.robot, self.settings
        k, count = len(rows), robot.limbs
        blocks = rows.reshape(k, count - 1, 9) * RESOLUTION
        grasps, tools = np.zeros((k, count, 3)), np.empty((k, count, 3, 3))
        normals, rails = np.zeros((k, count, 3)), np.zeros((k, count, 3))
        normals[:, 0, 2] = rails[:, 0, 0] = 1.0
        grasps[:, 1:] = blocks[:, :, :3]
        normals[:, 1:] = blocks[:, :, 3:6] / np.linalg.norm(blocks[:, :, 3:6], axis=2, keepdims=True)
        rails[:, 1:] = blocks[:, :, 6:] / np.linalg.norm(blocks[:, :, 6:], axis=2, keepdims=True)
        centroid = grasps.mean(axis=1, keepdims=True)
        grasps -= centroid
        tools[..., 0], tools[..., 2] = rails, -normals
        tools[..., 1] = np.cross(tools[..., 2], tools[..., 0])
        out = Postures(
            np.zeros((k, 3)), np.zeros((k, 3, 3)), np.zeros((k, count)), np.zeros(k),
            np.zeros((k, count), dtype=np.int64), np.zeros((k, count), dtype=np.int64),
        )  # fmt: skip
        w_m_min, w_b_min = settings.thresholds(count)
        scale_m, scale_b = Settings().thresholds(count)
        wide_rolls = 2.0 * np.pi * np.arange(OPPOSED_ROLLS) / OPPOSED_ROLLS
        frames = base_frames(grasps, normals, np.ascontiguousarray(rails[:, 0]))
        in_parallel(
            k, solve_geometries, grasps, normals, *frames, self.mount_rotations, self.mount_positions,
            self.lengths, robot.tool_length, robot.characteristic_length, np.array(robot.heights),
            np.array(robot.rolls), np.array(OPPOSED_HEIGHTS), wide_rolls, w_m_min or scale_m, w_b_min or scale_b,
            out.position, out.rotation, out.w_m, out.w_b, out.branch,
        )  # fmt: skip
        nodes = np.flatnonzero((out.w_b > 0.0) & (out.w_m >= w_m_min).all(axis=1) & (out.w_b >= w_b_min))
        if settings.transitions:
            mask = np.zeros((len(nodes), count), dtype=np.int64)
            if not robot.full_turn:
                departure_limits(
                    grasps[nodes], tools[nodes], out.position[nodes], out.rotation[nodes], self.mount_rotations,
                    self.mount_positions, self.lengths, robot.limb.limits, robot.tool_length, robot.lift, mask,
                )  # fmt: skip
            in_parallel(
                len(nodes), branch_masks, grasps[nodes], normals[nodes], out.position[nodes], out.rotation[nodes],
                out.branch[nodes], self.mount_rotations, self.mount_positions, self.lengths, not robot.full_turn,
                robot.tool_length, robot.lift, robot.characteristic_length, w_m_min, w_b_min,
                settings.path_floor, mask,
            )  # fmt: skip
            out.mask[nodes] = mask
        else:
            out.mask[nodes] = 0xFFFF
        out.position[:] += centroid[:, 0]
        self._solved.append(out)


def in_parallel(count: int, kernel: Callable[..., None], *args: object, first: int = 0, least: int = 2000) -> None:
    """Call a compiled `kernel(start, stop, *args)` over `count` items from `first`, in threads from `least` items on."""
    workers = min(os.cpu_count() or 1, 8) if count >= least else 1
    if workers == 1:
        kernel(first, first + count, *args)
        return
    kernel(first, first, *args)
    edges = [first + count * w // workers for w in range(workers + 1)]
    with ThreadPoolExecutor(workers) as pool:
        for job in [pool.submit(kernel, edges[w], edges[w + 1], *args) for w in range(workers)]:
            job.result()


class _Table:
    """Solved postures in arrays that grow by doubling."""

    def __init__(self, limbs: int) -> None:
        shapes: list[tuple[tuple[int, ...], type]] = [
            ((3,), float), ((3, 3), float), ((limbs,), float), ((), float), ((limbs,), np.int64), ((limbs,), np.int64),
        ]  # fmt: skip
        self._arrays: list[NDArray[Any]] = [np.zeros((0, *shape), dtype=kind) for shape, kind in shapes]
        self._used = 0

    def append(self, new: Postures) -> None:
        parts = (new.position, new.rotation, new.w_m, new.w_b, new.branch, new.mask)
        end = self._used + len(new.w_b)
        for i, part in enumerate(parts):
            if end > len(self._arrays[i]):
                grown = np.zeros((max(end, 2 * len(self._arrays[i])), *part.shape[1:]), dtype=part.dtype)
                grown[: self._used] = self._arrays[i][: self._used]
                self._arrays[i] = grown
            self._arrays[i][self._used : end] = part
        self._used = end

    def take(self, index: IntArray) -> Postures:
        return Postures(*(array[index] for array in self._arrays))


def tool_rotations(grasp_map: GraspMap) -> Array:
    """Flange rotations that grasp each point, flip 0, shape (m, 3, 3): x along the rail, z into the surface."""
    rotations = grasp_map.rotations
    return np.stack([rotations[:, :, 0], -rotations[:, :, 1], -rotations[:, :, 2]], axis=2)
