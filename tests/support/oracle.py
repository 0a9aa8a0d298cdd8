"""Independent truth: Pinocchio models of arms from their makers' DH parameters."""

import numpy as np
import pinocchio as pin

from mlivr_gym.robot.dh_table import frames_of_dh
from mlivr_gym.robot.limb import Limb, link_frames

RIGHT = 0.5 * np.pi
TURN = ((-np.pi, np.pi),) * 6

XARM6 = (
    (0.267, 0.0, -RIGHT), (0.0, 0.28949, 0.0), (0.0, 0.0775, -RIGHT), (0.3425, 0.0, RIGHT),
    (0.0, 0.076, -RIGHT), (0.097, 0.0, 0.0),
)  # fmt: skip
"""Rows d, a [m], alpha [rad] in the standard convention, of the UFACTORY xArm 6 by its maker's user
manual; axis 6 lies beside axis 5."""
CRX10 = (
    (0.0, 0.0, -RIGHT), (0.0, 0.71, np.pi), (0.0, 0.0, -RIGHT), (-0.54, 0.0, RIGHT),
    (0.15, 0.0, -RIGHT), (-0.16, 0.0, 0.0),
)  # fmt: skip
"""FANUC CRX-10iA/L: Abbes and Poisson, "Geometric approach for inverse kinematics of the FANUC CRX
collaborative robot", Robotics 2024, 13(6), 91; some of its poses have 16 solutions."""
JACO2 = (
    (0.2755, 0.0, RIGHT), (0.0, 0.41, np.pi), (-0.0098, 0.0, RIGHT), (-0.2502, 0.0, np.pi / 3),
    (-0.0858, 0.0, np.pi / 3), (-0.2116, 0.0, np.pi),
)  # fmt: skip
"""Kinova Jaco 2 of six joints by its maker's advanced specification guide: a wrist bent by 60
degrees, whose axes do not meet."""


def ur_table(d1, a2, a3, d4, d5, d6):
    """The table of an arm of UR, which has a closed form."""
    rows = (d1, 0.0, RIGHT), (0.0, a2, 0.0), (0.0, a3, 0.0), (d4, 0.0, RIGHT), (d5, 0.0, -RIGHT)
    return *rows, (d6, 0.0, 0.0)


UR5E = ur_table(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996)
TABLES = {"xarm6": XARM6, "crx10": CRX10, "jaco2": JACO2, "ur5e": UR5E}
"""All but the last have no closed form."""
LIMBS = {name: Limb(*frames_of_dh(table), TURN) for name, table in TABLES.items()}


def frames_of(name):
    """Frames of the joints and the flange of an arm at angles 0, joints turning about z."""
    frames = link_frames(LIMBS[name], np.zeros(6))[1:]
    return [*frames, frames[5]]


def lengths_of(limb):
    """Lengths of an arm of UR as its maker's DH table has them, by the places of its links."""
    (_, _, d1), _, (a2, _, _), (a3, _, d4), (_, d5, _), (_, d6, _) = limb.origins
    return d1, a2, a3, d4, -d5, d6


def model_of(table):
    """A Pinocchio model of a table; its frame "flange" is that of the limb."""
    model, placement, parent = pin.Model(), pin.SE3.Identity(), 0
    for k, (d, a, alpha) in enumerate(table):
        # A joint turns about its own axis wherever on that its frame lies.
        placement = placement * pin.SE3(np.eye(3), np.array([0.0, 0.0, d]))
        behind = pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0.0, 0.0]))
        if k == 5:
            # Joint 6 turns about the z axis of the flange, which points the other way if the last
            # row turns the frame by half a turn.
            placement = placement * behind
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"joint{k + 1}")
        placement = behind
    model.addFrame(pin.Frame("flange", parent, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return model


def pinocchio_arm(limb):
    """Model of an arm of UR from its lengths."""
    return model_of(ur_table(*lengths_of(limb)))


def flange(model, q, name="flange"):
    """Pose of a frame and its Jacobian in base axes, linear rows first."""
    data = model.createData()
    frame = model.getFrameId(name)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    jacobian = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    return data.oMf[frame].homogeneous, jacobian


def at_grasp(robot, i, pose, jacobian):
    """Jacobian of a limb at its grasp in body axes, and where that is, from those of its flange."""
    mount, tool = robot.mount_rotations[i], robot.tool_length * pose[:3, 2]
    moved = np.vstack([jacobian[:3] + np.cross(jacobian[3:].T, tool).T, jacobian[3:]])
    return np.kron(np.eye(2), mount) @ moved, robot.mount_positions[i] + mount @ (
        pose[:3, 3] + tool
    )


def volume(jacobian):
    """|det J|; factors below 1e-300 are zero and no matter for a warning."""
    with np.errstate(all="ignore"):
        return abs(np.nan_to_num(np.linalg.det(jacobian)))
