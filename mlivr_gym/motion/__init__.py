"""How a plan moves: the joint path of each step, and trajectories in time.

A `Plan` is a sequence of steps, each with its joint path, which is what is executed, exported and
drawn. Three motions of a step are close to each other: the one that was checked, on which supports
follow a straight base exactly (`transitions.steps`); the knots, taken from it (`straight_base`);
and the spline of the knots, which is executed (`joint_path`). How far the last is from the first is
measured in the middles between knots, and while the base moves the check keeps so much more than
the clearance.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.motion.joint_path import PHASES, JointPath
    from mlivr_gym.motion.plan import Plan
    from mlivr_gym.motion.plan_parts import COSTS, Step
    from mlivr_gym.motion.step_ends import StepEnds
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
    "StepEnds",
    "TimedConfigurations",
    "TimedPath",
    "Trajectory",
    "quintic",
    "save_csv",
    "save_npz",
    "save_ros",
]

__getattr__, __dir__ = lazy(__name__)
