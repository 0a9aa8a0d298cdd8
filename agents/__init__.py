"""Policies that act in the environments, their training, and one evaluation for all of them.

Learned policies and their training need PyTorch, which is imported when one of them is asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if __name__ == "agents":
    raise ImportError("import mlivr_gym.agents: the bare folder is not a package")

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.agents.dataset import load_dataset, write_dataset
    from mlivr_gym.agents.evaluation import Evaluation, EvaluationTask, evaluate
    from mlivr_gym.agents.learned import LearnedPolicy, load_policy
    from mlivr_gym.agents.policies import (
        ExpertPolicy,
        Policy,
        RandomPolicy,
        baseline_policy,
        planner_policy,
    )
    from mlivr_gym.agents.policy_names import policy_by_name
    from mlivr_gym.agents.test_set import load_test_set
    from mlivr_gym.agents.training import train

__all__ = [
    "Evaluation",
    "EvaluationTask",
    "ExpertPolicy",
    "LearnedPolicy",
    "Policy",
    "RandomPolicy",
    "baseline_policy",
    "evaluate",
    "load_dataset",
    "load_policy",
    "load_test_set",
    "planner_policy",
    "policy_by_name",
    "train",
    "write_dataset",
]

__getattr__, __dir__ = lazy(__name__)
