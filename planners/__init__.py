"""The expert: costs, bounds and searches over the graph, and the plans that they find.

`Planner.plan` answers a query with a `PlanningResult`: a plan, or the reason why there is none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if __name__ == "planners":
    raise ImportError("import mlivr_gym.planners: the bare folder is not a package")

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.motion.plan import Plan
    from mlivr_gym.planners.baselines import find_walk
    from mlivr_gym.planners.cost_to_go import CostToGo
    from mlivr_gym.planners.costs import Cost
    from mlivr_gym.planners.outcome import LIMIT_REACHED
    from mlivr_gym.planners.planner import Planner
    from mlivr_gym.planners.planning_result import PROVED_IMPOSSIBLE, PlanningResult
    from mlivr_gym.planners.query import GOAL_TOLERANCE, QUERY, Goal, SearchOptions
    from mlivr_gym.planners.walks import plan_of
    from mlivr_gym.planners.why_not import Cause

__all__ = [
    "GOAL_TOLERANCE",
    "LIMIT_REACHED",
    "PROVED_IMPOSSIBLE",
    "QUERY",
    "Cause",
    "Cost",
    "CostToGo",
    "Goal",
    "Plan",
    "Planner",
    "PlanningResult",
    "SearchOptions",
    "find_walk",
    "plan_of",
]

__getattr__, __dir__ = lazy(__name__)
