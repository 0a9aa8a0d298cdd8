"""The expert: costs, heuristics, graph search and the plans they return."""

from __future__ import annotations

if __name__ == "planners":
    raise ImportError("import mlivr_gym.planners: the bare folder is not a package of its own")







