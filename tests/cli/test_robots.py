"""Options of commands that describe a robot, its map and the settings."""

import argparse
import json

import numpy as np
import pytest
from robot_texts import FRANKA, IIWA14, UR10E, one_arm, whole_robot, written

from mlivr_gym import RobotSpec, Settings, robot_spec
from mlivr_gym.cli.arguments import (
    chosen_map,
    chosen_settings,
    environment_arguments,
    world_options,
)
from mlivr_gym.cli.robots import chosen_robot
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.robot.cargo import Cargo


def parsed(*words):
    """The options of a command that takes a robot."""
    parser = argparse.ArgumentParser()
    world_options(parser)
    parser.set_defaults(default=parser.get_default, quiet=False)
    return parser.parse_args(words)


def chosen(*words):
    """The robot that these options describe."""
    return chosen_robot(parsed(*words))


def test_options_on_a_file_are_the_arguments_of_from_urdf(tmp_path):
    path = written(tmp_path, one_arm(frames=FRANKA))
    words = ["--locked-joint", "joint6", "--locked-angle", "1.8", "--tool-frame", "link7"]
    expected = RobotSpec.from_urdf(
        path, locked_joint="joint6", locked_angle=1.8, tool_frame="link7"
    )
    assert chosen("--robot", path, *words) == expected
    assert expected != RobotSpec.from_urdf(path, locked_joint="joint6", locked_angle=1.8)
    frames = np.tile(np.eye(4), (2, 1, 1))
    frames[0, :3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    frames[1, :3, :3] = [[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]]
    frames[:, 0, 3] = 0.3, -0.3
    two = written(tmp_path, whole_robot(frames, [UR10E, IIWA14]), "two.urdf")
    words = ["--locked-joint", "none", "arm1_joint2", "--locked-angle", "none", "-1.2"]
    options = {"locked_joint": [None, "arm1_joint2"], "locked_angle": [None, -1.2]}
    assert chosen("--robot", two, *words) == RobotSpec.from_urdf(two, **options)


def test_packages_are_found_in_the_folders_that_are_named(tmp_path):
    elsewhere = tmp_path / "elsewhere" / "arms"
    elsewhere.mkdir(parents=True)
    corners = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
    lines = [f"v {x} {y} {z}\n" for x, y, z in corners]
    (elsewhere / "part.obj").write_text("".join(lines) + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    text = one_arm().replace(
        '<sphere radius="0.03"/>', '<mesh filename="package://arms/part.obj"/>', 1
    )
    path = written(tmp_path, text)
    robot = chosen("--robot", path, "--package-dir", str(elsewhere.parent))
    assert robot == RobotSpec.from_urdf(path, package_dirs=[elsewhere.parent])


def test_links_that_touch_in_every_posture_are_not_compared_on_request(tmp_path):
    """Shapes of wrist 1 and wrist 3 are so large that they meet around the joint between."""
    path = written(tmp_path, one_arm().replace('radius="0.03"', 'radius="0.12"'))
    assert chosen("--robot", path).apart == ()
    apart = chosen("--robot", path, "--allow-touching").apart
    assert ("wrist_1", "wrist_3") in apart
    assert ("base", "upper_arm") not in apart


def test_joints_that_have_failed_are_those_of_with_failed_joint(run, ladder_file):
    words = ["--robot", "mlivr2-iiwa", "--failed-joint", "0", "2", "-1.5"]
    words += ["--failed-joint", "1", "5", "0.25"]
    robot = robot_spec("mlivr2-iiwa").with_failed_joint(0, 2, -1.5).with_failed_joint(1, 5, 0.25)
    assert chosen(*words) == robot
    args = parsed(*words)
    assert RobotSpec.from_dict(environment_arguments(args)["robot"]) == robot
    given = "--robot mlivr2-iiwa --failed-joint 0 3 0.8 --limb-threshold 0.05 --no-collisions"
    code, out, _ = run(f"info --json --map {ladder_file} {given}")
    assert code == 0
    assert json.loads(out)["robot"]["name"] == "mlivr2-iiwa-limb0-joint3"


@pytest.mark.parametrize(
    ("words", "settings", "robot"),
    [
        ("", {}, {}),
        ("--no-manipulability", {"manipulability": False}, {}),
        ("--no-transitions", {"transitions": False}, {}),
        ("--no-collisions", {"collisions": False}, {}),
        ("--clearance 0.03", {"clearance": 0.03}, {}),
        ("--limb-threshold 0.05", {"limb_threshold": 0.05}, {}),
        ("--base-threshold 1e-4", {"base_threshold": 1e-4}, {}),
        ("--cargo 5 0.1 0.2 0.3", {}, {"cargo": Cargo(5.0, (0.1, 0.2, 0.3))}),
        ("--robot mlivr2-ur3e", {}, {"name": "mlivr2-ur3e"}),
        ("--unit mm", {}, {}),
    ],
)
def test_each_option_means_the_same_to_plans_and_to_environments(
    ladder, tmp_path, words, settings, robot
):
    """It changes what it names and nothing else, whether a plan or a policy is asked for."""
    path, scale = tmp_path / "map.json", 1000.0 if "mm" in words else 1.0
    points = [
        {"id": name, "face": "deck", "position": place, "normal": [0, 0, 1], "rail": [0, 1, 0]}
        for name, place in zip(ladder.ids, (scale * ladder.positions).tolist(), strict=True)
    ]
    cabin = dict(zip(("min", "max"), (scale * np.array(ladder.cabin)).tolist(), strict=True))
    path.write_text(json.dumps({"name": "ladder", "points": points, "cabin": cabin}))
    args = parsed("--map", str(path), *words.split())
    vars(args).setdefault("quiet", True)
    assert chosen_settings(args) == Settings(**settings)
    name = robot.pop("name", "mlivr2")
    found, expected = chosen_robot(args), robot_spec(name)
    assert (found.name, found.limb) == (name, expected.limb)
    for key, value in robot.items():
        assert getattr(found, key) == value
    assert robot or found == expected
    there = chosen_map(args)
    np.testing.assert_allclose(there.positions, ladder.positions, atol=1e-9)
    graph = MlivrEnv(**environment_arguments(args)).graph
    assert graph.robot == found
    assert graph.grasp_map.fingerprint == there.fingerprint
    assert graph.settings == Settings(**settings)
