"""Robots: mounts, figures, windows and folds, symmetry, faults, and joints that have failed."""

import json
from dataclasses import replace

import numpy as np
import oracle
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from wrist_arms import IIWA, flange_of, pinocchio_wrist_arm

from mlivr_gym import Limb, RobotSpec, robot_spec
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes, folds_in_windows
from mlivr_gym.errors import MlivrError, RobotError
from mlivr_gym.robot.fields import geometric_order
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.mounts import Mount
from mlivr_gym.schema import are_rotations
from mlivr_gym.world.boxes import Box

CAPSULE = {"link": "forearm", "start": [0, 0, 0], "end": [0, 0, 0.3], "radius": 0.05}


@pytest.mark.parametrize("limbs", [2, 3, 4])
def test_mounts_are_radial_at_equal_angles(limbs):
    robot, azimuths = robot_spec(f"mlivr{limbs}"), 2 * np.pi * np.arange(limbs) / limbs
    radial = np.stack([np.cos(azimuths), np.sin(azimuths), 0.0 * azimuths], axis=1)
    assert are_rotations(robot.mount_rotations).all()
    np.testing.assert_allclose(robot.mount_rotations[:, :, 2], radial, atol=1e-12)
    np.testing.assert_allclose(robot.mount_positions, 0.1 * radial, atol=1e-12)


def test_a_robot_folds_its_limbs_as_the_limb_says_if_it_does_not():
    assert RobotSpec(limb=IIWA).folds == IIWA.default_folds
    assert len(IIWA.default_folds) > 1


def test_default_figures_are_the_published_ones():
    limb = robot_spec("mlivr2").limb
    assert oracle.lengths_of(limb) == (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996)
    # Shoulder centres of the published two-limb model lie 0.263 m from the middle.
    assert robot_spec("mlivr2").mount_radius + limb.origins[0][2] == pytest.approx(0.2625)


def test_no_part_of_a_stretched_limb_lies_beyond_the_extent():
    """The shoulder lifts the arm, elbow and wrist straight; the gripper points on."""
    for tool in (0.05, 0.3):
        robot = RobotSpec(tool_length=tool)
        joints = np.tile([0.0, -0.5 * np.pi, 0.0, 0.0, 0.5 * np.pi, 0.0], (2, 1))
        shapes = LimbShapes(robot)
        ends = capsule_ends(robot, shapes, (np.zeros(3), np.array([1.0, 0, 0, 0]), joints))
        away = (np.linalg.norm(ends, axis=3) + shapes.radii[:, None]).max()
        assert away <= robot.extent
        assert robot.extent < 1.5 * away


@pytest.mark.parametrize("tool", [0.01, 0.3])
def test_the_shape_of_a_gripper_reaches_from_the_flange_to_the_grasp(tool):
    gripper = RobotSpec(tool_length=tool).mounted[0].capsules[-1]
    low, high = sorted((gripper.start[2], gripper.end[2]))
    assert gripper.link == "gripper"
    assert low - gripper.radius <= 0.0
    assert high + gripper.radius == pytest.approx(tool)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"limbs": 1}, "limbs is 1"),
        ({"limb": {"joint_limits": [[1, 0]] * 6}}, "joint_limits"),
        ({"body_mass": 1e-300}, "^body_mass is 1e-300; it must be from 0.001 to .* kg"),
        ({"limb": {"origins": [[0, 0, 162.5]] * 6}}, "^limb.origins.* larger .*; .*millimetres"),
        ({"capsules": []}, "capsules has none on a link that moves"),
        ({"capsules": [CAPSULE | {"link": "base"}]}, "capsules has none on a link that moves"),
        ({"capsules": [CAPSULE | {"link": "hip"}]}, r"link is 'hip'; valid choices are 'base'"),
        *(
            ({"capsules": [CAPSULE | {"link": link, end: place}]}, rf"{end} .* on {link} .* axis")
            for link, end, place in (
                ("wrist_3", "start", [0, 0.1, 0]),
                ("gripper", "end", [-0.1, 0, 0]),
            )
        ),
        ([], r"the data is \[\]; it must be an object"),
    ],
)
def test_faults_are_named(data, words):
    with pytest.raises(MlivrError, match=words):
        RobotSpec.from_dict(data)


def test_a_robot_without_a_name_is_called_like_its_file(tmp_path):
    path = tmp_path / "arm.json"
    path.write_text(json.dumps({"tool_length": 0.1}))
    assert robot_spec(str(path)).name == "arm"
    assert RobotSpec.from_dict({"limbs": 3}).name == RobotSpec(limbs=3).name == "robot"
    path.write_text(json.dumps({"name": "given"}))
    assert robot_spec(str(path)).name == "given"


def test_rolls_are_ordered_by_size_the_positive_first():
    turn = 2 * np.pi - 0.1
    assert geometric_order((-0.2, 0.0, 0.3, 0.2, turn)) == (0.0, turn, 0.2, -0.2, 0.3)
    assert RobotSpec(rolls=(-0.1, 0.1)).fingerprint == RobotSpec(rolls=(0.1, -0.1)).fingerprint


@pytest.mark.parametrize("name", ["mlivr2", "ssrms2", "mlivr2-unequal"])
def test_whole_mounts_make_the_same_robot_again(name):
    """Also where limbs hold their first joint, whose place is that of the second one."""
    robot = robot_spec(name)
    again = replace(robot, mounts=robot.whole_mounts)
    np.testing.assert_array_equal(again.mount_positions, robot.mount_positions)
    np.testing.assert_array_equal(again.mount_rotations, robot.mount_rotations)
    assert again.mounted == robot.mounted


@pytest.mark.parametrize("limbs", [2, 3, 4])
def test_whatever_tells_one_limb_from_another_makes_a_robot_unsymmetric(limbs):
    """As mounted by default it is; each limb in turn moved, tilted, rolled or made another."""
    robot = robot_spec(f"mlivr{limbs}")
    even = [Mount(mount.position, mount.rotation) for mount in robot.mounted]
    assert robot.is_symmetric
    assert replace(robot, mounts=even).is_symmetric
    longer = replace(robot.limb, joint_limits=((-3.0, 3.0),) * 6)
    bare = robot.mounted[0].capsules[:-1]
    changes = [
        lambda m: {"position": tuple(np.add(m.position, (0.0, 0.0, 0.01)))},
        lambda m: {"position": tuple(np.multiply(m.position, 1.1))},
        *(
            lambda m, turn=turn: {"rotation": Box.rows(np.array(m.rotation) @ turn)}
            for turn in (Rotation.from_euler(axis, 0.1).as_matrix() for axis in "xyz")
        ),
        lambda _: {"limb": longer},
        lambda _: {"capsules": bare},
    ]
    for k in range(limbs):
        for change in changes:
            mounts = [replace(m, **change(m)) if i == k else m for i, m in enumerate(even)]
            assert not replace(robot, mounts=mounts).is_symmetric
    for axis in "xyz":  # all together about the body
        turn = Rotation.from_euler(axis, 0.1).as_matrix()
        turned = [
            Mount(tuple(turn @ m.position), Box.rows(turn @ np.array(m.rotation))) for m in even
        ]
        assert not replace(robot, mounts=turned).is_symmetric
    assert replace(robot, body_size=(0.2, 0.2, 0.3)).is_symmetric == (limbs == 2)


TURN = 2.0 * np.pi
ANGLES = st.floats(-20.0, 20.0)


@st.composite
def limbs(draw):
    """Limbs whose joints turn less than a turn, one, or more, wherever their windows begin."""
    low = [draw(ANGLES) for _ in range(6)]
    width = [draw(st.one_of(st.just(TURN), st.floats(0.1, 3.0 * TURN))) for _ in range(6)]
    limits = tuple((a, a + b) for a, b in zip(low, width, strict=True))
    return Limb(joint_limits=limits, window_starts=tuple(draw(ANGLES) for _ in range(6)))


@given(limbs())
def test_a_window_is_a_turn_within_the_limits_or_all_that_they_allow(limb):
    """As near to its start as limits let it lie, and one winding of every angle."""
    for (start, end), (low, high), wanted in zip(
        limb.windows, limb.joint_limits, limb.window_starts, strict=True
    ):
        assert low <= start
        assert end <= high
        assert end - start == pytest.approx(min(TURN, high - low))
        near = np.linspace(low, max(low, high - TURN), 1001)
        assert abs(start - wanted) <= np.abs(near - wanted).min() + 1e-9


@given(limbs(), st.lists(st.lists(ANGLES, min_size=5, max_size=5), max_size=4))
def test_folds_are_kept_where_some_winding_of_every_joint_lies_in_its_window(limb, folds):
    windings = TURN * np.arange(-20, 21)
    expected = []
    for fold in folds:
        inside = [
            [angle + k for k in windings if low <= angle + k <= high]
            for angle, (low, high) in zip(fold, limb.windows, strict=False)
        ]
        if all(inside):
            expected.append([values[0] for values in inside])
    found = folds_in_windows(limb, folds)
    np.testing.assert_allclose(found, np.array(expected).reshape(-1, 5), atol=1e-9)


PAIR = replace(robot_spec("mlivr2"), name="pair", limb=replace(IIWA, locked_angle=0.8),
                folds=IIWA.default_folds)  # fmt: skip
HELD_AT = np.array([0.3, -0.9, 0.8, 1.2, -0.4, 0.7, 0.1])


@pytest.mark.parametrize("joint", [1, 2, 3, 5, 6])
def test_the_flange_stays_where_it_is_when_a_joint_fails(joint):
    """By Pinocchio's model of all seven joints, seen from the body, in the same angles."""
    robot = PAIR.with_failed_joint(0, joint, HELD_AT[joint - 1])
    model, seen = pinocchio_wrist_arm(IIWA), []
    for spec in (PAIR, robot):
        limb = spec.every_limb[0]
        moving = limb.moving_angles(HELD_AT)
        np.testing.assert_allclose(limb.all_angles(moving), HELD_AT)
        flange = link_frames(limb, moving)[-1]
        mount = pin.SE3(spec.mount_rotations[0], spec.mount_positions[0]).homogeneous
        seen.append(mount @ flange)
    pose = flange_of(model, PAIR.limb, PAIR.limb.moving_angles(HELD_AT))[0]
    mount = pin.SE3(PAIR.mount_rotations[0], PAIR.mount_positions[0]).homogeneous
    np.testing.assert_allclose(seen, [mount @ pose] * 2, atol=1e-12)
    assert robot.limb == PAIR.limb
    assert robot.every_limb[1] == PAIR.limb
    np.testing.assert_allclose(robot.mount_positions[1], PAIR.mount_positions[1], atol=1e-12)
    assert RobotSpec.from_dict(robot.to_dict()) == robot


def test_masses_stay_known_where_the_locked_joint_itself_fails():
    robot = robot_spec("mlivr2-iiwa")
    again = robot.with_failed_joint(1, 3, 0.5)
    assert again.dynamics_of(1) == robot.dynamics_of(0)
    assert again.mounted[1].capsules == robot.mounted[0].capsules
    other = robot.with_failed_joint(1, 1, 0.5)
    assert other.dynamics_of(0) == robot.dynamics_of(0)
    assert other.mounted[1].dynamics is None
    with pytest.raises(RobotError, match="cannot be simulated"):
        other.dynamics_of(1)


def test_joints_of_two_limbs_fail_one_after_the_other_and_two_of_one_limb_are_refused():
    robot = PAIR.with_failed_joint(0, 2, -0.9)
    both = robot.with_failed_joint(1, 5, -0.4)
    held = [(limb.locked_joint, limb.locked_angle) for limb in both.every_limb]
    assert held == [(2, -0.9), (5, -0.4)]
    other = PAIR.with_failed_joint(1, 5, -0.4).with_failed_joint(0, 2, -0.9)
    assert replace(other, name=both.name) == both
    assert RobotSpec.from_dict(both.to_dict()) == both
    assert both.with_failed_joint(0, 2, -0.9) == both
    for joint in (2, 5):
        words = f"limb 0 has joint 2 failed at -0.9 rad already; with joint {joint} failed at 0.3"
        with pytest.raises(RobotError, match=words):
            both.with_failed_joint(0, joint, 0.3)
    with pytest.raises(
        RobotError, match=r"locked_angle is 0.5 rad; joint 2 turns from -0.9 to -0.9"
    ):
        replace(robot.every_limb[0], locked_angle=0.5)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"locked_joint": 4}, "singular in every posture with joint 4 locked"),
        ({"locked_joint": 7}, "quaternions make the last two axes that move parallel"),
        ({"locked_angle": 3.0}, "limb.locked_angle is 3 rad; joint 3 turns from -2.9"),
        ({"origins": ((0.1, 0.0, 0.0), *IIWA.origins[1:])}, "put joint 1 beside the z axis"),
    ],
)
def test_bad_limbs_are_refused(changes, told):
    with pytest.raises(RobotError, match=told) as caught:
        replace(IIWA, **changes)
    assert "\n" not in str(caught.value)
