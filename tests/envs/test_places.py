"""The environments of places, on the whole of their maps: checkers, masks, and a simulated walk."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

from mlivr_gym.motion.plan_checks import check_motion
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.setup import Setup

PLACES = {
    "MLIVR-JEM-v0": "jem", "MLIVR-Random-v0": "jem", "MLIVR-USLab-v0": "uslab",
    "MLIVR-Columbus-v0": "columbus", "MLIVR-Hatch-v0": "hatch", "MLIVR-Station-v0": "station",
    "MLIVR-Truss-v0": "truss",
}  # fmt: skip
"""Environments, and the maps that ship, in which they are."""

SHORT = 3
"""Most steps of a walk that is carried out."""


@pytest.fixture(scope="module", params=PLACES)
def place(request):
    return gymnasium.make(request.param).unwrapped


def test_an_environment_of_a_place_is_sound(place):
    assert place.graph.grasp_map.name == PLACES[place.spec.id]
    check_env(place, skip_render_check=True)
    check_env_of_sb3(place)


def short_plan(env):
    """Return a plan of few steps, for the first fixed task that has one."""
    for task in range(20):
        env.reset(options={"task": task})
        query = {"cost": "base", "goal_tolerance": env.goal_tolerance, "limit": 2000}
        plan = Planner(env.graph).plan(env.state, env.goal, **query).plan
        if plan is not None and 1 <= len(plan.steps) <= SHORT:
            return plan
    raise AssertionError("none of the first tasks is near")


def test_a_walk_in_the_place_is_planned_checked_and_carried_out_in_mujoco(place):
    plan, graph = short_plan(place), place.graph
    check_motion(plan.query, plan.world, plan.motion, graph.grasp_map)
    kind = "station" if "Truss" in place.spec.id else None
    setup = Setup.of(kind, kind, kind)
    simulation = setup.simulation(graph.grasp_map, graph.robot)
    walk = execute(graph, plan, setup.timing, simulation=simulation)
    assert walk.failure is None
    assert len(walk.captures) == len(plan.steps)
    away = np.linalg.norm(plan.motion.base_positions[-1] - place.goal)
    assert away <= place.goal_tolerance + 1e-9
