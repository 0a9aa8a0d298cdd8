"""Robots written to JSON, URDF and MJCF and read again are the same, for every joint held."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from map_data import few_of_a_wall
from numeric_arms import frames_of as numeric_frames
from robot_texts import FRANKA, GEN3, one_arm, written
from unequal_robots import unequal

from mlivr_gym import RobotSpec, Settings, robot_spec
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.specification import ROBOTS
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.world.grasp_map import as_map

SAVED = {"json": RobotSpec.save, "urdf": RobotSpec.to_urdf, "xml": RobotSpec.to_mjcf}
FIGURES = ("joint_limits", "torque_limits", "speed_limits", "body_edges", "heights", "rolls",
           "tool_length", "gripper_mass", "span", "characteristic_length", "mount_positions",
           "mount_rotations", "body_mass", "lift")  # fmt: skip
ANGLES = {1: 0.4, 2: -1.1, 3: 0.8, 5: 0.4, 6: -1.1}
"""Angles at which joints can be held so that there are stances."""


def held(joint, angle):
    """A robot with iiwas, whose base is no cylinder."""
    robot = robot_spec("mlivr2-iiwa")
    limb = replace(robot.limb, held_joint=joint, held_angle=angle)
    folds = limb.default_folds
    return replace(robot, limb=limb, folds=folds, capsules=None, apart=())


def from_text(tmp_path, frames, joint, angle):
    path = written(tmp_path, one_arm(frames=frames))
    return RobotSpec.from_urdf(path, held_joint=joint, held_angle=angle, mount_radius=0.2)


def assert_same(one, other):
    """Compare all figures, and how their limbs move."""
    assert (one.limbs, one.is_symmetric) == (other.limbs, other.is_symmetric)
    for figure in FIGURES:
        close(getattr(one, figure), getattr(other, figure))
    rng = np.random.default_rng(0)
    for i in range(one.limbs):
        limbs = one.every_limb[i], other.every_limb[i]
        angles = rng.uniform(-np.pi, np.pi, (5, 6))
        close(*(link_frames(limb, angles)[:, -1] for limb in limbs))
        close(one.every_limb[i].windows, other.every_limb[i].windows)
        mine, theirs = one.dynamics_of(i), other.dynamics_of(i)
        for figure in mine.__dataclass_fields__:
            a, b = getattr(mine, figure), getattr(theirs, figure)
            assert (a is None) == (b is None), figure
            if a is not None:
                close(a, b)
        for a, b in zip(one.mounted[i].capsules, other.mounted[i].capsules, strict=True):
            assert a.link == b.link
            close([*a.start, *a.end, a.radius], [*b.start, *b.end, b.radius])


def close(one, other):
    np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-9)


def postures(robot, grasp_map):
    """Postures of stances on a map, with low thresholds, so that there are some."""
    settings = Settings(limb_threshold=0.01, base_threshold=1e-5, path_floor=0.005)
    graph = ImplicitGraph(grasp_map, robot, settings)
    stances = np.array(list(permutations(range(len(grasp_map)), robot.limbs)))
    apart = graph.compatible[stances[:, :, None], stances[:, None]].sum(axis=(1, 2))
    stances = stances[apart == robot.limbs * (robot.limbs - 1)]
    return graph.nodes(stances[np.random.default_rng(0).permutation(len(stances))[:200]])


def written_and_read(robot, tmp_path, grasp_map):
    """Robots that were written and read, by the kind of the file, which are all the same."""
    read, truth = {}, postures(robot, grasp_map)
    assert (truth.branch_sets > 0).all(axis=1).sum() > 3
    for kind, save in SAVED.items():
        path = str(tmp_path / f"again.{kind}")
        save(robot, path)
        again = read[kind] = robot_spec(path)
        assert_same(robot, again)
        found = postures(again, grasp_map)
        np.testing.assert_array_equal(found.branch_sets, truth.branch_sets)
        close(found.base_position, truth.base_position)
        close(found.base_rotation, truth.base_rotation)
    return read


@pytest.mark.parametrize("name", [2, 3, 4, *ROBOTS])
def test_robots_that_ship_are_the_same(tmp_path, name):
    """And robots of unequal limbs, by their number.

    Files have the tables that ship: they are the same to the last digit of what plans depend on.
    """
    robot = unequal(name) if isinstance(name, int) else robot_spec(name)
    world = as_map("truss") if name == "ssrms2" else few_of_a_wall(20)
    read = written_and_read(robot, tmp_path, world)
    assert read["json"] == robot
    if name in ("mlivr2", "mlivr3", "mlivr4", "mlivr2-ur3e", "mlivr2-ur10e"):
        assert {one.fingerprint for one in read.values()} == {robot.fingerprint}


@pytest.mark.parametrize("joint", ANGLES)
def test_a_robot_is_the_same_whichever_joint_is_held(tmp_path, joint):
    """Files have the six joints that move, with the base at the first of them."""
    written_and_read(held(joint, ANGLES[joint]), tmp_path, few_of_a_wall(20))


def test_a_robot_of_arms_without_a_closed_form_is_the_same(tmp_path):
    path = written(tmp_path, one_arm(frames=numeric_frames("xarm6")))
    robot = RobotSpec.from_urdf(path, capsules="ur5e")
    assert "solved numerically" in robot.source
    written_and_read(robot, tmp_path, few_of_a_wall(20))


@pytest.mark.parametrize("gripper", [(0.0, 0.0), (0.004, 0.7), (0.08, 0.0)])
def test_a_robot_has_the_same_gripper(tmp_path, gripper):
    robot = replace(robot_spec("mlivr2"), tool_length=gripper[0], gripper_mass=gripper[1])
    bare = tuple(capsule for capsule in robot.mounted[0].capsules if capsule.link != "gripper")
    for one in (robot, replace(robot, capsules=bare)):
        for kind in ("urdf", "xml"):
            path = str(tmp_path / f"again.{kind}")
            SAVED[kind](one, path)
            assert_same(one, robot_spec(path))


@pytest.mark.parametrize(
    ("frames", "joint", "angle"),
    [(FRANKA, "joint6", 1.9), (GEN3, "joint3", 0.6), (GEN3, "joint1", 0.4)],
)
def test_arms_of_other_makers_are_the_same(tmp_path, frames, joint, angle):
    robot = from_text(tmp_path, frames, joint, angle)
    written_and_read(robot, tmp_path, few_of_a_wall(20))


@pytest.mark.parametrize(
    "base",
    [{"base_mass": 0.0, "base_centre": None, "base_inertia": None},
     {"base_centre": (0.01, 0.0, 0.02)},
     {"base_inertia": (0.05, 0.06, 0.03, 0.0, 0.001, 0.0)}],
)  # fmt: skip
def test_a_base_is_the_same(tmp_path, base):
    """Without mass, or a cylinder of which one figure is another one."""
    robot = robot_spec("mlivr2")
    robot = replace(robot, dynamics=replace(robot.dynamics_of(0), **base))
    for kind, save in SAVED.items():
        path = str(tmp_path / f"again.{kind}")
        save(robot, path)
        assert_same(robot, robot_spec(path))


def test_a_base_with_mass_needs_a_centre():
    with pytest.raises(RobotError, match="base_centre is None; a base_mass of 4 kg needs it"):
        replace(robot_spec("mlivr2").dynamics_of(0), base_centre=None)
