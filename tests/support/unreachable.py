"""Random queries without a plan."""

from mlivr_gym.planners import Planner
from mlivr_gym.stances.random_states import random_state


def unreachable(graph, rng, radius=0.05):
    """A random query without a plan: start state and goal."""
    planner = Planner(graph)
    while True:
        start = random_state(graph, rng)
        goal = graph.base_position[rng.integers(len(graph))]
        inside = (graph.grasp_map.cabin[0] <= goal).all() and (
            goal <= graph.grasp_map.cabin[1]
        ).all()
        if inside and not planner.plan(start, goal, "steps", goal_tolerance=radius):
            return start, goal
