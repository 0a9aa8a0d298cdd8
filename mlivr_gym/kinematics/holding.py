"""On which branches a limb that holds can follow a base path (compiled).

A step is an edge of the stance graph only if the limbs that hold can follow the base from the first
to the second posture, on a straight line or on an arc about the held grasps, see `base_path`.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from mlivr_gym.compiled.bit_sets import BRANCHES, has_branch, without_branch, without_flip
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Joints, Record
from mlivr_gym.kinematics.arm import Arm
from mlivr_gym.kinematics.base_path import BasePath, pose_on_path
from mlivr_gym.kinematics.certificate import Proof, certify
from mlivr_gym.kinematics.families import SINGULAR_TOO
from mlivr_gym.kinematics.limb import MountedArm, angles_at
from mlivr_gym.kinematics.poses import Pose

LIMIT_TOLERANCE = 1e-6
"""How far a joint may pass its limits [rad].

Postures are rounded, and a joint often lies exactly on a half turn.
"""

SAMPLES = cast(int, np.int64(16))
"""Intervals over which joint angles are followed along a path."""


class Track(Record):
    """Joint angles of a limb that are followed along a path."""

    q: Joints
    """Where they are [rad]; NaN for none yet."""
    first: Joints
    """Where they were at the start of the path [rad]."""
    low: Joints
    """The least so far [rad]."""
    high: Joints
    """The largest so far [rad]."""
    base: Pose
    """Base in the world."""


class Holding(Record):
    """Room for the question whether a limb can hold along a path."""

    proof: Proof
    track: Track


@kernel
def begin(track: Track) -> None:
    """Forget what was followed."""
    for joint in range(6):
        track.q[joint], track.low[joint], track.high[joint] = np.nan, np.inf, -np.inf


@kernel
def follow(
    limb: MountedArm, flange: Pose, path: BasePath, branch: int, samples: int, track: Track
) -> bool:
    """Joint angles of a holding limb along a base path, continuous from those of `track`.

    Args:
        limb: The limb.
        flange: Flange in the world.
        path: The base path.
        branch: Branch label.
        samples: Intervals, or 0 for the start alone.
        track: Updated; where it has no angles, those at the start are in (-pi, pi].

    Returns:
        Whether the branch exists all along.
    """
    for sample in range(samples + 1):
        s = sample / samples if samples else 0.0
        pose_on_path(path, s, track.base)
        if not next_angles(limb, track.base, flange, branch, track.q):
            return False
        for joint in range(6):
            if sample == 0:
                track.first[joint] = track.q[joint]
            track.low[joint] = min(track.low[joint], track.q[joint])
            track.high[joint] = max(track.high[joint], track.q[joint])
    return True


@entry
def follow_limb(
    robots: Any, i: int, flange: Pose, path: BasePath, branch: int, samples: int, track: Track
) -> bool:
    """`follow` of limb `i` of a row of `Robot`, shape (1,)."""
    return follow(robots[0].limbs[i], flange, path, branch, samples, track)


@kernel
def next_angles(limb: MountedArm, base: Pose, flange: Pose, branch: int, q: Joints) -> bool:
    """Joint angles of a limb on the windings nearest to `q`, into `q`; in (-pi, pi] if it is NaN.

    Whether the branch exists.
    """
    q0, q1, q2, q3, q4, q5 = q[0], q[1], q[2], q[3], q[4], q[5]
    if not angles_at(limb, base, flange, branch, SINGULAR_TOO, q):
        return False
    for joint, before in enumerate((q0, q1, q2, q3, q4, q5)):
        wanted = before if before == before else 0.0
        q[joint] += 2.0 * np.pi * np.round((wanted - q[joint]) / (2.0 * np.pi))
    return True


@kernel
def within_limits(limb: MountedArm, flange: Pose, path: BasePath, mask: int, track: Track) -> int:
    """Branches and flips in `mask` on which the joint angles stay inside the limits along a path.

    A joint may start on any winding; the flip is a half turn of joint 6.
    """
    for branch in range(BRANCHES):
        if not has_branch(mask, branch):
            continue
        begin(track)
        if not follow(limb, flange, path, branch, SAMPLES, track):
            mask = without_branch(mask, branch)
            continue
        for flip in range(2):
            if not _fits(limb.arm, track, np.pi * flip):
                mask = without_flip(mask, branch, flip)
    return mask


@kernel
def _fits(arm: Arm, track: Track, half_turn: float) -> bool:
    """Whether some winding of each joint keeps what was followed inside the limits."""
    for joint in range(6):
        shift = half_turn if joint == 5 else 0.0
        lowest = arm.limits[joint, 0] - LIMIT_TOLERANCE
        turns = np.ceil((lowest - track.low[joint] - shift) / (2.0 * np.pi))
        last = track.high[joint] + shift + 2.0 * np.pi * turns
        if last > arm.limits[joint, 1] + LIMIT_TOLERANCE:
            return False
    return True


@kernel
def hold_mask(
    limb: MountedArm, flange: Pose, path: BasePath, floor: float, mask: int, room: Holding
) -> int:
    """Those of the branches in `mask` on which one limb can hold along a base path.

    Args:
        limb: The limb.
        flange: Flange in the world, flip 0.
        path: The base path.
        floor: Least `|det J|` [m^3].
        mask: Branches and flips to look at.
        room: Scratch.
    """
    if mask:
        mask = certify(limb, flange, path, floor, mask, room.proof)
    if mask and not limb.arm.full_turn:
        mask = within_limits(limb, flange, path, mask, room.track)
    return mask
