"""Plan, block the way with a box and occupied points, and plan again."""

import time

from mlivr_gym import Box, stance_graph
from mlivr_gym.planners import Planner

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)

graph = stance_graph()
planner = Planner(graph)


def replan(world: str) -> None:
    """Plan in the present world, and print the result or why there is no plan."""
    began = time.perf_counter()
    result = planner.plan(START, GOAL, "steps")
    print(f"{world}: {result.message} ({1e3 * (time.perf_counter() - began):.0f} ms)")
    if not result:
        print("  because:", planner.why_not(START, GOAL).message)


replan("free module")

graph.add_obstacles([Box.between("cargo", "obstacle", (3.4, -1.0, -1.0), (3.7, 1.0, 0.2))])
replan("a box in the way")

graph.occupy(["D3a:3", "D3a:4"])
replan("two points occupied, too")

goal_points = [point for point in graph.grasp_map.ids if point[1] in "56"]
graph.occupy(goal_points)
replan("every point near the goal occupied")

graph.remove_obstacles()
graph.vacate()
replan("free module again")
