"""Arrivals against MuJoCo's forward kinematics, and what a capture does."""

import importlib

import mujoco
import numpy as np
import pytest

from mlivr_gym.motion.clocks import Durations
from mlivr_gym.motion.regrasp import RegraspPath, planned_regrasp
from mlivr_gym.motion.trajectory import trajectory
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.controller import FEEDFORWARD
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.timing import timed_path

FED = Setup(Durations(), FEEDFORWARD)


@pytest.fixture(scope="module")
def module(experiments):
    return importlib.import_module("arrivals")


@pytest.fixture(scope="module")
def path(checked_graph):
    plan = Planner(checked_graph).plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps").unwrap()
    return RegraspPath(checked_graph, planned_regrasp(checked_graph, plan, 0))


@pytest.fixture(scope="module")
def simulation(checked_graph):
    return FED.simulation(checked_graph.grasp_map, checked_graph.robot)


def gripper(simulation, path, found, k):
    """Position of the moving gripper at sample k, by MuJoCo, with nothing held."""
    where = found.base_positions[k], found.base_quaternions[k], found.joint_positions[k]
    simulation.reset(*where, [-1, -1])
    mujoco.mj_kinematics(simulation.model, simulation.data)
    return simulation.data.site(f"limb{path.regrasp.limb}/grasp").xpos.copy()


def test_a_gripper_ends_as_far_beside_its_point_as_it_is_told(module, path, simulation):
    planned = trajectory(timed_path(path, Durations()))
    found = module.arriving(path, planned, module.Arrival(FED, offset=0.005))
    point = path.regrasp.to_point
    grasp_map = path.graph.grasp_map
    off = gripper(simulation, path, found, -1) - grasp_map.positions[point]
    np.testing.assert_allclose(off, 0.005 * grasp_map.rotations[point][:, 0], atol=1e-6)
    before = planned.phase < 2
    np.testing.assert_array_equal(
        found.joint_positions[before], planned.joint_positions[before]
    )  # fmt: skip
    assert np.abs(np.diff(found.joint_positions, axis=0)).max() < 1e-3


def test_constant_speed_is_that_of_the_lift_over_the_time(module, path, simulation):
    planned = trajectory(timed_path(path, Durations()))
    found = module.arriving(path, planned, module.Arrival(FED, constant_speed=True))
    point = path.regrasp.to_point
    normal = path.graph.grasp_map.normals[point]
    times = np.linspace(40.0, 50.0, 6)
    samples = np.searchsorted(planned.times, times - 1e-9)
    heights = [
        (gripper(simulation, path, found, k) - path.graph.grasp_map.positions[point]) @ normal
        for k in samples
    ]
    expected = path.graph.robot.lift * (50.0 - times) / 10.0
    np.testing.assert_allclose(heights, expected, atol=1e-5)


def test_without_a_reference_of_velocity_the_controller_is_told_none(module, path):
    planned = trajectory(timed_path(path, Durations()))
    found = module.arriving(path, planned, module.Arrival(FED, velocity_reference=False))
    assert not found.joint_velocities.any()
    np.testing.assert_array_equal(found.joint_positions, planned.joint_positions)


def test_a_step_by_itself_is_measured_until_a_second_after_its_capture(module, path, simulation):
    done = module.executed(path, module.Arrival(FED), simulation)
    told = done.figures()
    assert told["captured"]
    assert list(told["parts"]) == ["departure", "swing", "approach", "capture"]
    assert done.recording.times[-1] == pytest.approx(51.0, abs=0.03)
    assert done.captures[0].time == pytest.approx(50.0)


def test_a_gripper_beside_its_point_is_pulled_onto_it(module, path, simulation):
    """By a spring whose force just after the capture is stiffness times distance."""
    arrival = module.Arrival(FED, offset=0.004)
    done = module.executed(path, arrival, simulation)
    (capture,) = done.captures
    assert capture.distance == pytest.approx(0.004, abs=2e-4)
    first = np.searchsorted(done.recording.times, capture.time - 1e-9)
    force = np.linalg.norm(done.recording.grasp_forces[first, path.regrasp.limb])
    assert force == pytest.approx(Physics().grasp_stiffness * capture.distance, rel=0.1)
    exact = module.executed(path, module.Arrival(FED), simulation).figures()
    peak = done.figures()["parts"]["capture"]["peak_N_m"]
    assert peak > 20.0 * exact["parts"]["capture"]["peak_N_m"]
