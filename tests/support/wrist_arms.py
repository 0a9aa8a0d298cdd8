"""Arms with a spherical wrist, and Pinocchio models of them built from their axes."""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from oracle import flange
from robot_texts import IIWA14, IIWA14_FIGURES, one_arm

from mlivr_gym import RobotSpec, robot_spec
from mlivr_gym.robot.limb import Limb

WIDE = ((-2.0 * np.pi, 2.0 * np.pi),) * 6
HALF = float(np.sqrt(0.5))
STRAIGHT, FORTH, BACK = (1.0, 0.0, 0.0, 0.0), (HALF, HALF, 0.0, 0.0), (HALF, -HALF, 0.0, 0.0)


class Lengths(NamedTuple):
    """Lengths of an arm that stands upright at zero angles [m].

    Its joints turn about z, -y, z, -y, z, -y, z; an arm of six has no joint 3. Axis 2 is at the
    height d1, a1 from axis 1; the arm lies d2 along axis 2. The upper arm is a2 long, the forearm,
    from the elbow to the wrist point, d4; the elbow axis is b2 from the one and a3 from the other,
    with an offset d3 along it. The flange is d6 from the wrist point, axis 7 a6 from axis 6.
    """

    d1: float = 0.36
    a2: float = 0.42
    d4: float = 0.4
    d6: float = 0.126
    a1: float = 0.0
    d2: float = 0.0
    b2: float = 0.0
    d3: float = 0.0
    a3: float = 0.0
    a6: float = 0.0

    def limb(self, limits, locked_joint=3, locked_angle=0.0):
        """The limb; one of no locked joint has six."""
        fore = [((self.a3, self.d4, 0.0), BACK), ((0.0, 0.0, 0.0), FORTH)]
        fore += [((self.a6, self.d6, 0.0), BACK)]
        base = [((0.0, 0.0, self.d1), STRAIGHT), ((self.a1, 0.0, 0.0), FORTH)]
        if locked_joint is None:
            upper = [((self.b2, self.a2, self.d2), STRAIGHT)]
        else:
            upper = [((0.0, 0.0, self.d2), BACK), ((self.b2, -self.d3, self.a2), FORTH)]
        origins, quaternions = zip(*base, *upper, *fore, strict=True)
        made = Limb(
            origins, quaternions, limits, locked_joint=locked_joint, locked_angle=locked_angle
        )
        KNOWN[origins] = self
        return made


KNOWN = {}
"""Lengths of limbs, by the origins of their links."""
IIWA = robot_spec("mlivr2-iiwa").limb
KNOWN[IIWA.origins] = Lengths()
IIWA = replace(IIWA, locked_angle=0.0)
"""KUKA LBR iiwa 14 R820 by the maker's data sheet, joint 3 at 0."""
SIX = Lengths(d1=0.29, a1=0.05, d2=0.03, a2=0.27, a3=0.07, d4=0.302, d6=0.072).limb(WIDE, None)
"""Lengths of a small industrial robot (ABB IRB 120), with every offset that the form has."""
WAM_LIMITS = ((-2.6, 2.6), (-2.0, 2.0), (-2.8, 2.8), (-0.9, 3.1), (-4.8, 1.3), (-1.6, 1.6),
              (-2.2, 2.2))  # fmt: skip
WAM = Lengths(d1=0.0, a2=0.55, b2=0.045, a3=-0.045, d4=0.3, d6=0.06).limb(WAM_LIMITS)
"""Lengths of a Barrett WAM, whose elbow axis lies beside upper arm and forearm."""
FRANKA = Lengths(d1=0.333, a2=0.316, b2=0.0825, a3=-0.0825, d4=0.384, a6=0.088, d6=0.107).limb(
    ((-2.9, 2.9),) * 7, 6, -1.3
)
"""Lengths of a Franka Research 3 by the maker's DH parameters; its shoulder alone is spherical."""
GEN3_LENGTHS = Lengths(d1=0.2848, d2=-0.0118, a2=0.4208, d3=-0.0128, d4=0.3143, d6=0.1674)
GEN3 = GEN3_LENGTHS.limb(((-6.2, 6.2),) * 7, locked_angle=0.6)
"""Lengths of a Kinova Gen3 in the maker's DH parameters: axis 3 lies beside axis 1."""
LIMBS = {
    "iiwa": IIWA,
    "iiwa-across": replace(IIWA, locked_angle=-0.5 * np.pi),
    "six": SIX,
    "gen3": GEN3,
    "franka": FRANKA,
}
"""Limbs by name."""
OTHERS = {
    "iiwa-first": replace(IIWA, locked_joint=1, locked_angle=0.6),
    "iiwa-second": replace(IIWA, locked_joint=2, locked_angle=-1.7),
    "wam": replace(WAM, locked_angle=0.5),
    "iiwa-fifth": replace(IIWA, locked_joint=5, locked_angle=0.6),
}
"""Limbs that hold another joint than the third, or whose elbow lies beside the upper arm."""
FURTHER = {
    "gen3-offset": GEN3_LENGTHS._replace(d2=-0.2, d3=-0.15).limb(GEN3.joint_limits, 3, 0.6),
    "iiwa-sixth": replace(IIWA, locked_joint=6, locked_angle=-1.7),
    "wam-fifth": replace(WAM, locked_joint=5),
    "gen3-first": replace(GEN3, locked_joint=1),
}
"""Further limbs that hold another joint, or with larger offsets."""


def moved_by(limb, q):
    """Angles of all joints of the model by those of the joints that move."""
    q = np.asarray(q)
    return (
        q if limb.locked_joint is None else np.insert(q, limb.locked_joint - 1, limb.locked_angle)
    )


def columns(limb):
    """Columns of the model's Jacobian that belong to the joints that move."""
    joints = range(6 if limb.locked_joint is None else 7)
    return [joint for joint in joints if joint + 1 != limb.locked_joint]


def pinocchio_wrist_arm(limb):
    """Model of one arm; frame "flange" has the axes of the base at zero angles."""
    held, limb = limb.locked_joint, KNOWN[limb.origins]
    shoulder, up, across = np.array([limb.a1, 0, limb.d1]), np.eye(3)[2], -np.eye(3)[1]
    beside = shoulder + limb.d2 * across
    elbow = beside + np.array([limb.b2, 0.0, limb.a2])
    wrist = elbow + np.array([limb.a3, -limb.d3, limb.d4])
    last = wrist + np.array([limb.a6, 0.0, 0.0])
    joints = [(np.zeros(3), up), (shoulder, across), (elbow, across), (wrist, up)]
    joints += [(wrist, across), (last, up)]
    if held is not None:
        joints.insert(2, (beside, up))
    model, parent, last = pin.Model(), 0, np.zeros(3)
    for k, (place, axis) in enumerate(joints):
        joint = pin.JointModelRevoluteUnaligned(axis)
        placement = pin.SE3(np.eye(3), place - last)
        parent, last = model.addJoint(parent, joint, placement, f"joint{k + 1}"), place
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, limb.d6]))
    model.addFrame(pin.Frame("flange", parent, tip, pin.FrameType.OP_FRAME))
    return model


def flange_of(model, limb, q):
    """Flange pose and its Jacobian to the joints that move, linear rows first.

    Seen from where the first joint that moves turns about z.
    """
    pose, jacobian = flange(model, moved_by(limb, q))
    base = limb.base_in_mount
    pose = np.linalg.inv(base) @ pose
    jacobian = np.kron(np.eye(2), base[:3, :3].T) @ jacobian
    return pose, jacobian[:, columns(limb)], jacobian


def iiwa_from_file(locked_angle):
    """Two iiwa on opposite faces of a cube, from a URDF of one."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "iiwa14.urdf")
        path.write_text(one_arm(frames=IIWA14, figures=IIWA14_FIGURES))
        return RobotSpec.from_urdf(path, locked_angle=locked_angle, capsules="ur5e")
