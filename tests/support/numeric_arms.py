"""Arms without a closed form, by their makers' DH parameters, and Pinocchio models of them."""

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
UR5E = (
    (0.1625, 0.0, RIGHT), (0.0, -0.425, 0.0), (0.0, -0.3922, 0.0), (0.1333, 0.0, RIGHT),
    (0.0997, 0.0, -RIGHT), (0.0996, 0.0, 0.0),
)  # fmt: skip
"""The UR5e, which has a closed form."""
TABLES = {"xarm6": XARM6, "crx10": CRX10, "jaco2": JACO2, "ur5e": UR5E}


def limb_of(table, limits=TURN):
    """The limb of a table."""
    return Limb(*frames_of_dh(table), limits)


def frames_of(name):
    """Frames of the joints and the flange of an arm at angles 0, joints turning about z."""
    frames = link_frames(LIMBS[name], np.zeros(6))[1:]
    return [*frames, frames[5]]


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


LIMBS = {name: limb_of(table) for name, table in TABLES.items()}
MODELS = {name: model_of(table) for name, table in TABLES.items()}
