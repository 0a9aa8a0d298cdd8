"""The proof that a limb without a closed form can follow a base path (compiled).

The joint angles are followed from the start by Newton's method over intervals that are as short as
the bounds of `numeric_bounds` need: on each there is one solution of every pose, so what is found
at its ends and in its middle is one continuous motion. `|det J|` stays above the floor and no joint
leaves its extent on the whole path, not merely at samples. The limb holds if the solution arrives
on the branch on which it began.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.base_path import (
    CLOSEST_PIVOT,
    STRAIGHT,
    BasePath,
    pose_on_path,
    travel_seen,
    turn_seen,
)
from mlivr_gym.kinematics.limb import MountedArm, Track, flange_seen
from mlivr_gym.kinematics.numeric import joint_6, solution, solved, wrist_of
from mlivr_gym.kinematics.numeric_bounds import nearby
from mlivr_gym.kinematics.numeric_chain import Angles5, chain_at
from mlivr_gym.kinematics.poses import Pose, along, columns, vector
from mlivr_gym.kinematics.turns import come_back

FIRST_HALF = 1.0 / 16.0
"""Half of the first interval, as a share of the path; a matter of speed only."""

SHORTEST_HALF = 2.0**-13
"""Half of an interval below which the path counts as failed."""

SAME = 1e-6
"""Difference of angles that are found by solving from two sides [rad]."""


@kernel
def follow_numerically(
    limb: MountedArm, flange: Pose, path: BasePath, floor: float, branch: int, track: Track
) -> bool:
    """Return whether a limb that holds is proved to stay on a branch along a base path.

    The flange is in the world, `floor` the least `|det J|` [m^3]. `track` is filled with the
    extents of the joint angles.
    """
    arm, base = limb.arm, track.base
    if path.kind != STRAIGHT and min(path.radius0, path.radius1) < CLOSEST_PIVOT:
        return False
    _, _, axis = columns(flange.rotation)
    wrist = along(vector(flange.position), -arm.d6, axis)
    pose_on_path(path, 0.0, base)
    seen, x = flange_seen(limb, base, flange)
    found = solution(arm, seen, branch)
    if not found.there:
        return False
    q, last = found.q, joint_6(arm, chain_at(arm, found.q), x)
    s, half = 0.0, FIRST_HALF
    while s < 1.0:
        if s + 2.0 * half > 1.0 - SHORTEST_HALF:
            half = 0.5 * (1.0 - s)
        pose_on_path(path, s + half, base)
        travel = travel_seen(path, base, s + half, half, wrist)
        turned, whole = turn_seen(path, base, half, axis), path.angle * half
        seen, x = flange_seen(limb, base, flange)
        middle = solved(arm, wrist_of(arm, seen), seen.z, q)
        proof = nearby(arm, middle.q, travel, turned)
        if middle.there and proof.middle < floor:
            return False
        there = middle.there and proof.proved and proof.least >= floor
        there = there and _within(middle.q, q, proof.turns)
        end = s + 2.0 * half
        if there:
            last_middle = _nearest(joint_6(arm, chain_at(arm, middle.q), x), last)
            pose_on_path(path, end, base)
            seen, x = flange_seen(limb, base, flange)
            after = solved(arm, wrist_of(arm, seen), seen.z, middle.q)
            there = after.there and _within(middle.q, after.q, proof.turns)
            if there:
                last_after = _nearest(joint_6(arm, chain_at(arm, after.q), x), last_middle)
                turn = whole + _sum(proof.turns)
                there = turn < np.pi
                _extend(track, 5, last_middle, turn, (last - last_middle, last_after - last_middle))
                for k in range(5):
                    change = q[k] - middle.q[k], after.q[k] - middle.q[k]
                    _extend(track, k, middle.q[k], proof.turns[k], change)
        if there:
            q, last, s = after.q, last_after, end
            half *= 2.0
        else:
            half *= 0.5
            if half < SHORTEST_HALF:
                return False
    named = solution(arm, seen, branch)
    return named.there and _same(named.q, q)


@kernel
def _extend(
    track: Track, joint: int, middle: float, bound: float, changes: tuple[float, float]
) -> None:
    """Extend the extent of a joint by its angle in the middle of an interval and its turn [rad]."""
    away = come_back(bound, changes[0], changes[1])
    track.low[joint] = min(track.low[joint], middle - away)
    track.high[joint] = max(track.high[joint], middle + away)


@kernel
def _within(a: Angles5, b: Angles5, most: Angles5) -> bool:
    """Return whether angles differ by no more than bounds, but for what solving leaves."""
    excess = -np.inf
    for k in range(5):
        excess = max(excess, abs(a[k] - b[k]) - most[k])
    return excess <= SAME


@kernel
def _same(a: Angles5, b: Angles5) -> bool:
    """Return whether postures are the same."""
    largest = 0.0
    for k in range(5):
        largest = max(largest, abs(np.sin(0.5 * (a[k] - b[k]))))
    return largest <= SAME


@kernel
def _sum(turns: Angles5) -> float:
    """Return the sum of turns [rad]."""
    return turns.q1 + turns.q2 + turns.q3 + turns.q4 + turns.q5


@kernel
def _nearest(angle: float, reference: float) -> float:
    """Return an angle plus the whole turns that bring it next to another [rad]."""
    turn = 2.0 * np.pi
    wound: float = angle - turn * np.rint((angle - reference) / turn)
    return wound
