import json
from dataclasses import replace

import numpy as np
import oracle
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym import RobotSpec, robot_spec
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.errors import MlivrError
from mlivr_gym.robot.fields import geometric_order
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
