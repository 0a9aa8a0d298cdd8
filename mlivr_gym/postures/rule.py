"""The rule by which one of a stance's candidates becomes its posture (compiled); see `solver`."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.link_capsules import body_against_boxes
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.manipulability import limb_information
from mlivr_gym.postures.branches import apart, combined, forget, limb_status, self_clearance

TIE = 1e-9
"""Margins that differ by this share or less count as equal."""

CLEARANCE_TIE = 1e-9
"""Clearances of the robot to itself that differ by this or less count as equal [m]."""


@kernel
def enter(
    c: int, floor: float, look: bool, poses: tuple[Any, ...], centre: Array, normals: Array,
    arm: tuple[Any, ...], scale_m: float, checker: tuple[Any, ...], room: tuple[Any, ...],
) -> bool:  # fmt: skip
    """Prepare candidate `c` of a stance.

    What its branches touch is not known any more; `K^-1` of those above a margin is worked out.

    Args:
        c: Index of the candidate.
        floor: Margin that branches must exceed.
        look: Whether the body must touch no box.
        poses: Of every candidate: flange positions and axes in the limb base frames, `w_m` of the
            choices, base positions from the centroid [m] and base rotations.
        centre: Centroid of the grasps in the world of `checker` [m], shape (3,).
        normals: Surface normals in that world, shape (N, 3).
        arm: Rotations and positions of the mounts in the body frame, lengths, characteristic
            length.
        scale_m: Limb manipulability that counts as margin 1.
        checker: See `branches.limb_status`.
        room: Scratch arrays: `K^-1`, work, trial, status, pairs, ends, base position in the world.

    Returns:
        Whether the candidate may be looked at.
    """
    p, z, w, origins, turned = poses
    mount_rotations, mount_positions, lengths, l_c = arm
    information, _, _, status, pairs, _, position = room
    forget(status, pairs)
    for axis in range(3):
        position[axis] = centre[axis] + origins[c, axis]
    world, clearance, body = checker[4], checker[5], checker[6]
    if look and body_against_boxes(position, turned[c], 0.0, 0.0, body, world, clearance) != CLEAR:
        return False
    for i in range(normals.shape[0]):
        for b in range(8):
            if w[c, i, b >> 1] > floor * scale_m:
                limb_information(
                    p[c, i], z[c, i], lengths, b, mount_rotations[i], mount_positions[i], l_c,
                    information[i, b],
                )  # fmt: skip
    return True


@kernel
def touches_nothing(
    c: int, poses: tuple[Any, ...], points: Array, normals: Array, arm: tuple[Any, ...],
    checker: tuple[Any, ...], room: tuple[Any, ...],
) -> bool:  # fmt: skip
    """Whether the limbs touch nothing on the branches `trial` of `room` at candidate `c`."""
    p, z, _, _, turned = poses
    mount_rotations, mount_positions, lengths, _ = arm
    _, _, trial, status, pairs, ends, position = room
    for i in range(len(trial)):
        if limb_status(
            i, trial[i], p[c, i], z[c, i], position, turned[c], points[i], normals[i],
            mount_rotations[i],
            mount_positions[i], lengths, checker, status, ends,
        ) != CLEAR:  # fmt: skip
            return False
    return apart(trial, ends, pairs, checker)


@kernel
def _trial_bound(
    combination: int, w: Array, scale_m: float, trial: IntArray, status: IntArray
) -> float:
    """Set `trial` to the branches that `combination` stands for.

    Returns:
        Their least `w_m` as a margin, 0 if one touches something.
    """
    bound = np.inf
    for i in range(len(trial)):
        trial[i] = combination & 7
        combination >>= 3
        bound = min(bound, w[i, trial[i] >> 1] if status[i, trial[i]] <= CLEAR else 0.0)
    return bound / scale_m


@kernel
def _largest_margin(
    floor: float, look: bool, poses: tuple[Any, ...], first_bounds: Array, bounds: Array,
    centre: Array, points: Array, normals: Array, arm: tuple[Any, ...], scale_m: float,
    scale_b: float, checker: tuple[Any, ...], room: tuple[Any, ...],
) -> float:  # fmt: skip
    """Largest margin above `floor` of all candidates and branches of one stance, or `floor`.

    With `look` only those count that touch nothing; they are checked when their margin would be the
    largest. `w_b` is formed only where `w_m` leaves room for a larger margin. Arguments as in
    `enter`; `bounds` is scratch.
    """
    information, work, trial, status = room[0], room[1], room[2], room[3]
    count, w = len(trial), poses[2]
    margin = floor
    for c in range(len(bounds)):
        bounds[c] = first_bounds[c]
    while True:
        c = 0
        for other in range(1, len(bounds)):
            if bounds[other] > bounds[c]:
                c = other
        if bounds[c] <= margin or bounds[c] <= 0.0:
            return margin
        top, bounds[c] = bounds[c], 0.0
        if not enter(c, margin, look, poses, centre, normals, arm, scale_m, checker, room):
            continue
        for combination in range(2 * 8**count):
            # The first round takes those whose least `w_m` is the largest there is.
            least = top * (1.0 - TIE) if combination < 8**count else 0.0
            bound = _trial_bound(combination, w[c], scale_m, trial, status)
            if bound > margin and bound >= least:
                found = min(bound, combined(information, trial, work) / scale_b)
                if found > margin and (
                    not look or touches_nothing(c, poses, points, normals, arm, checker, room)
                ):
                    margin = found


@kernel
def _choose(
    margin: float, poses: tuple[Any, ...], first_bounds: Array, centre: Array, points: Array,
    normals: Array, arm: tuple[Any, ...], scale_m: float, scale_b: float, checker: tuple[Any, ...],
    fixed: tuple[Any, ...], room: tuple[Any, ...], branch: IntArray,
) -> tuple[int, float]:  # fmt: skip
    """The posture that the rule takes of those that tie with the largest margin and touch nothing.

    They tie if their margin is `margin` within `TIE`. The rule takes that with the largest
    clearance of the robot to itself; of those within `CLEARANCE_TIE` the first, in the order of
    candidates and then of branch labels.

    Returns:
        Its candidate, or -1 if all touch something, and its `w_b`; `branch` is filled.
    """
    information, work, trial, status, ends = room[0], room[1], room[2], room[3], room[5]
    count, w, shapes = len(trial), poses[2], checker[0]
    least = margin * (1.0 - TIE)
    chosen, gap, best_wb = -1, -np.inf, 0.0
    for c in range(len(first_bounds)):
        if first_bounds[c] < least or not enter(
            c, least * (1.0 - TIE), True, poses, centre, normals, arm, scale_m, checker, room
        ):
            continue
        for combination in range(8**count):
            if _trial_bound(combination, w[c], scale_m, trial, status) < least:
                continue
            w_b = combined(information, trial, work)
            if w_b / scale_b < least or not touches_nothing(
                c, poses, points, normals, arm, checker, room
            ):
                continue
            found = self_clearance(trial, ends, shapes, fixed, gap)
            if chosen < 0 or found > gap + CLEARANCE_TIE:
                chosen, gap, best_wb = c, found, w_b
                for i in range(count):
                    branch[i] = trial[i]
    return chosen, best_wb


@kernel
def best_posture(
    floor: float, lazily: bool, poses: tuple[Any, ...], first_bounds: Array, bounds: Array,
    centre: Array, points: Array, normals: Array, arm: tuple[Any, ...], scale_m: float,
    scale_b: float, checker: tuple[Any, ...], fixed: tuple[Any, ...], room: tuple[Any, ...],
    branch: IntArray,
) -> tuple[int, float, float]:  # fmt: skip
    """The posture that the rule takes of those of a margin above `floor` that touch nothing.

    With `lazily` shapes are compared only where the margin is the largest of all, touching or not;
    what is found is the same.

    Returns:
        Its candidate, or -1 if there is none, its `w_b`, and the largest margin that was seen;
        `branch` is filled.
    """
    chosen, w_b, seen = -1, 0.0, floor
    for look in range(2):
        if look == 0 and not lazily:
            continue
        margin = _largest_margin(
            floor,
            look > 0,
            poses,
            first_bounds,
            bounds,
            centre,
            points,
            normals,
            arm,
            scale_m,
            scale_b,
            checker,
            room,
        )
        seen = max(seen, margin)
        if margin > floor:
            chosen, w_b = _choose(
                margin,
                poses,
                first_bounds,
                centre,
                points,
                normals,
                arm,
                scale_m,
                scale_b,
                checker,
                fixed,
                room,
                branch,
            )
        if chosen >= 0 or margin <= floor:
            break
    return chosen, w_b, seen
