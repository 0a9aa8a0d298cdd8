"""The robots that ship as files: their figures, a plan and a walk in MuJoCo."""

import gymnasium
import numpy as np
import pytest

import mlivr_gym
from mlivr_gym import RobotSpec, robot_spec, stance_graph
from mlivr_gym.errors import RobotError
from mlivr_gym.motion.plan_checks import check_motion
from mlivr_gym.planners import Planner
from mlivr_gym.robot.specification import EVEN, ROBOTS
from mlivr_gym.simulation.execution import execute

FILES = [name for name in ROBOTS if name not in EVEN]

START, GOAL = ("D2a:4", "D2b:4"), ("D4a:0", "D4b:0")
"""A walk two racks to port; its goal is where the base of the second stance is."""

PUBLISHED = {
    "mlivr2-ur3e": (11.2, 11.2),
    "mlivr2-ur10e": (33.5, 33.5),
    "mlivr2-unequal": (33.5, 20.6),
}
"""Masses of the arms in the makers' data sheets [kg]."""


@pytest.fixture(scope="module")
def planned():
    """A graph and a plan of each robot, made once."""
    made = {}

    def of(name):
        if name not in made:
            graph = stance_graph(robot=name)
            goal = graph.configuration(graph.state(GOAL))[0].tolist()
            made[name] = graph, Planner(graph).plan(START, goal, "steps").unwrap()
        return made[name]

    return of


@pytest.mark.parametrize("name", FILES)
def test_a_robot_that_ships_is_a_file_like_a_users(name, tmp_path):
    robot = robot_spec(name)
    assert robot.name == name
    assert robot.source
    robot.save(tmp_path / "copy.json")
    assert RobotSpec.load(tmp_path / "copy.json") == robot


@pytest.mark.parametrize("name", FILES)
def test_the_arms_weigh_what_their_data_sheets_say(name):
    """The description's masses of base links are marked there as possibly incorrect."""
    robot = robot_spec(name)
    for limb, mass in enumerate(PUBLISHED[name]):
        dynamics = robot.dynamics_of(limb)
        assert dynamics.base_mass + sum(dynamics.masses) == pytest.approx(mass, rel=0.06)


@pytest.mark.parametrize("name", FILES)
def test_a_robot_that_ships_plans_a_walk(name, planned):
    graph, plan = planned(name)
    assert len(graph) > 5000
    assert 2 <= len(plan.steps) <= 8
    check_motion(plan.query, plan.world, plan.motion, graph.grasp_map)


@pytest.mark.parametrize("name", FILES)
def test_a_robot_that_ships_walks_in_mujoco(name, planned):
    execution = execute(*planned(name))
    assert execution.failure is None
    assert len(execution.captures) == len(execution.plan.steps)


@pytest.mark.parametrize("name", FILES)
def test_an_environment_takes_its_name(name):
    env = gymnasium.make("mlivr_gym:MLIVR-JEM-v0", robot=name)
    _, info = env.reset(seed=0)
    _, _, terminated, _, info = env.step(int(np.flatnonzero(info["action_mask"])[0]))
    assert info["steps"] == 1 or terminated
    env.close()


def test_a_wrong_name_is_told_all_names():
    with pytest.raises(RobotError) as error:
        mlivr_gym.stance_graph(robot="mlivr2-ur10")
    assert all(name in str(error.value) for name in ROBOTS)
