"""Replan a walk twice because obstacles appear on the way.

    python experiments/interrupted_walk.py [--out results]

The robot takes two steps of its first plan, then a box appears and it replans from its present
stance. After two more steps, points ahead become occupied and it replans once more. Prints the
planning times, and writes `interrupted_walk.png` and `.svg` with the steps taken and the remainder
of each plan that was abandoned.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from reports import command_line

from mlivr_gym import Box, stance_graph
from mlivr_gym.paper import default_setup
from mlivr_gym.pictures.walk_figure import WalkedPlan, walk_figure
from mlivr_gym.planners import Planner


def main() -> None:
    """Plan, walk and replan until the goal is reached, then draw the walk."""
    out, graph = command_line(__doc__).parse_args().out, stance_graph()
    planner, setup = Planner(graph), default_setup()
    stance, goal = tuple(setup["start"]), tuple(setup["goal"])
    how: dict[str, Any] = {"cost": "weighted", "regrasp_price": 0.05}
    planner.prepare(goal, **how)
    walked_plans: list[WalkedPlan] = []
    interruptions = 0
    while True:
        began = time.perf_counter()
        plan = planner.plan(stance, goal, **how).unwrap()
        print(
            f"{1e3 * (time.perf_counter() - began):7.1f} ms: {len(plan.steps)} steps, "
            f"{plan.base_translation:.2f} m to go"
        )
        take = 2 if interruptions < 2 else len(plan.steps)
        for limb, point in plan.actions[:take]:
            stance = tuple(point if i == limb else held for i, held in enumerate(stance))
            print(f"    limb {limb} takes {point}")
        walked_plans.append(WalkedPlan(plan, take))
        here = plan.motion.base_positions[take]
        if np.linalg.norm(here - goal) <= plan.query.goal_tolerance:
            break
        interruptions += 1
        if interruptions == 1:
            middle = 0.5 * (here + np.array(goal))
            half = np.array([0.15, 0.5, 0.4])
            box = Box.between("cargo", "obstacle", middle - half, middle + half)
            graph.add_obstacles([box])
            print(f"  a box of cargo turns up at {np.round(middle, 2).tolist()}")
        else:
            ahead = [point for held in plan.stances[3:] for point in held if point not in stance]
            graph.occupy(sorted(set(ahead))[:4])
            print(f"  points {', '.join(sorted(set(ahead))[:4])} are occupied")
    steps = sum(walked.steps_taken for walked in walked_plans)
    print(f"arrived after {steps} steps and {interruptions} interruptions")
    out.mkdir(parents=True, exist_ok=True)
    walk_figure(graph.grasp_map, walked_plans, out / "interrupted_walk.png")


if __name__ == "__main__":
    main()
