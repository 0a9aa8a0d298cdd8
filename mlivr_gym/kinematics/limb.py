"""A limb as the compiled kinematics see it: an arm mounted on the base."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import BRANCHES
from mlivr_gym.compiled.kernels import kernel, late_entry
from mlivr_gym.compiled.records import Joints, Record
from mlivr_gym.kinematics.chain import TURN, Chain, FlangeAxis, in_window
from mlivr_gym.kinematics.inverse import SINGULAR_TOO, branch_angles, branch_posture
from mlivr_gym.kinematics.poses import Pose, columns, into, seen_from, vector

if TYPE_CHECKING:
    from mlivr_gym.values import Triple


class MountedArm(Record):
    """An arm and where it is mounted; a limb with shapes has more fields, see `collisions`."""

    mount: Pose
    """Limb base in the body frame."""
    arm: Chain
    """The arm."""


class Angles(Record):
    """Joint angles of a limb."""

    q: Joints
    """The angles [rad]."""


@kernel
def wrap(angle: float) -> float:
    """Return the angle plus whole turns that lies nearest to zero [rad]."""
    wrapped: float = angle - 2.0 * np.pi * np.rint(angle / (2.0 * np.pi))
    return wrapped


@kernel
def flange_seen(limb: MountedArm, base: Pose, flange: Pose) -> tuple[FlangeAxis, Triple]:
    """Return a flange pose in the limb base frame: position and axis, and first axis.

    Base and flange are given in the world.
    """
    x, _, z = columns(flange.rotation)
    p = seen_from(limb.mount, seen_from(base, vector(flange.position)))
    return FlangeAxis(p, into(limb.mount, into(base, z))), into(limb.mount, into(base, x))


@kernel
def angles_at(
    limb: MountedArm, base: Pose, flange: Pose, branch: int, slack: float, q: Joints
) -> bool:
    """Compute the joint angles with which a limb on one branch holds a flange pose [rad].

    Base and flange are given in the world; for `slack` see `inverse.branch_angles`.
    """
    seen, x = flange_seen(limb, base, flange)
    return branch_angles(limb.arm, seen, x, branch, slack, q)


@kernel
def posture_at(
    limb: MountedArm, base: Pose, flange: Pose, branch: int, q: Joints, frames: Array
) -> bool:
    """Compute joint angles as `angles_at` does, if singular too, and the frames of the links."""
    seen, x = flange_seen(limb, base, flange)
    return branch_posture(limb.arm, seen, x, branch, SINGULAR_TOO, q, frames)


@late_entry
def held_angles(robots: Any, bases: Any, grasps: Any, bits: IntArray, out: Any) -> None:
    """Compute the joint angles with which N limbs hold at k stances, in their windows.

    Bases in the world are rows of `Pose`, shape (k,), what limbs hold rows of `Grasp`, shape (k,
    N); `bits` has branch and flip of each limb, `branch + 8 * flip`. Rows of `Angles`, shape (k,
    N), are filled, with NaN where the branch does not exist.
    """
    for k in range(len(bits)):
        for i in range(bits.shape[1]):
            limb, q, bit = robots[0].limbs[i], out[k, i].q, bits[k, i]
            branch = bit % BRANCHES
            there = angles_at(limb, bases[k], grasps[k, i].flange, branch, SINGULAR_TOO, q)
            if bit >= BRANCHES:
                q[5] += np.pi
            for joint in range(6):
                q[joint] = in_window(q[joint], limb.arm.window[joint, 0]) if there else np.nan


@late_entry
def all_angles_at(robots: Any, i: int, base: Pose, flange: Pose, out: Any) -> None:
    """Compute the joint angles of limb `i` on every branch, with flip 0, in the joints' windows.

    They are written into `out`, rows of `Angles`, shape (8,), with NaN for a branch that does not
    exist. `robots` is a row of `RobotModel`, shape (1,);
    the other arguments are those of `angles_at`.
    """
    limb = robots[0].limbs[i]
    for branch in range(BRANCHES):
        q = out[branch].q
        there = angles_at(limb, base, flange, branch, SINGULAR_TOO, q)
        for joint in range(6):
            q[joint] = in_window(q[joint], limb.arm.window[joint, 0]) if there else np.nan


def joints_along(
    robots: Any, i: int, bases: Any, flanges: Any, branch: int, reference: Array
) -> Array:
    """Return joint angles of a limb on a branch at many poses, continuous from given ones [rad].

    Bases in the world are rows of `Pose`, shape (k,), or (1,) for one that stays; flanges likewise,
    up to a half turn about their z axes. `reference`, shape (6,), has angles close to those at the
    first pose, which determine windings and flip. The angles have shape (m, 6), where m is the
    number of poses from the first on at which the branch exists. `robots` is a row of `RobotModel`.
    """
    out = Angles.rows(max(len(bases), len(flanges)))
    count = _angles_along(robots, i, bases, flanges, branch, reference, out)
    joints: Array = out["q"][:count]
    return joints


@late_entry
def _angles_along(
    robots: Any, i: int, bases: Any, flanges: Any, branch: int, reference: Array, out: Any
) -> int:
    """Fill rows of `Angles` as `joints_along` does; return how many."""
    limb, flip = robots[0].limbs[i], 0.0
    for k in range(len(out)):
        base, flange = bases[min(k, len(bases) - 1)], flanges[min(k, len(flanges) - 1)]
        q = out[k].q
        if not angles_at(limb, base, flange, branch, SINGULAR_TOO, q):
            return k
        # The reference tells the flip, which is kept: half a turn of joint 6 or none.
        if k == 0:
            flip = np.rint((reference[5] - q[5]) / (0.5 * TURN)) * (0.5 * TURN)
        q[5] += flip
        for joint in range(6):
            before = reference[joint] if k == 0 else out[k - 1].q[joint]
            q[joint] += TURN * np.rint((before - q[joint]) / TURN)
    return len(out)
