"""The expert: costs, heuristics, graph search and the plans that it returns."""

from __future__ import annotations

if __name__ == "planners":
    raise ImportError("import mlivr_gym.planners: the bare folder is not a package")

from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.plan_parts import Step
from mlivr_gym.planners.cost_to_go import CostToGo
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.planner import Planner
from mlivr_gym.planners.planning_result import PlanningResult
from mlivr_gym.planners.query import SearchOptions

__all__ = ["Cost", "CostToGo", "Plan", "Planner", "PlanningResult", "SearchOptions", "Step"]
