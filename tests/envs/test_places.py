"""The environments of other places, but the large station: observations, masks, a walk."""

import gymnasium
import numpy as np
import pytest

from mlivr_gym.motion.plan_checks import check_motion
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.setup import Setup

SHORT = 2
"""Most steps of a walk that is carried out."""


def short_plan(env):
    """Return a plan of few steps, for the first fixed task that has one, and the mask there."""
    for task in range(30):
        observation, info = env.reset(options={"task": task})
        assert observation in env.observation_space
        assert info["action_mask"].any()
        query = {"goal_tolerance": env.goal_tolerance, "options": SearchOptions(limit=2000)}
        plan = Planner(env.graph).plan(env.state, env.goal, **query).plan
        if plan is not None and 1 <= len(plan.steps) <= SHORT:
            return plan, info["action_mask"]
    raise AssertionError("none of the first tasks is near")


@pytest.mark.parametrize("name", ["Hatch", "Truss"])
def test_a_walk_in_the_place_is_planned_checked_and_carried_out_in_mujoco(name):
    place = gymnasium.make(f"MLIVR-{name}-v0").unwrapped
    (plan, mask), graph = short_plan(place), place.graph
    assert graph.grasp_map.name == name.lower()
    check_motion(plan.query, plan.world, plan.motion, graph.grasp_map)
    limb, point = plan.actions[0]
    action = limb * len(graph.grasp_map) + graph.grasp_map.index(point)
    assert mask[action]
    assert place.step(action)[0] in place.observation_space
    kind = "station" if name == "Truss" else None
    setup = Setup.of(kind, kind, kind)
    simulation = setup.simulation(graph.grasp_map, graph.robot)
    walk = execute(graph, plan, setup.timing, simulation=simulation)
    assert walk.failure is None
    assert len(walk.captures) == len(plan.steps)
    away = np.linalg.norm(plan.motion.base_positions[-1] - place.goal)
    assert away <= place.goal_tolerance + 1e-9
