"""Branches on which a support limb can follow a base path (compiled).

A step is an edge of the stance graph only if the support limbs can follow the base from the first
to the second posture, on a straight line or on an arc about the held grasps, see `base_path`, with
every joint in its window, see `arm.in_window`. That `w_m` stays above a floor is proved, see
`certificate`; joint angles are checked at samples, the ends of `FEW` intervals of the path, or of
`MANY` if a joint turns by more than an eighth of a turn in one of the few, or comes near a limit.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from mlivr_gym.compiled.bit_sets import BRANCHES, has_branch, without_flip
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Joints, Record
from mlivr_gym.kinematics.arm import LIMIT_TOLERANCE, NUMERIC, TURN, Arm, in_window
from mlivr_gym.kinematics.base_path import BasePath, pose_on_path
from mlivr_gym.kinematics.certificate import Proof, certify
from mlivr_gym.kinematics.families import SINGULAR_TOO
from mlivr_gym.kinematics.limb import Angles, MountedArm, Track, angles_at, begin
from mlivr_gym.kinematics.numeric_path import follow_numerically
from mlivr_gym.kinematics.poses import Pose

FEW, MANY = (cast(int, k) for k in np.array([4, 32]))
"""Numbers of intervals at whose ends joint angles are computed along a path."""

FAR = 0.25 * np.pi
"""Turn of a joint over one of `FEW` intervals above which there are `MANY` [rad]."""

REFINED, MARGIN = 1.0, 0.25
"""Distances from a joint limit, in units of the largest change of a joint's turn between intervals.

Closer than `REFINED` there are `MANY` intervals, whose samples keep `MARGIN`: a joint that turns
back between samples passes them by an eighth of that change if its angle is a parabola.
"""


class Holding(Record):
    """Scratch of the check whether a limb can hold along a path."""

    proof: Proof
    track: Track


@kernel
def follow(
    limb: MountedArm, flange: Pose, path: BasePath, branch: int, samples: int, track: Track
) -> bool:
    """Follow the joint angles of a limb that holds along a base path, on from those of `track`.

    The flange is in the world, `samples` the number of intervals. Where the track, which is
    updated, has no angles, those at the start are in (-pi, pi]. Returned is whether the branch
    exists all along.
    """
    for sample in range(samples + 1):
        pose_on_path(path, sample / samples, track.base)
        before = vector6(track.q)
        if not next_angles(limb, track.base, flange, branch, track.q):
            return False
        for joint, last in enumerate(before):
            q = track.q[joint]
            track.low[joint] = min(track.low[joint], q)
            track.high[joint] = max(track.high[joint], q)
            if last == last:
                turn, earlier = q - last, track.turn[joint]
                track.farthest = max(track.farthest, abs(turn))
                if earlier == earlier:
                    track.bend = max(track.bend, abs(turn - earlier))
                track.turn[joint] = turn
    return True


@kernel
def vector6(q: Joints) -> tuple[float, float, float, float, float, float]:
    """Return six joint angles as a tuple [rad]."""
    return q[0], q[1], q[2], q[3], q[4], q[5]


@kernel
def next_angles(limb: MountedArm, base: Pose, flange: Pose, branch: int, q: Joints) -> bool:
    """Write the joint angles of a limb into `q`, by whole turns nearest to those in it.

    Where `q` is NaN they lie in (-pi, pi]. Returns whether the branch exists.
    """
    q0, q1, q2, q3, q4, q5 = vector6(q)
    if not angles_at(limb, base, flange, branch, SINGULAR_TOO, q):
        return False
    for joint, before in enumerate((q0, q1, q2, q3, q4, q5)):
        wanted = before if before == before else 0.0
        q[joint] += 2.0 * np.pi * np.rint((wanted - q[joint]) / (2.0 * np.pi))
    return True


@kernel
def in_windows(
    limb: MountedArm, flange: Pose, path: BasePath, branch_set: int, track: Track
) -> int:
    """Return those of `branch_set` on which every joint stays in its window at samples of a path.

    The flip is a half turn of joint 6.
    """
    for branch in range(BRANCHES):
        if not has_branch(branch_set, branch):
            continue
        begin(track)
        there = follow(limb, flange, path, branch, FEW, track)
        if there and (track.farthest > FAR or _needs_more(limb.arm, track)):
            begin(track)
            there = follow(limb, flange, path, branch, MANY, track)
        for flip in range(2):
            if not (there and _fits(limb.arm, track, np.pi * flip, MARGIN)):
                branch_set = without_flip(branch_set, branch, flip)
    return branch_set


@kernel
def _needs_more(arm: Arm, track: Track) -> bool:
    """Return whether a joint that stayed in its window at samples may leave it in between."""
    for flip in range(2):
        half_turn = np.pi * flip
        if _fits(arm, track, half_turn, 0.0) and not _fits(arm, track, half_turn, REFINED):
            return True
    return False


@kernel
def _fits(arm: Arm, track: Track, half_turn: float, share: float) -> bool:
    """Return whether every joint stayed in its window, joint 6 turned by `half_turn` [rad].

    From ends of windows that are joint limits it must stay away by `share` of the bend. A window of
    a whole turn has none: a joint that leaves it has another winding at the next sample.
    """
    for joint in range(6):
        least, most = arm.window[joint, 0], arm.window[joint, 1]
        margin = share * track.bend if most - least < TURN - 4.0 * LIMIT_TOLERANCE else 0.0
        shift = half_turn if joint == 5 else 0.0
        first = in_window(track.low[joint] + shift, least)
        last = first + track.high[joint] - track.low[joint]
        if last > most - margin + LIMIT_TOLERANCE:
            return False
        if margin > 0.0 and first < least + margin - LIMIT_TOLERANCE:
            return False
    return True


@kernel
def _held_numerically(
    limb: MountedArm, flange: Pose, path: BasePath, floor: float, branch_set: int, track: Track
) -> int:
    """Return the branches of `branch_set` on which a limb without a closed form can hold."""
    for branch in range(BRANCHES):
        if not has_branch(branch_set, branch):
            continue
        begin(track)
        there = follow_numerically(limb, flange, path, floor, branch, track)
        for flip in range(2):
            if not (there and _fits(limb.arm, track, np.pi * flip, 0.0)):
                branch_set = without_flip(branch_set, branch, flip)
    return branch_set


@kernel
def held_branches(
    limb: MountedArm, flange: Pose, path: BasePath, floor: float, branch_set: int, scratch: Holding
) -> int:
    """Return the branches of `branch_set` on which one limb can hold along a base path.

    The flange is in the world, with flip 0, and `floor` the least `|det J|` [m^3].
    """
    if limb.arm.family == NUMERIC:
        return _held_numerically(limb, flange, path, floor, branch_set, scratch.track)
    if branch_set:
        branch_set = certify(limb, flange, path, floor, branch_set, scratch.proof)
    if branch_set:
        branch_set = in_windows(limb, flange, path, branch_set, scratch.track)
    return branch_set


@entry
def joints_along(
    robots: Any, i: int, bases: Any, flanges: Any, branch: int, reference: Angles, out: Any
) -> int:
    """Compute joint angles of a limb on one branch at many poses, continuous from given ones.

    Bases in the world are rows of `Pose`, shape (k,), or (1,) for one that stays; flanges likewise,
    up to a half turn about their z axes. `reference` has angles close to those at the first pose,
    which determine windings and flip. Rows of `Angles`, shape (k,), are filled; returned is the
    number of poses from the first on at which the branch exists.
    """
    limb, half_turn = robots[0].limbs[i], 0.0
    for k in range(len(out)):
        base, flange = bases[min(k, len(bases) - 1)], flanges[min(k, len(flanges) - 1)]
        q = out[k].q
        for joint in range(6):
            q[joint] = reference.q[joint] if k == 0 else out[k - 1].q[joint]
        if k == 0:
            if not angles_at(limb, base, flange, branch, SINGULAR_TOO, q):
                return k
            if np.cos(reference.q[5] - q[5]) < 0.0:
                half_turn = np.pi
            for joint in range(6):
                q[joint] = reference.q[joint]
        q[5] -= half_turn
        if not next_angles(limb, base, flange, branch, q):
            return k
        q[5] += half_turn
    return len(out)
