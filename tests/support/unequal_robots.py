"""Robots whose limbs differ, on mounts that are tilted and not evenly spread."""

from dataclasses import asdict
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym import Limb, robot_spec
from mlivr_gym.robot.dh_table import frames_of_dh, ur_dh


@cache
def unequal(limbs):
    """A robot whose limb 1 has longer links than its UR5e limbs, by the number of its limbs."""
    robot = robot_spec(f"mlivr{limbs}")
    turns = Rotation.from_euler("zy", [[8.0 * i, 8.0] for i in range(limbs)], degrees=True)
    mounts = [
        {"position": place.tolist(), "rotation": (axes @ turn).tolist()}
        for place, axes, turn in zip(
            robot.mount_positions, robot.mount_rotations, turns.as_matrix(), strict=True
        )
    ]
    mounts[0]["position"] = np.add(mounts[0]["position"], (0.0, 0.02, 0.01)).tolist()
    longer = Limb(*frames_of_dh(ur_dh(a2=-1.1 * 0.425, a3=-1.05 * 0.3922)))
    mounts[1] |= {"limb": asdict(longer), "dynamics": "ur5e"}
    return robot_spec({"name": f"unequal{limbs}", "mounts": mounts})
