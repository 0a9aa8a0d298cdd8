"""Plan on a map of your own: a floor and a wall with rails, and a locker in the corner."""

from mlivr_gym import GraspMap, stance_graph
from mlivr_gym.planners import Planner

FLOOR = [
    {"id": f"F{k}", "face": "floor", "start": [x, -0.8, 0], "end": [x, 0.8, 0], "normal": [0, 0, 1]}
    for k, x in enumerate((0.0, 0.9, 1.8))
]
WALL = [
    {"id": f"W{k}", "face": "wall", "start": [3, -0.8, z], "end": [3, 0.8, z], "normal": [-1, 0, 0]}
    for k, z in enumerate((0.5, 1.3, 2.1))
]
grasp_map = GraspMap.from_dict(
    {
        "name": "corner",
        "segments": FLOOR + WALL,
        "spacing": 0.2,
        "boxes": [
            {"id": "locker", "min": [1.2, 0.5, 0], "max": [1.5, 0.9, 0.5]},
            {"id": "wall", "min": [3.02, -1, 0], "max": [3.1, 1, 3]},
        ],
    }
)
print(grasp_map)

graph = stance_graph(grasp_map)
print(len(graph), "stances of", graph.listed.counts["considered"], "pairs of points")

result = Planner(graph).plan(("F0:4", "F1:4"), (2.3, 0.0, 1.4), "steps", goal_face="wall")
print(result.message)
if result:
    for limb, points in enumerate(result.plan.footholds):
        print(f"limb {limb}:", " -> ".join(points))
