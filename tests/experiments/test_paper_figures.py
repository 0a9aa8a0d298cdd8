"""Paths of base and grippers, and what is kept of numbers."""

import importlib

import numpy as np
import pytest

from mlivr_gym.planners import Planner
from mlivr_gym.simulation.simulator import Simulation


@pytest.fixture(scope="module")
def module(experiments):
    return importlib.import_module("paper_figures")


@pytest.fixture(scope="module")
def plan(checked_graph):
    return Planner(checked_graph).plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps").unwrap()


def test_grippers_are_at_their_points_in_the_stances_of_a_plan(module, checked_graph, plan):
    simulation = Simulation(checked_graph.grasp_map, checked_graph.robot)
    motion = plan.motion
    poses = motion.base_positions, motion.base_quaternions, motion.joint_positions
    points = [checked_graph.indices(stance) for stance in plan.stances]
    expected = checked_graph.grasp_map.positions[np.array(points)]
    np.testing.assert_allclose(module.grippers(simulation, poses), expected, atol=1e-6)


def test_the_steps_of_a_plan_come_with_both_swings(module, checked_graph, plan):
    steps = module.planned_steps(checked_graph, [plan, plan])
    assert [(step.plan, step.step) for step in steps] == [
        (number, k) for number in range(2) for k in range(len(plan.steps))
    ]
    for step in steps:
        told = module.swings_told(step)
        assert sum(told["attempts"].values()) == len(step.found)
        assert told["any_branch"] == step.task.outcome
        regrasp = step.path.regrasp
        on_branch = [a for a in step.found if a.branch == regrasp.branches[regrasp.limb]]
        assert told["planned_branch"] in {attempt.outcome for attempt in on_branch}
        assert told["taken"]["as_planned"] == (step.task in on_branch)


def test_deviations_are_distances(module):
    planned, actual = np.zeros((2, 3, 3)), np.zeros((2, 3, 3))
    actual[1, 2] = 3.0, 0.0, 4.0
    paths = module.WalkPaths(np.arange(2.0), planned, actual)
    np.testing.assert_array_equal(paths.deviations, [[0.0, 0.0, 0.0], [0.0, 0.0, 5.0]])
    assert paths.names == ["base", "gripper 0", "gripper 1"]
    assert len(paths.colours) == 3


def test_numbers_are_rounded_and_nothing_else(module):
    data = {"a": [1.23456789, 3, "text", None, True], "b": {"c": 1.23456789e-7}}
    assert module.rounded(data) == {"a": [1.23457, 3, "text", None, True], "b": {"c": 1.23457e-7}}
