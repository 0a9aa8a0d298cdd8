"""Departures of a limb from a grasp along the surface normal, as lines in joint space (compiled).

A limb departs by `RobotModel.lift` along the normal while the base is at rest. Between knots, at
which inverse kinematics puts it on the normal, its joints change linearly. The flange is then off
the normal by an amount that falls with the square of the number of pieces: it is measured in the
middle of the whole departure, from which the number follows, and again in the middle of each piece.
The limb approaches a grasp on the same knots in the opposite order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.limb_shapes import LimbModel
from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, only
from mlivr_gym.compiled.kernels import kernel, late_entry
from mlivr_gym.compiled.records import Joints, Record, Rows
from mlivr_gym.kinematics.chain import LIMIT_TOLERANCE, FlangeAxis, in_window, link_frames
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.inverse import SINGULAR_TOO, branch_angles
from mlivr_gym.kinematics.limb import Angles, flange_seen, wrap
from mlivr_gym.kinematics.poses import Pose, along, dot, length, minus, vector

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

OFF_NORMAL = 1.5e-4
"""Largest distance of the flange from the normal on a line of a departure [m].

A spline with the knots as control points passes them at a sixth of the second differences, and the
middles of lines are off by an eighth: it is within 0.2 mm of the normal.
"""

MOST_PIECES = 48
"""Largest number of pieces of a departure."""

LARGEST_TURN = 1.0
"""Turn of a joint on one piece from which on its ends count as two branches [rad]."""


class Departure(Record):
    """The knots of a departure."""

    pieces: int
    """Number of pieces between them."""
    knots: Annotated[Rows[Angles], (MOST_PIECES + 1,)]
    """Joint angles from the grasp to above it, with flip 0."""
    middle: Joints
    """Scratch: joint angles in the middle of a piece [rad]."""
    frames: Annotated[Array, (7, 4, 3)]
    """Scratch: link frames there, see `chain.link_frames`."""


FLANGE = 6
"""Row of the flange among the frames of links."""


@kernel
def set_departure(
    limb: LimbModel, base: Pose, grasp: Grasp, branch: int, lift: float, to: Departure
) -> int:
    """Compute the knots of a departure by `lift` [m] on a branch, from a base in the world.

    Returned are the branch with those flips with which every knot is in the joint windows; none if
    the limb cannot depart so.
    """
    at_grasp, x = flange_seen(limb, base, grasp.flange)
    to.pieces = 1
    if not _fill(limb, at_grasp, x, branch, lift, to):
        return EMPTY
    # Of n pieces each is off by n^-2 times as much as one; its middle is measured all the same.
    to.pieces = max(2, int(np.ceil(np.sqrt(1.2 * _off_normal(limb, at_grasp, to) / OFF_NORMAL))))
    while to.pieces <= MOST_PIECES:
        if not _fill(limb, at_grasp, x, branch, lift, to):
            return EMPTY
        if _off_normal(limb, at_grasp, to) <= OFF_NORMAL:
            return _flips_in_windows(limb, branch, to)
        to.pieces += (to.pieces + 2) // 3
    return EMPTY


@kernel
def _fill(
    limb: LimbModel, at_grasp: FlangeAxis, x: Triple, branch: int, lift: float, to: Departure
) -> bool:
    """Fill the knots; return whether the branch leads from one to the next."""
    for k in range(to.pieces + 1):
        # A grasp may be held at a singularity, from which the departure leads away.
        slack, q = SINGULAR_TOO if k == 0 else 0.0, to.knots[k].q
        lifted = FlangeAxis(along(at_grasp.p, -lift * k / to.pieces, at_grasp.z), at_grasp.z)
        if not branch_angles(limb.arm, lifted, x, branch, slack, q):
            return False
        for j in range(6):
            if k == 0:
                q[j] = in_window(q[j], limb.arm.window[j, 0])
                continue
            before = to.knots[k - 1].q[j]
            turn = wrap(q[j] - before)
            if to.pieces > 1 and abs(turn) > LARGEST_TURN:
                return False
            q[j] = before + turn
    return True


@kernel
def _off_normal(limb: LimbModel, at_grasp: FlangeAxis, to: Departure) -> float:
    """Return how far the flange is off the normal in the middles of the pieces [m]."""
    farthest = 0.0
    for k in range(to.pieces):
        first, last = to.knots[k].q, to.knots[k + 1].q
        for j in range(6):
            to.middle[j] = 0.5 * (first[j] + last[j])
        link_frames(limb.arm, to.middle, to.frames)
        away = minus(vector(to.frames[FLANGE, 0]), at_grasp.p)
        across = along(away, -dot(away, at_grasp.z), at_grasp.z)
        farthest = max(farthest, length(across))
    return farthest


@kernel
def _flips_in_windows(limb: LimbModel, branch: int, to: Departure) -> int:
    """Return a branch with those flips with which every knot is in the joint windows."""
    flips, window = EMPTY, limb.arm.window
    for flip in range(2):
        inside = True
        for j in range(6):
            # A flip turns joint 6 by half a turn, and with it all knots.
            start = in_window(to.knots[0].q[j] + np.pi * flip * (j == 5), window[j, 0])
            for k in range(to.pieces + 1):
                q = start + to.knots[k].q[j] - to.knots[0].q[j]
                inside = inside and window[j, 0] - LIMIT_TOLERANCE <= q
                inside = inside and q <= window[j, 1] + LIMIT_TOLERANCE
        if inside:
            flips |= only(branch + BRANCHES * flip)
    return flips


@late_entry
def departure_of(robots: Any, i: int, base: Pose, grasp: Grasp, branch: int, to: Departure) -> int:
    """Call `set_departure` for limb `i` of a row of `RobotModel`, shape (1,), and its lift."""
    return set_departure(robots[0].limbs[i], base, grasp, branch, robots[0].lift, to)
