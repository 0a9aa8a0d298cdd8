"""Independent truth: the arm of a space station, of seven joints, with the first one locked.

Figures of the SSRMS of Nguyen and Hughes, "Teleoperation: from the space shuttle to the space
station", Progress in Astronautics and Aeronautics 161 (1994), 353, as `SSRMS_Canadarm2.urdf` of
the repository vyas-shubham/TraceableRobotModels has them body by body. Crane, Duffy and Carnahan,
"A kinematic analysis of the Space Station remote manipulator system", Journal of Robotic Systems 8
(1991), found that at most eight configurations are left where the first joint is locked.
"""

import numpy as np

from mlivr_gym import Limb

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

LIMB = Limb(d1=0.0, a2=7.11, a3=7.11, d4=0.5692 + 0.475 + 0.5692, d5=0.7026, d6=1.3589)
"""The same arm as a limb whose six joints are 2 to 7."""

SIGNS = np.array([1.0, -1.0, -1.0, -1.0, -1.0, 1.0])
"""Whether a joint of the limb turns the same way as the published one."""

ZEROS = np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2, 0.0])
"""Angles of the limb's joints where those of the published arm are zero [rad]."""

LINKS = (
    ("xyz", (0.0, 0.0, 0.7026)),
    ("xyz", (0.0, 0.0, 0.0)),
    ("xzY", (0.0, 0.5692, 0.0)),
    ("xzY", (0.0, 0.5692 + 0.475, 0.0)),
    ("xzY", (0.0, -0.5692, 0.0)),
    ("yxZ", (0.0, 0.0, -0.7026)),
    ("yzx", END),
)
"""Links 0 to 6 of the limb as seen from the published bodies 1 to 7, each after its joint.

Their axes lie along those axes of the body, a capital runs backwards; then their origins [m]. Link
0 is the limb's base, which is at rest with body 1; link 6 is the flange.
"""


def transform(rotation, place):
    """A homogeneous transform."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, place
    return out


def along(axes):
    """Rotation whose columns lie along axes given by their letters."""
    return np.stack([np.eye(3)["xyz".index(a.lower())] * (-1) ** a.isupper() for a in axes], 1)


def turn(axis, angle):
    """Rotation about one axis."""
    k = "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    out = np.eye(3)
    out[i, i] = out[j, j] = np.cos(angle)
    out[i, j], out[j, i] = -np.sin(angle), np.sin(angle)
    return out


def bodies(angles):
    """The published bodies 1 to 7 seen from their base, shape (7, 4, 4), for seven angles [rad]."""
    out, pose = [], np.eye(4)
    for (place, axis), angle in zip(JOINTS, angles, strict=True):
        pose = pose @ transform(turn(axis, angle), place)
        out.append(pose)
    return np.array(out)


def jacobian(angles):
    """Jacobian of the end effector seen from the published base, shape (6, 7) [m, 1].

    Linear rows come first.
    """
    poses = bodies(angles)
    end = (poses[-1] @ transform(np.eye(3), END))[:3, 3]
    axes = np.array(
        [pose[:3, "xyz".index(axis)] for pose, (_, axis) in zip(poses, JOINTS, strict=True)]
    )
    return np.vstack([np.cross(axes, end - poses[:, :3, 3]).T, axes.T])


def links(locked, q):
    """Links 0 to 6 of the limb seen from its base, shape (7, 4, 4), by the published model.

    Args:
        locked: Angle at which joint 1 is locked [rad].
        q: Joint angles of the limb [rad], shape (6,).
    """
    poses = bodies([locked, *SIGNS * (q - ZEROS)])
    seen = np.array(
        [pose @ transform(along(at[0]), at[1]) for pose, at in zip(poses, LINKS, strict=True)]
    )
    return np.linalg.inv(seen[0]) @ seen
