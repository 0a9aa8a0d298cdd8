"""Random base paths for one limb that holds."""

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym import Limb, robot_spec

ROBOT = robot_spec("mlivr2")


LIMB = Limb()


FLOOR = 0.03 * 0.87**3


MOUNT, ORIGIN = ROBOT.mount_rotations[0].copy(), ROBOT.mount_positions[0].copy()


TOOL = np.diag([1.0, -1.0, -1.0])


GRIP = np.array([0.55, 0.0, -0.6])


def random_ends(seed):
    rng = np.random.default_rng(seed)
    ends = []
    for _ in range(2):
        rotation = Rotation.from_rotvec(rng.normal(size=3) * 0.35).as_matrix()
        ends += [rng.uniform([-0.35, -0.35, -0.15], [0.35, 0.35, 0.25]), rotation]
    return ends
