"""Independent truth: the arm of a space station, of seven joints, with the first one locked.

Figures of the SSRMS of Nguyen and Hughes, "Teleoperation: from the space shuttle to the space
station", Progress in Astronautics and Aeronautics 161 (1994), 353, as `SSRMS_Canadarm2.urdf` of
the repository vyas-shubham/TraceableRobotModels has them body by body. Crane, Duffy and Carnahan,
"A kinematic analysis of the Space Station remote manipulator system", Journal of Robotic Systems 8
(1991), found that at most eight configurations are left where the first joint is locked.
"""

import numpy as np
import pinocchio as pin
from oracle import flange

from mlivr_gym import Limb
from mlivr_gym.robot.dh_table import frames_of_dh, ur_dh
from mlivr_gym.robot.rigid import rigid

JOINTS = (
    ((1.3589, 0.0, 0.0), "x"),
    ((0.0, 0.0, 0.7026), "z"),
    ((0.0, -0.5692, 0.0), "y"),
    ((7.11, -0.475, 0.0), "y"),
    ((7.11, 0.0, 0.0), "y"),
    ((0.0, -0.5692, 0.0), "z"),
    ((0.0, 0.0, -0.7026), "x"),
)
"""Where each joint is in the body before [m], and about which of its axes it turns.

They are shoulder roll, yaw and pitch, elbow pitch, wrist pitch, yaw and roll.
"""

END = (1.3589, 0.0, 0.0)
"""The end effector in the last body [m]."""

LIMB = Limb(*frames_of_dh(ur_dh(0.0, 7.11, 7.11, 0.5692 + 0.475 + 0.5692, 0.7026, 1.3589)))
"""The same arm as a limb whose six joints are 2 to 7."""

SIGNS = np.array([1.0, -1.0, -1.0, -1.0, -1.0, 1.0])
"""Whether a joint of the limb turns the same way as the published one."""

ZEROS = np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2, 0.0])
"""Angles of the limb's joints where those of the published arm are zero [rad]."""

AXES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Axes of the flange in those of the end effector."""


def published_arm():
    """Pinocchio's model of the seven joints and the end effector, from the published table."""
    model, parent = pin.Model(), 0
    for k, (place, axis) in enumerate(JOINTS):
        joint = pin.JointModelRevoluteUnaligned(np.eye(3)["xyz".index(axis)])
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array(place)), f"joint{k + 1}")
    tip = pin.SE3(np.eye(3), np.array(END))
    model.addFrame(pin.Frame("end", parent, tip, pin.FrameType.OP_FRAME))
    return model


MODEL = published_arm()


def end_of(angles):
    """End effector seen from the base, shape (4, 4), and its Jacobian, shape (6, 7)."""
    return flange(MODEL, np.array(angles), "end")


MOUNT = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
"""Published axes in the mount's: its z axis is that of joint 1, its x axis that of joint 2 at 0."""


def flange_in_mount(locked, q):
    """Flange of the limb in its mount, shape (4, 4), and the Jacobian of all seven joints."""
    end, jacobian = end_of([locked, *SIGNS * (q - ZEROS)])
    return rigid(MOUNT @ end[:3, :3] @ AXES, MOUNT @ end[:3, 3]), jacobian
