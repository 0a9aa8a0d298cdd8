"""Base pose and joint angles that the user gives for the start."""

import re

import gymnasium
import numpy as np
import pytest
from coal_ruler import grasps_of
from plans import first_steps
from scipy.spatial.transform import Rotation
from state_graph import least_cost, reachable, within

from mlivr_gym import stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.commitment import committed_motion
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.planners import planner as planner_module
from mlivr_gym.simulation.execution import execute

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)


def moved_pose(graph, stance, shift, turn=(0.0, 0.0, 0.0)):
    """Return the posture of a stance, shifted [m] and rotated [rad] in its own axes."""
    posture = graph.posture(graph.indices(stance))
    rotation = posture.base_rotation[0] @ Rotation.from_rotvec(turn).as_matrix()
    position = posture.base_position[0] + posture.base_rotation[0] @ np.array(shift)
    return (*position.tolist(), *Rotation.from_matrix(rotation).as_quat(scalar_first=True).tolist())


@pytest.fixture(scope="module")
def pose(checked_graph):
    return moved_pose(checked_graph, START, (0.05, 0.03, 0.04), (0.03, -0.05, 0.1))


@pytest.fixture(scope="module")
def smaller(small_map):
    return stance_graph(small_map.subset(np.arange(len(small_map)) % 3 > 0, "smaller"))


def test_the_plan_starts_in_the_given_pose_and_costs_the_least(smaller, monkeypatch):
    """Compare with networkx over `successors`, with an edge for every step that leaves the pose.

    Where a plan cannot be committed the planner excludes one of its steps, which `successors` does
    not know.
    """
    not_executable = []

    def put_together(*given):
        parts = committed_motion(*given)
        not_executable.append(parts.failed is not None)
        return parts

    monkeypatch.setattr(planner_module, "committed_motion", put_together)
    graph, rng, found = smaller, np.random.default_rng(4), 0
    net, cost = reachable(graph), "base"
    for s in rng.integers(0, len(graph), 12):
        stance = graph.ids(graph.points[s].tolist())
        pose = moved_pose(graph, stance, rng.uniform(-0.04, 0.04, 3), rng.uniform(-0.05, 0.05, 3))
        goal = graph.base_position[rng.integers(len(graph))]
        not_executable.clear()
        result = Planner(graph).plan(stance, goal, cost, start_pose=pose, goal_tolerance=0.1)
        if result.reason == "start infeasible":
            continue
        first = graph.state(stance, pose)
        reachable(graph, first, known=net)
        truth = least_cost(net, first, within(net, goal, 0.1), cost)
        assert (result.plan is None) == np.isinf(truth), result.message
        if result.plan is not None and len(result.plan.steps):
            found += not any(not_executable)
            assert result.plan.statistics.cost >= truth - 1e-9
            if not any(not_executable):
                assert result.plan.statistics.cost == pytest.approx(truth, abs=1e-9)
            np.testing.assert_allclose(result.plan.motion.base_positions[0], pose[:3], atol=1e-12)
            assert abs(
                result.plan.motion.base_quaternions[0] @ np.array(pose[3:])
            ) == pytest.approx(1.0, abs=1e-12)
    assert found > 6


@pytest.fixture(scope="module")
def from_pose(checked_graph, pose):
    """Return the plan from the start in the given pose."""
    return Planner(checked_graph).plan(START, GOAL, "steps", start_pose=pose).unwrap()


def test_a_plan_from_a_given_pose_keeps_clear_and_is_executed(checked_graph, pose, from_pose):
    graph, plan = checked_graph, from_pose
    motion = plan.joint_path(0).samples(12)
    np.testing.assert_allclose(motion.base_positions[0], pose[:3], atol=1e-9)
    geometry = {i: p for i, p in enumerate(graph.indices(START)) if i != plan.steps[0].limb}
    swinging = motion.phase == 1
    for k in np.flatnonzero(swinging)[::3]:
        grasps = grasps_of(graph, geometry.items())
        here = (motion.base_positions[k], motion.base_quaternions[k], motion.joint_positions[k])
        assert not contacts(graph.robot, graph.grasp_map.boxes, here, 0.02 - 1e-9, grasps)
    execution = execute(graph, first_steps(plan, 1), Durations.of_step(40.0))
    assert execution.failure is None
    assert len(execution.captures) == 1


def test_given_joint_angles_are_kept(checked_graph, pose, from_pose):
    graph = checked_graph
    joints = from_pose.motion.joint_positions[0]
    how = {"start_pose": pose, "start_joints": joints + 1e-4}
    plan = Planner(graph).plan(START, GOAL, "steps", **how).unwrap()
    np.testing.assert_allclose(plan.motion.joint_positions[0], joints, atol=1e-6)
    limits = graph.robot.limb.limits
    assert (plan.motion.joint_positions >= limits[:, 0] - 1e-6).all()
    assert (plan.motion.joint_positions <= limits[:, 1] + 1e-6).all()
    for k, step in enumerate(plan.steps):  # while a limb holds its angles are continuous
        motion = plan.joint_path(k).samples(30)
        holder = 1 - step.limb
        assert np.abs(np.diff(motion.joint_positions[:, holder], axis=0)).max() < 0.6
        np.testing.assert_allclose(
            motion.joint_positions[0], plan.motion.joint_positions[k], atol=1e-6
        )


@pytest.mark.parametrize("joint", [2, 5])
def test_a_joint_outside_its_window_is_reported(checked_graph, pose, from_pose, joint):
    """The joint is within its limits but outside its window, for which no swings are made."""
    joints = from_pose.motion.joint_positions[0].copy()
    joints[1, joint] += -2.0 * np.pi if joints[1, joint] > 0.0 else 2.0 * np.pi
    how = {"start_pose": pose, "start_joints": joints}
    if joint == 2:  # the elbow's limits are its window
        with pytest.raises(SettingError, match=r"joint 3 of limb 1 .* outside its limits -3\.1416"):
            Planner(checked_graph).plan(START, GOAL, "steps", **how)
        return
    result = Planner(checked_graph).plan(START, GOAL, "steps", **how)
    assert result.reason == "start infeasible"
    assert f"joint {joint + 1} of limb 1 is at {joints[1, joint]:.4f} rad" in result.message


def test_the_environment_starts_in_the_given_pose(pose, from_pose):
    env = gymnasium.make("MLIVR-JEM-v0").unwrapped
    observation, info = env.reset(
        seed=0, options={"start": START, "start_pose": pose, "goal": GOAL}
    )
    assert observation in env.observation_space
    np.testing.assert_allclose(info["base_position"], pose[:3])
    assert abs(observation["base_quaternion"] @ np.array(pose[3:])) == pytest.approx(1.0, abs=1e-6)
    plan = from_pose
    steps = env.graph.successors(env.state)
    branch_set = np.zeros(env.action_space.n, dtype=bool)
    branch_set[steps.limb * len(env.graph.grasp_map) + steps.point] = True
    np.testing.assert_array_equal(env.action_masks(), branch_set)
    for limb, point in plan.actions:
        observation, _, _, _, info = env.step(
            limb * len(env.graph.grasp_map) + env.graph.grasp_map.index(point)
        )
        assert not info["invalid_action"]
    assert info["is_success"]
    assert info["base_translation"] == pytest.approx(plan.base_translation, abs=1e-9)


def test_the_command_line_takes_a_pose_and_joint_angles(tmp_path, pose, from_pose):
    joints, out = from_pose.motion.joint_positions[0], tmp_path / "plan.json"
    line = ["plan", "--start", *START, "--goal", *GOAL, "--cost", "steps", "--out", out]
    line += ["--start-pose", *pose, "--start-joints", *joints.ravel().tolist()]
    assert main(list(map(str, line))) == 0
    plan = Plan.load(out)
    np.testing.assert_allclose(plan.motion.base_positions[0], pose[:3], atol=1e-9)
    np.testing.assert_allclose(plan.motion.joint_positions[0], joints, atol=1e-6)


def test_a_pose_that_cannot_be_held_is_explained(checked_graph):
    graph = checked_graph
    for shift, turn, words in (
        ((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), "limb 0 does not reach point 'D2a:4'"),
        ((0.0, 0.0, -0.45), (0.0, 0.0, 0.0), r"is -?\d\.\d+ m from|every combination"),
    ):
        result = Planner(graph).plan(START, GOAL, start_pose=moved_pose(graph, START, shift, turn))
        assert result.reason == "start infeasible"
        assert re.search(words, result.message), result.message
