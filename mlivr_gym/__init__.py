"""Planning and learning for robots that climb hand over hand inside space stations."""

from mlivr_gym.grasp_map import GraspMap, jem_map
from mlivr_gym.robot import Limb, RobotSpec, robot_spec
from mlivr_gym.settings import Settings
from mlivr_gym.stance_graph import State, stance_graph

__all__ = ["GraspMap", "Limb", "RobotSpec", "Settings", "State", "jem_map", "robot_spec", "stance_graph"]
