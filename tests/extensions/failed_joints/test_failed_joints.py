"""Plans of a robot of which joints have failed: Pinocchio's seven joints reach every point."""

import json

import numpy as np
import pytest
from held_points import assert_held
from oracle import flange
from wrist_arms import pinocchio_wrist_arm

from mlivr_gym import Settings, State, stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.errors import MlivrError
from mlivr_gym.extensions.failed_joints import after_failure, reach_without
from mlivr_gym.planners import Planner
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
    present = every_angle(whole, iiwas.configuration(state)[2])
    failed = [(limb, joint, float(present[limb][joint - 1])) for limb, joint in joints]
    after, begin = after_failure(iiwas, state, joints)
    plan = Planner(after).plan(begin, goal, "steps", goal_tolerance=0.3).unwrap()
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


def test_obstacles_and_occupied_points_of_the_graph_are_kept(deck):
    graph = stance_graph(deck, "mlivr2-iiwa", SETTINGS)
    graph.add_obstacles([Box.between("bag", "obstacle", (2.9, 0.7, -0.1), (3.1, 0.9, 0.1))])
    graph.occupy(["D1a:0"])
    after, begin = after_failure(graph, graph.state(("D2b:4", "D3a:1")), [(0, 2)])
    assert after.obstacles == graph.obstacles
    assert after.occupied == graph.occupied
    assert after.robot != graph.robot
    assert after.ids(begin.stance) == ("D2b:4", "D3a:1")


@pytest.mark.parametrize(
    ("failed", "words"),
    [
        ([(0, 4)], "limb 0 cannot move with joint 4 failed"),
        ([(0, 2), (0, 5)], "limb 0 has joint 2 failed at .* rad already; with joint"),
    ],
)
def test_what_cannot_move_is_refused_in_one_line(iiwas, failed, words):
    with pytest.raises(MlivrError, match=words) as caught:
        after_failure(iiwas, iiwas.state(("D2a:2", "D3a:6")), failed)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["six joints", "seven joints"])
def test_a_joint_that_is_not_there_is_refused(request, kind):
    """Joints count from 1, limbs from 0, by every function."""
    graph = request.getfixturevalue("iiwas" if kind == "seven joints" else "small_checked_graph")
    state, last = graph.state(graph.points[0]), len(graph.robot.every_limb[0].joint_limits)
    wrong = ((0, 0, 0), (0, -1, -1), (1, last + 1, last + 1), (2, 1, 2), (-1, 1, -1))
    for limb, joint, told in wrong:
        for fail in (
            lambda limb, joint: after_failure(graph, state, [(limb, joint)]),
            lambda limb, joint: reach_without(graph, state, limb, joint, graph.base_position[:1]),
            lambda limb, joint: graph.robot.with_failed_joint(limb, joint, 0.1),
        ):
            with pytest.raises(MlivrError, match=rf"\bis {told}; "):
                fail(limb, joint)


@pytest.mark.parametrize("limb", [0, 1])
@pytest.mark.parametrize("joint", [1, 3, 6])
def test_a_limb_of_six_joints_reaches_what_it_can_hold_where_it_is(
    small_checked_graph, limb, joint
):
    """Counted by the configurations of all states with the limb at its point."""
    graph = small_checked_graph
    state = graph.state(graph.points[7])
    angle = graph.configuration(state)[2][limb, joint - 1]
    goals = np.concatenate([graph.base_position[::5], [[9.0, 9.0, 9.0]]])
    held, reached = 0, np.zeros(len(goals), dtype=bool)
    for stance in graph.points[graph.points[:, limb] == state.stance[limb]]:
        whole, angles = graph.state(stance), []
        for branch in range(16):
            sets = list(whole.branch_sets)
            sets[limb] &= 1 << branch
            if sets[limb]:
                one = graph.configuration(State(whole.stance, tuple(sets)))
                angles.append(one[2][limb, joint - 1])
        turned = np.angle(np.exp(1j * (np.array(angles) - angle)))
        if (np.abs(turned) < 1e-3).any():
            held += 1
            reached |= np.linalg.norm(goals - one[0], axis=1) <= 0.2
    assert reach_without(graph, state, limb, joint, goals) == (held, reached.sum())
    assert 1 <= held < len(graph)
    assert 0 < reached.sum() < len(goals)


def test_a_limb_of_seven_joints_reaches_each_goal_that_has_a_plan(iiwas):
    """The same goals one by one, and one where no stance is."""
    state, joint = iiwas.state(("D2b:4", "D3a:1")), 2
    goals = np.array([(2.4, 0.1, -0.3), (2.0, 0.1, -0.3), (2.6, 0.1, -0.3), (9.0, 0.0, 0.0)])
    after, start = after_failure(iiwas, state, [(0, joint)])
    reached = [bool(Planner(after).plan(start, goal, "steps")) for goal in goals.tolist()]
    assert sum(reached) >= 2
    assert not all(reached)
    assert reach_without(iiwas, state, 0, joint, goals) == (len(after), sum(reached))


def test_the_command_counts_what_is_reached_for_each_joint(small_map, tmp_path, capsys):
    path = tmp_path / "small.json"
    small_map.save(path)
    assert main(["failures", "--map", str(path), "--goals", "2", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["joint"] for row in told["joints"]] == [*range(1, 7)]
    assert all(1 <= row["stances"] <= told["stances"] for row in told["joints"])
