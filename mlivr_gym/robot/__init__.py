"""What a robot is made of: limbs on a body, their shapes, masses, limits, and their files.

A `RobotSpec` has it all; all else here is a part of one.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.robot.capsules import Capsule
    from mlivr_gym.robot.cargo import Cargo, LockedLimb
    from mlivr_gym.robot.dh_table import frames_of_dh, ur_dh
    from mlivr_gym.robot.from_file import read_robot
    from mlivr_gym.robot.limb import Limb
    from mlivr_gym.robot.limb_dynamics import LimbDynamics
    from mlivr_gym.robot.rigid import RigidBody
    from mlivr_gym.robot.sizes import MOST_LIMBS
    from mlivr_gym.robot.specification import ROBOTS, RobotSpec, robot_spec
    from mlivr_gym.robot.visuals import LIMB_COLOURS, Visual

__all__ = [
    "LIMB_COLOURS",
    "MOST_LIMBS",
    "ROBOTS",
    "Capsule",
    "Cargo",
    "Limb",
    "LimbDynamics",
    "LockedLimb",
    "RigidBody",
    "RobotSpec",
    "Visual",
    "frames_of_dh",
    "read_robot",
    "robot_spec",
    "ur_dh",
]

__getattr__, __dir__ = lazy(__name__)
