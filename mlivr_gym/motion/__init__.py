"""How a plan moves: the joint path of each step, and trajectories in time.

A `Plan` is a sequence of steps, each with the joint path that was checked, which is what is
executed, exported and drawn.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.motion.joint_path import PHASES, JointPath
    from mlivr_gym.motion.plan import Plan
    from mlivr_gym.motion.plan_parts import COSTS, Step
    from mlivr_gym.motion.time_scaling import Durations, quintic
    from mlivr_gym.motion.timed_configurations import TimedConfigurations
    from mlivr_gym.motion.trajectory import FREE, TimedPath, Trajectory
    from mlivr_gym.motion.trajectory_files import save_csv, save_npz, save_ros

__all__ = [
    "COSTS",
    "FREE",
    "PHASES",
    "Durations",
    "JointPath",
    "Plan",
    "Step",
    "TimedConfigurations",
    "TimedPath",
    "Trajectory",
    "quintic",
    "save_csv",
    "save_npz",
    "save_ros",
]

__getattr__, __dir__ = lazy(__name__)
