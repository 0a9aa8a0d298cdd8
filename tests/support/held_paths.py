"""Random base paths for one limb that holds."""

import numpy as np
from branches import arm_of
from scipy.spatial.transform import Rotation

from mlivr_gym import Limb, robot_spec
from mlivr_gym.collisions import limb_shapes
from mlivr_gym.collisions.base_path import base_path
from mlivr_gym.kinematics.poses import pose

ROBOT = robot_spec("mlivr2")


LIMB = Limb()


FLOOR = 0.03 * 0.87**3


MOUNT, ORIGIN = ROBOT.mount_rotations[0].copy(), ROBOT.mount_positions[0].copy()


def mounted(limb=LIMB):
    """The first limb of the robot, with the arm of `limb`, as compiled code reads it.

    It is a limb with shapes, as in the program: what was compiled for less serves those with a
    warning, and warnings are errors here.
    """
    out = limb_shapes.LimbModel.row()
    out["mount"] = pose(ORIGIN, MOUNT)
    out["arm"] = arm_of(limb)
    return out


def random_ends(seed):
    """Base position and rotation at the start, then at the end."""
    rng = np.random.default_rng(seed)
    ends = []
    for _ in range(2):
        rotation = Rotation.from_rotvec(rng.normal(size=3) * 0.35).as_matrix()
        ends += [rng.uniform([-0.35, -0.35, -0.15], [0.35, 0.35, 0.25]), rotation]
    return ends


def path_between(ends):
    """The base path between two ends."""
    return base_path(pose(*ends[:2]), pose(*ends[2:]))
