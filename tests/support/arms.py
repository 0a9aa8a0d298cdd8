"""Arms of all families by name, and what Pinocchio says of them."""

from functools import cache

import numpy as np
import oracle
import station_arm
import wrist_arms
from branches import angles_on, arm_of, flanges_nearby, solutions
from compiled import called
from held_paths import GRIP, MOUNT, ORIGIN, TOOL, path_between, random_ends

from mlivr_gym import Limb
from mlivr_gym.kinematics import families
from mlivr_gym.kinematics.arm import SPHERICAL_SHOULDER, UR
from mlivr_gym.kinematics.base_path import STRAIGHT, base_poses
from mlivr_gym.robot.link_frames import link_frames

ARMS = {"ur5e": Limb(), "station": station_arm.LIMB, **wrist_arms.LIMBS}
"""The arm of a space station is of the form of the UR arms once its first joint is locked."""


@cache
def known(limb):
    """Pinocchio's model of an arm."""
    made = oracle.pinocchio_arm if limb.family_code == UR else wrist_arms.pinocchio_wrist_arm
    return made(limb)


def truth(limb, q):
    """Flange pose, its Jacobian to the joints that move, and to all joints, by Pinocchio."""
    if limb.family_code != UR:
        return wrist_arms.flange_of(known(limb), limb, q)
    pose, jacobian = oracle.flange(known(limb), q)
    return pose, jacobian, jacobian


def jacobian(limb, q):
    """Jacobian of the flange to the joints that move, by Pinocchio."""
    return truth(limb, q)[1]


def frames_at(arm, q):
    """Frames 0 to 6 by compiled code: rows of an origin and three axes, shape (7, 4, 3)."""
    out = np.empty((7, 4, 3))
    called(families.link_frames)(arm, q, out)
    return out


def turned(a, b):
    """Largest difference of joint angles, whole turns aside."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max()


NEAR = {
    **{name: limb for name, limb in ARMS.items() if name != "station"},
    "mirrored": Limb(d4=-0.1333, d5=-0.0997),
    **wrist_arms.OTHERS,
}
"""Arms of the size of the robot of `held_paths`."""


def path_near(limb, seed, kind=STRAIGHT):
    """A random base path near enough for an arm, which may be longer or shorter than a UR5e."""
    ends = random_ends(seed)
    for place in ends[::2] if limb.family_code != UR else ():
        place *= 0.5 if limb == ARMS["six"] else 1.0
        place += [-0.1, 0.0, -0.2] if limb == ARMS["six"] else [-0.3, 0.0, 0.05]
        if limb.family_code == SPHERICAL_SHOULDER:
            place += [0.45, 0.0, -0.35]
        # The shoulder of some is the base.
        place += [0.36, 0.0, 0.0] if abs(limb.lengths[0]) < 0.1 else [0.0, 0.0, 0.0]
    return path_between(ends, kind, GRIP)


def flanges_in_mount(path, s):
    """The flange that is held, in the limb base frame, at places of a base path."""
    positions, rotations = base_poses(path, s)
    mounts, origins = rotations @ MOUNT, positions + rotations @ ORIGIN
    return np.einsum("kji,kj->ki", mounts, GRIP - origins), mounts.transpose(0, 2, 1) @ TOOL


def random_posture(limb, rng, k):
    """Joint angles, often near a stretched or folded elbow."""
    q = rng.uniform(-np.pi, np.pi, 6)
    if k % 3:
        bend, elbow = 0.0, 3 if limb.family_code == SPHERICAL_SHOULDER else 2
        if limb.family_code != UR:
            _, _, _, a2, b2, a3, d4, *_ = limb.lengths
            bend = np.arctan2(a3, d4) - np.arctan2(b2, a2)
        q[elbow] = bend + np.pi * (k % 3 - 1) + rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.6)
    return q


def branch_of(limb, q):
    """The branch of joint angles."""
    pose = link_frames(limb, q)[6]
    _, angles = solutions(arm_of(limb), pose[:3, 3], pose[:3, :3])
    return int(np.nanargmin(np.abs(np.exp(1j * angles) - np.exp(1j * q)).max(axis=1)))


def angles_nearby(limb, q, change, rng, count=25):
    """Joint angles on the branch of `q` where wrist and axis go as far as told; None if nowhere."""
    arm, branch, pose = arm_of(limb), branch_of(limb, q), link_frames(limb, q)[6]
    return [
        angles_on(arm, *near, branch) for near in flanges_nearby(limb, pose, change, rng, count)
    ]
