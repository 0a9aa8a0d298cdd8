"""Knots of a line in joint space beside which supports follow the base (compiled).

Supports hold their points at each place exactly, by inverse kinematics on their branches; the limb
that moves is on its line. How far the lines between knots are from this motion is measured in their
middles, as `paper_motion.dense_knots` does for motions of any kind.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.base_path import pose_on_path
from mlivr_gym.collisions.joint_lines import JointLine
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.compiled.kernels import kernel, late_entry
from mlivr_gym.compiled.records import Record, Rows
from mlivr_gym.kinematics.chain import TURN, link_frames
from mlivr_gym.kinematics.inverse import SINGULAR_TOO
from mlivr_gym.kinematics.limb import Angles, MountedArm, angles_at
from mlivr_gym.kinematics.poses import (
    Pose,
    along,
    columns,
    dot,
    into,
    length,
    minus,
    out_of,
    seen_from,
    vector,
)
from mlivr_gym.robot.sizes import MOST_LIMBS


class Spread(Record):
    """How far lines between knots are from the motion, and scratch of its measurement."""

    limb: int
    """The limb that moves."""
    leader: int
    """The support limb that carries the base."""
    tool: float
    """Distance of grasps from flanges [m]."""
    grip: float
    """Distance at which the angle of a gripper counts as slip [m]."""
    lever: Annotated[Rows[Angles], (MOST_LIMBS,)]
    """How far a turn of each joint moves a part of the robot at most [m/rad]."""
    far: float
    """Largest distance of a part of the robot from where it is in the motion [m]."""
    slip: float
    """Largest slip of a support limb [m]."""
    base: Pose
    """Base in the world."""
    flip: Annotated[Array, (MOST_LIMBS,)]
    """Half turns of joint 6 of each support [rad]."""
    frames: Annotated[Array, (7, 4, 3)]
    """Link frames in the limb base frame, see `chain.link_frames`."""
    q: Annotated[Rows[Angles], (MOST_LIMBS,)]
    """Joint angles in the middle of a line between knots."""
    of_leader: Pose
    """Flange of the leader in the body frame."""
    flange: Pose
    """Flange of another support there."""
    held: Annotated[Rows[Pose], (MOST_LIMBS,)]
    """Flanges of other supports as the leader's sees them at the first knot."""
    seen: Pose
    """One of these in the middle of a line."""


@late_entry
def fill_knots(robots: Any, line: JointLine, s: Array, joints: Any, spreads: Any) -> int:
    """Fill in joint angles at parameters of a line, and how far lines between them are off.

    Angles are rows of `Angles`, shape (k, N); those of supports are continuous from `line.first`
    on. Parameters have shape (k,), k odd; every other one is that of a knot, those between are the
    middles. `robots` is a row of `RobotModel`, `spreads` one of `Spread`. Returned is the limb that
    cannot follow, or -1.
    """
    robot, spread = robots[0], spreads[0]
    for k in range(len(s)):
        pose_on_path(line.path, s[k], spread.base)
        for i in range(robot.limb_count):
            limb, q, first, last = robot.limbs[i], joints[k, i].q, line.first[i].q, line.last[i].q
            if i == spread.limb:
                for j in range(6):
                    q[j] = first[j] + s[k] * (last[j] - first[j])
                continue
            if not angles_at(limb, spread.base, line.held[i], line.branch[i], SINGULAR_TOO, q):
                return i
            # The first angles tell the flip, which is kept: half a turn of joint 6 or none.
            if k == 0:
                spread.flip[i] = 0.5 * TURN * np.rint((first[5] - q[5]) / (0.5 * TURN))
            q[5] += spread.flip[i]
            for j in range(6):
                before = first[j] if k == 0 else joints[k - 1, i].q[j]
                q[j] += TURN * np.rint((before - q[j]) / TURN)
    spread.far, spread.slip = 0.0, 0.0
    for k in range(-1, len(s), 2):
        _measure(k, robot, joints, spread)
    return -1


@kernel
def _measure(k: int, robot: RobotModel, joints: Any, spread: Spread) -> None:
    """Measure how far a line is off in its middle `k`; at -1 set what slip is measured from.

    What a limb does comes on top of where the leader puts the base, or of another limb.
    """
    leads, most, second = 0.0, 0.0, 0.0
    for i in range(robot.limb_count):
        off = 0.0
        for j in range(6):
            middle = 0.5 * (joints[max(k - 1, 0), i].q[j] + joints[k + 1, i].q[j])
            spread.q[i].q[j] = middle
            off += spread.lever[i].q[j] * abs(middle - joints[max(k, 0), i].q[j])
        if i == spread.leader:
            leads = off
        else:
            most, second = max(most, off), max(second, min(most, off))
    spread.far = max(spread.far, most + max(leads, second))
    if robot.limb_count == 2:
        return  # the only support leads, and does not slip
    _set_flange(robot.limbs[spread.leader], spread.q[spread.leader].q, spread, spread.of_leader)
    for i in range(robot.limb_count):
        if i not in (spread.limb, spread.leader):
            _set_flange(robot.limbs[i], spread.q[i].q, spread, spread.flange)
            if k < 0:
                _see(spread.of_leader, spread.flange, spread.held[i])
                continue
            _see(spread.of_leader, spread.flange, spread.seen)
            spread.slip = max(spread.slip, _slip(spread.held[i], spread))


@kernel
def _set_flange(limb: MountedArm, q: Array, spread: Spread, out: Pose) -> None:
    """Compute the pose of a limb's flange in the body frame."""
    frames = spread.frames
    link_frames(limb.arm, q, frames)
    place = out_of(limb.mount, (frames[6, 0, 0], frames[6, 0, 1], frames[6, 0, 2]))
    for c in range(3):
        axis = (frames[6, 1 + c, 0], frames[6, 1 + c, 1], frames[6, 1 + c, 2])
        axis = minus(out_of(limb.mount, axis), vector(limb.mount.position))
        out.position[c] = place[c]
        for k in range(3):
            out.rotation[k, c] = axis[k]


@kernel
def _see(frame: Pose, there: Pose, out: Pose) -> None:
    """Compute a pose as it is seen from a frame."""
    place, axes = seen_from(frame, vector(there.position)), columns(there.rotation)
    for c in range(3):
        axis, out.position[c] = into(frame, axes[c]), place[c]
        for k in range(3):
            out.rotation[k, c] = axis[k]


@kernel
def _slip(held: Pose, spread: Spread) -> float:
    """Return how far a gripper is from its grasp, with its angle at a distance of `grip` [m]."""
    before, now, squares = columns(held.rotation), columns(spread.seen.rotation), 0.0
    for c in range(3):
        turned = minus(now[c], before[c])
        squares += dot(turned, turned)
    flange = minus(vector(spread.seen.position), vector(held.position))
    grasp = along(flange, spread.tool, minus(now[2], before[2]))
    slip: float = length(grasp) + spread.grip * np.sqrt(0.5 * squares)
    return slip
