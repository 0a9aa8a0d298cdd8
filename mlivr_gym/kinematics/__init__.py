"""Arms: the poses, the angles and the manipulability of serial chains.

A pose is a frame in another; an arm is asked for its angles through one inverse kinematics,
whatever its form.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.kinematics.batches import distances
    from mlivr_gym.kinematics.grasps import grasp_rows
    from mlivr_gym.kinematics.limb import Angles, all_angles_at, joints_along
    from mlivr_gym.kinematics.manipulability import base_manipulability, limb_manipulability
    from mlivr_gym.kinematics.poses import pose

__all__ = [
    "Angles",
    "all_angles_at",
    "base_manipulability",
    "distances",
    "grasp_rows",
    "joints_along",
    "limb_manipulability",
    "pose",
]

__getattr__, __dir__ = lazy(__name__)
