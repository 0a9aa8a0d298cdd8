"""Plans can be executed: grasps, joint paths, thresholds and joint limits."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from arms import jacobian
from oracle import at_grasp
from paper import NO_COLLISIONS
from random_steps import random_walk

from mlivr_gym import Box, Limb, Settings, robot_spec, stance_graph
from mlivr_gym.kinematics.manipulability import base_manipulability, limb_manipulability
from mlivr_gym.motion.commitment import committed_motion, hold_intervals
from mlivr_gym.planners import Planner
from mlivr_gym.robot.limb import link_frames


def test_unchecked_plans_do_without_joint_limits(small_map):
    """Where steps are not checked, limits over a hold are not either, and nothing fails for it."""
    robot = replace(robot_spec("mlivr2"), limb=Limb(joint_limits=((-1.0, 1.0),) * 6))
    graph = stance_graph(small_map, robot, Settings(collisions=False, transitions=False))
    plan = (
        Planner(graph)
        .plan(graph.points[0].tolist(), graph.base_position[-1], goal_tolerance=0.3)
        .unwrap()
    )
    assert np.isfinite(plan.motion.joint_positions).all()
    assert {step.swing for step in plan.steps} == {"unchecked"}


def check_walk(graph, states):
    """Put a walk together, and look whether its joints stay in their windows all along."""
    motion = committed_motion(graph, states).motion
    assert motion is not None
    low, high = graph.robot.limb.windows.T
    assert (motion.joint_positions >= low - 1e-6).all()
    assert (motion.joint_positions <= high + 1e-6).all()
    for k, step in enumerate(motion.steps):
        path = motion.joint_path(graph.robot, k)
        np.testing.assert_allclose(path.knots[0], motion.joint_positions[k], atol=1e-7)
        np.testing.assert_allclose(path.knots[-1], motion.joint_positions[k + 1], atol=1e-7)
        assert (path.knots >= low - 1e-6).all()
        assert (path.knots <= high + 1e-6).all()
        # From above a point the limb comes down without a whole turn.
        for end in (slice(path.rests[1] + 1), slice(path.rests[-2], None)):
            assert np.abs(np.diff(path.knots[end], axis=0)).sum(axis=0).max() < np.pi
        if step.swing == "direct":
            swing = path.knots[path.rests[1] : path.rests[2] + 1, step.limb]
            turn = swing[-1] - swing[0]
            share = (swing - swing[0]) @ turn / (turn @ turn)
            np.testing.assert_allclose(swing, swing[0] + share[:, None] * turn, atol=1e-9)
    return motion


def test_every_walk_of_legal_steps_is_put_together(checked_graph):
    graph, rng, kinds = checked_graph, np.random.default_rng(0), Counter()
    ends = rng.uniform(graph.grasp_map.cabin[0], graph.grasp_map.cabin[1], (12, 3))
    rods = [
        Box.between(f"rod{k}", "obstacle", end - 0.02, end + rng.uniform(0.03, 0.5, 3))
        for k, end in enumerate(ends)
    ]
    graph.add_obstacles(rods)
    try:
        for _ in range(64):  # a changed swing is rare
            motion = check_walk(graph, random_walk(graph, rng, 8))
            assert len(motion.steps) == 8  # legal steps never run out
            kinds.update(step.swing for step in motion.steps)
    finally:
        graph.remove_obstacles()
    assert min(kinds[kind] for kind in ("direct", "over", "folded", "changed")) > 0


@pytest.mark.parametrize("limbs", [3, 4])
def test_every_walk_of_more_limbs_is_put_together(small_map, limbs):
    graph, rng = stance_graph(small_map, f"mlivr{limbs}"), np.random.default_rng(limbs)
    for _ in range(4):
        check_walk(graph, random_walk(graph, rng, 4))


@pytest.mark.parametrize("limbs", [2, 3, 4])
def test_manipulability_of_a_plan_is_that_of_its_joint_angles(small_map, limbs):
    """By the definitions in NumPy, at every stance."""
    graph = stance_graph(small_map, f"mlivr{limbs}", NO_COLLISIONS)
    robot, l_c = graph.robot, graph.robot.characteristic_length
    states = random_walk(graph, np.random.default_rng(1), 6)
    motion = committed_motion(graph, states).motion
    for k, joints in enumerate(motion.joint_positions):
        jacobians, grasps = [], []
        for i, q in enumerate(joints):
            of_limb = jacobian(robot.limb, q)
            assert motion.w_m[k, i] == pytest.approx(limb_manipulability(of_limb, l_c), rel=1e-6)
            of_grasp, grasp = at_grasp(robot, i, link_frames(robot.limb, q)[6], of_limb)
            jacobians.append(of_grasp)
            grasps.append(grasp)
        truth = base_manipulability(np.array(jacobians), np.array(grasps), l_c)
        assert motion.w_b[k] == pytest.approx(truth, rel=1e-6)


def test_a_hold_is_on_the_branch_whose_least_manipulability_is_the_largest(small_graph):
    """Of those that its last state keeps; by the definition, from the joint angles of each."""
    graph, rng, long = small_graph, np.random.default_rng(0), 0
    for _ in range(12):
        states = random_walk(graph, rng, 6)
        points = np.array([state.stance for state in states])
        motion, postures = committed_motion(graph, states).motion, graph.postures_of(states)
        for limb in range(2):
            for first, last in hold_intervals(points, limb):
                least = {}
                for bit in (b for b in range(16) if states[last].branch_sets[limb] >> b & 1):
                    bits = motion.branches.copy()
                    bits[:, limb] = bit
                    joints = graph.joints(points, postures, bits)[first : last + 1, limb]
                    least[bit & 7] = min(
                        limb_manipulability(
                            jacobian(graph.robot.limb, q), graph.robot.characteristic_length
                        )
                        for q in joints
                    )
                chosen = set(motion.branches[first : last + 1, limb].tolist())
                assert len(chosen) == 1
                assert least[chosen.pop()] >= max(least.values()) - 1e-9
                long += last > first and len(set(np.round(list(least.values()), 9))) > 1
    assert long > 10
