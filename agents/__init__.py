"""Policies that act in the environment, and one way to evaluate them all."""

from __future__ import annotations

if __name__ == "agents":
    raise ImportError("import mlivr_gym.agents: the bare folder is not a package of its own")

from mlivr_gym.agents.evaluation import Evaluation, evaluate
from mlivr_gym.agents.policies import ExpertPolicy, Policy, RandomPolicy

__all__ = ["Evaluation", "ExpertPolicy", "Policy", "RandomPolicy", "evaluate"]
