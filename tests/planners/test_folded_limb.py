"""Robots of which a limb of six joints has lost one: it lets go and folds, and the others walk."""

import numpy as np
import oracle
import pytest
from held_points import assert_held

from mlivr_gym import robot_spec, stance_graph
from mlivr_gym.closed_loop.arm_motion import LimbMover
from mlivr_gym.closed_loop.cargo_mission import point_handle
from mlivr_gym.errors import MlivrError
from mlivr_gym.planners import Planner
from mlivr_gym.planners.failed_joint_starts import starts_with_failed_joints
from mlivr_gym.planners.failed_joints import robot_with_failed_joints
from mlivr_gym.planners.folded_limb import folded_limb
from mlivr_gym.robot.limb import Limb
from mlivr_gym.simulation.execution import execute

GOAL = {"goal": (3.0, 0.1, -0.3), "cost": "steps", "goal_tolerance": 0.5}
LIMB, JOINT = 0, 3


@pytest.fixture(scope="module")
def three(jem):
    deck = jem.subset([point[:2] in ("D1", "D2", "D3", "D4") for point in jem.ids], "deck")
    return stance_graph(deck, "mlivr3")


@pytest.fixture(scope="module")
def state(three):
    """The first state of this stance, each limb on one branch."""
    found = three.state(("D2b:4", "D2a:1", "D1b:2"))
    return found._replace(branch_sets=tuple(one & -one for one in found.branch_sets))


def angle_at(graph, state):
    return float(graph.configuration(state)[2][LIMB, JOINT - 1])


@pytest.mark.parametrize(
    ("stance", "bits", "joint", "least"),
    [
        (("D2b:4", "D2a:1", "D1b:2"), (1, 1, 8), 3, 2),
        (("D1a:6", "D2a:4", "D2a:1"), (1, 2, 2), 3, 4),
        (("D1b:1", "D2a:4", "D3a:4"), (1, 2, 1), 5, 4),
    ],
)
def test_it_lets_go_along_the_normal_and_the_way_to_the_fold_is_free(
    three, stance, bits, joint, least
):
    """The others hold by Pinocchio's kinematics; MuJoCo's shapes keep the clearance."""
    state = three.state(stance)._replace(branch_sets=bits)
    position, quaternion, joints = three.configuration(state)
    angle, ids = joints[LIMB, joint - 1], three.ids(state.stance)
    folded = folded_limb(three, state, joints, LIMB, (joint, angle))
    model, grasp_map = oracle.pinocchio_arm(Limb()), three.grasp_map
    handle = point_handle(grasp_map, ids[LIMB])
    held, mover = [None, *ids[1:]], LimbMover(three, LIMB, ())
    np.testing.assert_array_equal(folded.joints[0], joints)
    np.testing.assert_allclose(
        folded.positions - position,
        np.linspace(0.0, 1.0, len(folded.positions))[:, None] * 0.1 * handle.normal, atol=1e-12,
    )  # fmt: skip
    for place, angles in zip(folded.positions, folded.joints, strict=True):
        np.testing.assert_array_equal(angles[LIMB], joints[LIMB])
        here = place, quaternion, angles
        assert_held(three.robot, grasp_map, held, here, lambda q: oracle.flange(model, q)[0])
        mover.stand(*here)
        assert mover.is_clear(angles[LIMB], handle)
    assert np.abs(np.diff(folded.joints, axis=0)).max() < 0.3
    assert len(folded.knots) >= least
    np.testing.assert_array_equal(folded.knots[0], joints[LIMB])
    np.testing.assert_array_equal(folded.knots[:, joint - 1], angle)
    for first, last in zip(folded.knots[:-1], folded.knots[1:], strict=True):
        for s in np.linspace(0.0, 1.0, 200):
            assert mover.is_clear(first + s * (last - first))
    locked = folded.robot.cargo.limb
    np.testing.assert_array_equal(locked.joints, folded.knots[-1])
    assert folded.robot.limbs == 2


def test_the_others_walk_on_with_the_folded_limb_in_mujoco(three, state):
    failed = [(LIMB, JOINT, angle_at(three, state))]
    plan = Planner(three).plan(state.stance, failed_joints=failed, **GOAL).unwrap()
    robot = plan.world.robot
    assert robot.limbs == 2
    assert robot.name == "mlivr3-limb0-joint3"
    assert robot.cargo.limb.joints[JOINT - 1] == failed[0][2]
    assert plan.stances[0] == three.ids(state.stance)[1:]
    assert len(plan.steps) > 0
    assert execute(stance_graph(three.grasp_map, robot), plan).failure is None


def test_a_plan_starts_where_the_limb_has_folded(three, state):
    """From given joints: those of the others then have one start, after the lift."""
    position, quaternion, joints = three.configuration(state)
    angle = float(joints[LIMB, JOINT - 1])
    folded, failed = folded_limb(three, state, joints, LIMB, (JOINT, angle)), (LIMB, JOINT, angle)
    start = three.ids(state.stance), (*position, *quaternion), joints
    ((graph, (points, pose, given)),) = starts_with_failed_joints(three, [failed], start)
    assert graph.robot == folded.robot
    assert tuple(points) == three.ids(state.stance)[1:]
    np.testing.assert_allclose(pose, (*folded.positions[-1], *quaternion))
    np.testing.assert_allclose(given, folded.joints[-1, 1:], atol=1e-12)


@pytest.mark.parametrize(
    ("failed", "words"),
    [
        ([(3, 2, 0.4)], r"failed_joints\[0\]\[0\] is 3; it must be a whole number from 0 to 2"),
        ([(0, 7, 0.4)], r"failed_joints\[0\]\[1\] is 7; it must be a whole number from 1 to 6"),
        ([(0, 3, 7.0)], r"failed_joints\[0\]\[2\] is 7.0; it must be from .* rad"),
        ([(0, 3, 0.1)], r"joint 3 of limb 0 is at .* rad at the start, not at 0.1000 rad"),
        ([(0, 3, 0.1), (1, 2, 0.1)],
         r"failed_joints\[1\] is \(1, 2, 0.1\), but joint 3 of limb 0 has failed, too; these"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(three, state, failed, words):
    with pytest.raises(MlivrError, match=words) as caught:
        Planner(three).plan(state.stance, failed_joints=failed, **GOAL)
    assert "\n" not in str(caught.value)


def test_a_start_from_which_it_cannot_let_go_is_told(three):
    """Limb 2 is stretched, so the body does not rise."""
    start = three.state(("D2a:1", "D2b:3", "D2b:4"))
    failed = [(LIMB, JOINT, angle_at(three, start))]
    result = Planner(three).plan(start, failed_joints=failed, **GOAL)
    assert result.plan is None
    assert result.reason == "start infeasible"
    assert "limb 0 cannot let go of 'D2a:1': limb 2 does not follow the body" in result.message


@pytest.mark.parametrize(("limb", "joint", "angle"), [(0, 3, 1.0), (2, 1, -0.4), (1, 5, 0.2)])
def test_the_robot_alone_stands_folded_with_the_joint_at_its_angle(limb, joint, angle):
    robot = robot_with_failed_joints(robot_spec("mlivr3"), [(limb, joint, angle)])
    assert robot.limbs == 2
    assert robot.cargo.limb.joints[joint - 1] == angle
    assert robot.cargo.limb.mount.position == robot_spec("mlivr3").mounted[limb].position
