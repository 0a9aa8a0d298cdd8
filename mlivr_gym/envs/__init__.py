"""Gymnasium environments: a walk is an episode, a step of the robot an action.

Tasks, rewards and observations are objects of their own, which a user may replace.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.envs.env import Attempt, MlivrEnv
    from mlivr_gym.envs.layout_tasks import LayoutTasks
    from mlivr_gym.envs.observations import Observation
    from mlivr_gym.envs.reset_options import ResetOptions
    from mlivr_gym.envs.rewards import CostReward
    from mlivr_gym.envs.task import Task, TaskGenerator
    from mlivr_gym.envs.tasks import TASKS, AnywhereTasks, WalkTasks, sample_task
    from mlivr_gym.envs.vector_env import MlivrVectorEnv
    from mlivr_gym.envs.wrappers import ActionMaskObservation, RecordVideo

__all__ = [
    "TASKS",
    "ActionMaskObservation",
    "AnywhereTasks",
    "Attempt",
    "CostReward",
    "LayoutTasks",
    "MlivrEnv",
    "MlivrVectorEnv",
    "Observation",
    "RecordVideo",
    "ResetOptions",
    "Task",
    "TaskGenerator",
    "WalkTasks",
    "sample_task",
]

__getattr__, __dir__ = lazy(__name__)
