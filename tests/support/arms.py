"""Arms of all families by name, and what Pinocchio says of them."""

from functools import cache

import numpy as np
import oracle
import station_arm
import wrist_arms
from compiled import called

from mlivr_gym import Limb
from mlivr_gym.kinematics import chain

ARMS = {"ur5e": Limb(), "station": station_arm.LIMB, **wrist_arms.LIMBS}
"""The arm of a space station is of the form of the UR arms once its first joint is locked."""


def is_wrist(limb):
    """Whether Pinocchio's model of an arm is one of `wrist_arms`."""
    return limb.origins in wrist_arms.KNOWN


@cache
def known(limb):
    """Pinocchio's model of an arm."""
    made = wrist_arms.pinocchio_wrist_arm if is_wrist(limb) else oracle.pinocchio_arm
    return made(limb)


def truth(limb, q):
    """Flange pose, its Jacobian to the joints that move, and to all joints, by Pinocchio."""
    if is_wrist(limb):
        return wrist_arms.flange_of(known(limb), limb, q)
    pose, jacobian = oracle.flange(known(limb), q)
    return pose, jacobian, jacobian


def jacobian(limb, q):
    """Jacobian of the flange to the joints that move, by Pinocchio."""
    return truth(limb, q)[1]


def frames_at(arm, q):
    """Frames 0 to 6 by compiled code: rows of an origin and three axes, shape (7, 4, 3)."""
    out = np.empty((7, 4, 3))
    called(chain.link_frames)(arm, q, out)
    return out


def turned(a, b):
    """Largest difference of joint angles, whole turns aside."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max()
