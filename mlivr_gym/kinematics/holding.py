"""On which branches a limb that holds can follow a base path (compiled).

A step is an edge of the stance graph only if the limbs that hold can follow the base from the first
to the second posture, on a straight line or on an arc about the held grasps, see `base_path`.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from mlivr_gym.compiled.bit_sets import BRANCHES, has_branch, without_branch, without_flip
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Joints, Record, Vector
from mlivr_gym.kinematics.arm import Arm
from mlivr_gym.kinematics.base_path import BasePath, lift_path, pose_on_path, resting, set_path
from mlivr_gym.kinematics.certificate import Proof, certify
from mlivr_gym.kinematics.families import SINGULAR_TOO
from mlivr_gym.kinematics.limb import MountedArm, angles_at
from mlivr_gym.kinematics.poses import Pose, vector

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
    path: BasePath
    """The path that is followed."""


class Leg(Record):
    """What a limb that holds goes through at a stance and on the way to the next."""

    anew: bool
    """Whether its joints are not followed from the stance before."""
    moves: bool
    """Whether they are followed to the next."""
    kind: int
    """Kind of the base path there."""
    pivot: Vector
    """Centre of an arc [m]."""
    lifts: bool
    """Whether the limb grasps or leaves here, and moves along the normal."""


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
def follow_hold(
    robots: Any, i: int, grasps: Any, bases: Any, legs: Any, branch: int, out: Any, tracks: Any
) -> None:
    """Joint angles of a limb over all stances at which it holds a point.

    Args:
        robots: A row of `Robot`, shape (1,).
        i: Which limb.
        grasps: The point, a row of `Grasp`, shape (1,).
        bases: Bases in the world at the k stances and, if it moves there, the next; rows of `Pose`.
        legs: Rows of `Leg`, shape (k,).
        branch: Branch label.
        out: Rows of `Angles`, shape (k,), filled.
        tracks: A row of `Track`, shape (1,), in which nothing is followed; least and largest angles
            are left there.
    """
    limb, grasp, track = robots[0].limbs[i], grasps[0], tracks[0]
    for k in range(len(legs)):
        leg, path, samples = legs[k], track.path, 0 * SAMPLES
        for joint in range(6):
            if leg.anew:
                track.q[joint] = np.nan
        if leg.moves:
            samples = SAMPLES
            set_path(path, bases[k], bases[k + 1], leg.kind, vector(leg.pivot))
        else:
            resting(path, bases[k])
        follow(limb, grasp.flange, path, branch, samples, track)
        for joint in range(6):
            out[k].q[joint] = track.first[joint]
        if leg.lifts:
            q0, q1, q2, q3, q4, q5 = vector6(track.q)
            for joint in range(6):
                track.q[joint] = track.first[joint]
            lift_path(path, bases[k], grasp, robots[0].lift)
            follow(limb, grasp.flange, path, branch, SAMPLES, track)
            for joint, before in enumerate((q0, q1, q2, q3, q4, q5)):
                track.q[joint] = before


@kernel
def vector6(q: Joints) -> tuple[float, float, float, float, float, float]:
    """Six joint angles [rad]."""
    return q[0], q[1], q[2], q[3], q[4], q[5]


@kernel
def next_angles(limb: MountedArm, base: Pose, flange: Pose, branch: int, q: Joints) -> bool:
    """Joint angles of a limb on the windings nearest to `q`, into `q`; in (-pi, pi] if it is NaN.

    Whether the branch exists.
    """
    q0, q1, q2, q3, q4, q5 = vector6(q)
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
