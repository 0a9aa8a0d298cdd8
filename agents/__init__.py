"""Policies that act in the environment, and one evaluation for all of them.

The learned policies and their training need PyTorch; they are imported from
`mlivr_gym.agents.learned` and `mlivr_gym.agents.training`.
"""

from __future__ import annotations

if __name__ == "agents":
    raise ImportError("import mlivr_gym.agents: the bare folder is not a package of its own")

from mlivr_gym.agents.evaluation import Evaluation, EvaluationTask, evaluate
from mlivr_gym.agents.policies import (
    ExpertPolicy,
    PlanPolicy,
    Policy,
    RandomPolicy,
    baseline_policy,
    planner_policy,
)

__all__ = [
    "Evaluation",
    "EvaluationTask",
    "ExpertPolicy",
    "PlanPolicy",
    "Policy",
    "RandomPolicy",
    "baseline_policy",
    "evaluate",
    "planner_policy",
]
