"""Joint angles of a limb that is folded or above a grasp, and lines between them (compiled)."""

from __future__ import annotations

from typing import Any

from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, both_flips, has_branch
from mlivr_gym.compiled.kernels import kernel, late_entry
from mlivr_gym.kinematics.chain import FlangeAxis, in_window
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.inverse import branch_angles
from mlivr_gym.kinematics.limb import Angles, flange_seen, wrap
from mlivr_gym.kinematics.poses import Pose, along
from mlivr_gym.transitions.records import StepScratch


@kernel
def folded(robot: RobotModel, fold: int, joint_6: float, to: Angles) -> None:
    """Write the joint angles of a fold, with an angle of joint 6 [rad], into `to`."""
    for joint in range(5):
        to.q[joint] = robot.folds[fold, joint]
    to.q[5] = joint_6


@kernel
def line_end(first: Angles, last: Angles, to: Angles) -> float:
    """Compute the end of a line in joint space from above one grasp to above another.

    Joint 6 goes to the closest half turn: a grasp is the same after a half turn of the tool, and
    the shapes on the flange axis turn in place. `to`, which may be `last`, is filled with the
    angles at the end. Returned is the length of the line, the largest of the turns of joints 1 to 5
    [rad].
    """
    length, q0, q1, out = 0.0, first.q, last.q, to.q
    for joint in range(5):
        out[joint] = q1[joint]
        length = max(length, abs(out[joint] - q0[joint]))
    out[5] = q0[5] + 0.5 * wrap(2.0 * (q1[5] - q0[5]))
    return length


@kernel
def lifted_angles(
    limb: LimbModel, base: Pose, grasp: Grasp, branch: int, lift: float, to: Angles
) -> bool:
    """Compute the joint angles of a limb that has departed from a grasp by `lift` [m], with flip 0.

    The base is in the world. Returned is whether the branch exists there.
    """
    q = to.q
    at_grasp, x = flange_seen(limb, base, grasp.flange)
    lifted = FlangeAxis(along(at_grasp.p, -lift, at_grasp.z), at_grasp.z)
    if not branch_angles(limb.arm, lifted, x, branch, 0.0, q):
        return False
    for joint in range(6):
        q[joint] = in_window(q[joint], limb.arm.window[joint, 0])
    return True


@kernel
def lifted_branches(
    robot: RobotModel,
    limb: LimbModel,
    base: Pose,
    grasp: Grasp,
    branch_set: int,
    side: int,
    scratch: StepScratch,
) -> int:
    """Compute the joint angles of a limb that has departed from a grasp, for a set of branches.

    They are written into `scratch.q[side]`, with 0 before a step and 1 after it. Returned are the
    branches and flips of the set that exist there.
    """
    found = EMPTY
    for b in range(BRANCHES):
        q = scratch.q[side, b]
        if has_branch(branch_set, b) and lifted_angles(limb, base, grasp, b, robot.lift, q):
            found |= both_flips(b)
    return found & branch_set


@late_entry
def angles_above(robots: Any, i: int, base: Pose, grasp: Grasp, branch: int, to: Angles) -> bool:
    """Call `lifted_angles` for limb `i` of a row of `RobotModel`, shape (1,)."""
    return lifted_angles(robots[0].limbs[i], base, grasp, branch, robots[0].lift, to)
