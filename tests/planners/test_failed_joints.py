"""Plans of a robot of which joints have failed: Pinocchio's seven joints reach every point."""

import numpy as np
import pytest
from held_points import assert_held
from oracle import flange
from wrist_arms import pinocchio_wrist_arm

from mlivr_gym import Settings, stance_graph
from mlivr_gym.errors import RobotError, SettingError
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.world.boxes import Box

SETTINGS = Settings(limb_threshold=0.03)


@pytest.fixture(scope="module")
def deck(jem):
    return jem.subset([point[:2] in ("D1", "D2", "D3", "D4") for point in jem.ids], "deck")


@pytest.fixture(scope="module")
def iiwas(deck):
    return stance_graph(deck, "mlivr2-iiwa", SETTINGS)


def every_angle(robot, joints):
    """All seven angles of each limb from the six that move."""
    return [limb.all_angles(q) for limb, q in zip(robot.every_limb, joints, strict=True)]


@pytest.mark.parametrize(
    ("start", "goal", "joints"),
    [
        (("D2a:2", "D3a:6"), (3.449, 0.113, -0.299), [(0, 2)]),
        (("D2b:4", "D3a:1"), (2.352, 0.101, -0.299), [(0, 5), (1, 2)]),
        (("D2b:4", "D3a:1"), (2.0, 0.1, -0.3), [(0, 3), (1, 5)]),
    ],
)
def test_every_posture_of_a_plan_has_the_failed_joints_at_their_angles(iiwas, start, goal, joints):
    """Seven joints, the failed at its angle, have the tool of each limb that holds at its point."""
    whole, model = iiwas.robot, pinocchio_wrist_arm(iiwas.robot.limb)
    state = iiwas.state(start)
    position, quaternion, moving = iiwas.configuration(state)
    present = every_angle(whole, moving)
    failed = [(limb, joint, float(present[limb][joint - 1])) for limb, joint in joints]
    options = {"goal_tolerance": 0.3, "options": SearchOptions(failed_joints=failed)}
    plan = Planner(iiwas).plan(state, goal, "steps", **options).unwrap()
    pose = {"start_pose": (*position, *quaternion), "start_joints": moving}
    again = Planner(iiwas).plan(start, goal, "steps", **pose, **options).unwrap()
    assert again.actions == plan.actions
    robot = plan.world.robot
    np.testing.assert_allclose(every_angle(robot, plan.configuration(0)[2]), present, atol=1e-6)
    assert len(plan.steps) > 1
    for k in range(len(plan.steps)):
        motion, stances = plan.joint_path(k).samples(12), plan.stances[k : k + 2]
        kept = [a if a == b else None for a, b in zip(*stances, strict=True)]
        rows = motion.base_positions, motion.base_quaternions, motion.joint_positions
        for place, turn, angles in zip(*rows, strict=True):
            every = every_angle(robot, angles)
            assert all(every[limb][joint - 1] == angle for limb, joint, angle in failed)
            limits = np.array(whole.limb.joint_limits).T
            assert ((every >= limits[0] - 1e-6) & (every <= limits[1] + 1e-6)).all()
            assert_held(whole, iiwas.grasp_map, kept, (place, turn, every),
                        lambda q: flange(model, q)[0], atol=1e-6)  # fmt: skip


def test_obstacles_and_occupied_points_of_the_graph_are_kept(iiwas):
    start, goal, failed = ("D2b:4", "D3a:1"), (2.352, 0.101, -0.299), (0, 3, 0.8)
    options = {"goal_tolerance": 0.3, "options": SearchOptions(failed_joints=[failed])}
    free = Planner(iiwas).plan(start, goal, "steps", **options).unwrap()
    box = Box.between("bag", "obstacle", (2.9, 0.7, -0.1), (3.1, 0.9, 0.1))
    taken = [point for point in free.stances[-1] if point not in start][:1]
    found = []
    for robot, given in (
        (iiwas.robot, options),
        (iiwas.robot.with_failed_joint(*failed), {"goal_tolerance": 0.3}),
    ):
        graph = stance_graph(iiwas.grasp_map, robot, SETTINGS)
        graph.add_obstacles([box])
        graph.occupy(taken)
        found.append(Planner(graph).plan(start, goal, "steps", **given).unwrap())
    assert found[0].actions == found[1].actions != free.actions
    assert found[0].world == found[1].world != free.world


@pytest.mark.parametrize(
    ("failed", "words"),
    [
        ([(0, 2, 0.4)], r"joint 2 of limb 0 is at -?\d\.\d+ rad at the start, not at 0.4000 rad"),
        ([(0, 4, 0.4)], "limb 0 cannot move with joint 4 failed"),
        ([(0, 2, -1.0), (0, 5, 0.4)], "joint 2 of limb 0 has failed at -1 rad already; with joint"),
        ([(3, 2, 0.4)], r"failed_joints\[0\]\[0\] is 3; it must be a whole number from 0 to 1"),
        ([(0, 2)], r"failed_joints\[0\] is \(0, 2\); it must be limb, joint and angle"),
        ([(0, 2, "wide")], r"failed_joints\[0\]\[2\] is 'wide'; it must be a finite number"),
        ([(0, 9, 0.4)], r"failed_joints\[0\]\[1\] is 9; it must be a whole number from 1 to 7"),
        (7, "failed_joints is 7; it must be a list"),
    ],
)
def test_what_cannot_be_planned_with_is_refused_in_one_line(iiwas, failed, words):
    state = iiwas.state(("D2a:2", "D3a:6"))
    with pytest.raises((RobotError, SettingError), match=words) as caught:
        Planner(iiwas).plan(state, (3.0, 0.0, -0.3), options=SearchOptions(failed_joints=failed))
    assert "\n" not in str(caught.value)
