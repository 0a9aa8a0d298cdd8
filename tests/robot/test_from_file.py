"""Robots from URDF and MJCF files, and robots that were saved and read again."""

import re
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from oracle import frames_of as numeric_frames
from robot_texts import FRANKA, GEN3, UR10E, mjcf_by_mujoco, one_arm, whole_robot, written
from unequal_robots import unequal

from mlivr_gym import RobotSpec, robot_spec
from mlivr_gym.kinematics.forms import closed_form
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.robot.specification import ROBOTS
from mlivr_gym.simulation.scene import robot_alone


def frame_at(position, axis, after_move=(0.3, 0.4, 0.5)):
    """A frame whose z axis is an axis, and whose x axis is across another one."""
    frame = np.eye(4)
    z = np.array(axis) / np.linalg.norm(axis)
    x = np.cross(after_move, z)
    x /= np.linalg.norm(x)
    frame[:3, :3], frame[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), position
    return frame


def test_a_file_s_limits_and_masses_are_the_robot_s(tmp_path):
    robot = robot_spec(written(tmp_path, one_arm()))
    dynamics = robot.dynamics_of(0)
    assert robot.limb.joint_limits[2] == (-3.1, 3.0)
    assert dynamics.torque_limits == (100.0, 101.0, 102.0, 103.0, 104.0, 105.0)
    assert dynamics.speed_limits == (2.0,) * 6
    assert (*dynamics.masses, dynamics.base_mass) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 4.0)
    assert robot.dynamics_source == "given with the robot"
    assert "rotor inertias of 0.1 kg m^2 assumed" in robot.source
    assert robot_spec("mlivr2").dynamics_source == "those of the ur5e"


def test_a_whole_robot_has_its_mounts_and_unequal_limbs(tmp_path):
    places = [
        frame_at([0.15, 0.0, 0.01], [1, 0.2, 0.1]),
        frame_at([-0.15, 0.02, 0.0], [-1, 0, 0.3]),
    ]
    small = tuple(0.7 * length for length in UR10E)
    path = written(tmp_path, whole_robot(places, [UR10E, small]))
    robot = RobotSpec.from_urdf(path)
    assert robot.limbs == 2
    assert not robot.is_symmetric
    np.testing.assert_allclose(robot.body_edges, [0.3, 0.2, 0.1], atol=1e-9)
    assert robot.body_mass == pytest.approx(20.0)
    np.testing.assert_allclose(robot.body_centre, [0.01, 0.02, 0.03], atol=1e-9)
    for limb, lengths in zip(robot.every_limb, (UR10E, small), strict=True):
        figures = closed_form(limb.steps)[0].figures
        found = [figures[name] for name in ("d1", "a2", "a3", "d4", "d5", "d6")]
        np.testing.assert_allclose(found, lengths, atol=1e-8)
    axes = [place[:3, 2] for place in places]
    np.testing.assert_allclose(robot.mount_rotations[:, :, 2], axes, atol=1e-9)
    robot = RobotSpec.from_urdf(path, tips=("arm1_tool0", "arm0_tool0"))
    assert robot.every_limb[1].arm_length > 1.1


@pytest.mark.parametrize("count", [2, 3])
def test_evenly_mounted_arms_are_recognised(tmp_path, count):
    """Their zero angles point alike, so that they have the same limits, or none."""
    places = []
    for angle in 2.0 * np.pi * np.arange(count) / count:
        axis = np.array([np.cos(angle), np.sin(angle), 0.0])
        across = np.array([-0.5 * np.sin(angle), 0.5 * np.cos(angle), np.sqrt(0.75)])
        places.append(frame_at(0.2 * axis, axis, np.cross(axis, across)))
    for kind, width in (("revolute", 12.1), ("continuous", 200.0)):
        text = whole_robot(places).replace('joint1" type="revolute"', f'joint1" type="{kind}"')
        robot = RobotSpec.from_urdf(written(tmp_path, text))
        assert robot.mounts is None
        assert robot.limbs == count
        assert robot.mount_radius == pytest.approx(0.2, abs=1e-8)
        assert np.diff(robot.limb.joint_limits[0])[0] == pytest.approx(width)


def test_a_torso_whose_arms_reach_forward_is_told_which_way_is_up(tmp_path):
    places = [frame_at([0.1, side, 0.5], [0.3, side, 0.2]) for side in (-0.2, 0.2)]
    path = written(tmp_path, whole_robot(places))
    robot = RobotSpec.from_urdf(path, up=(-2.0, 0.0, 0.0), body_size=0.2)
    model = pin.buildModelFromUrdf(path)
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    second = [data.oMi[model.getJointId(f"arm{k}_joint2")].translation for k in range(2)]
    body = pin.SE3(np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), sum(second) / 2)
    for k, mount in enumerate(robot.mounts):
        found = body.act(pin.SE3(np.array(mount.rotation), np.array(mount.position)))
        np.testing.assert_allclose(found.rotation[:, 2], places[k][:3, 2], atol=1e-9)
        away = np.cross(found.translation - places[k][:3, 3], places[k][:3, 2])
        np.testing.assert_allclose(away, 0.0, atol=1e-9)


def test_a_joint_of_an_mjcf_may_have_no_range_and_no_speed(tmp_path):
    text = mjcf_by_mujoco(robot_spec("mlivr2"))
    endless = re.sub(r'(name="limb0/joint6"[^>]*?) range="[^"]*"', r"\1", text)
    assert endless != text
    limbs = [robot_spec(written(tmp_path, t, "r.xml")).every_limb[0] for t in (text, endless)]
    spans = [np.diff(limb.joint_limits[5])[0] for limb in limbs]
    assert spans[0] == pytest.approx(4 * np.pi)
    assert spans[1] > 100.0  # as a continuous joint of a URDF
    slow = written(tmp_path, text.replace('name="speed_limits"', 'name="others"'), "slow.xml")
    assert "lacks speed limit of joint limb0/joint1" in robot_spec(slow).source
    assert RobotSpec.from_mjcf(slow, speed_limits=1.5).speed_limits.max() == 1.5


def held(joint, angle):
    """A robot with iiwas, whose base is no cylinder."""
    robot = robot_spec("mlivr2-iiwa")
    limb = replace(robot.limb, locked_joint=joint, locked_angle=angle)
    return replace(robot, limb=limb, folds=limb.default_folds, capsules=None, apart=())


def with_base(**base):
    robot = robot_spec("mlivr2")
    return replace(robot, dynamics=replace(robot.dynamics_of(0), **base))


def bare():
    """A robot whose limbs have no shape of a gripper."""
    capsules = robot_spec("mlivr2").mounted[0].capsules
    return RobotSpec(capsules=tuple(one for one in capsules if one.link != "gripper"))


MADE = {
    **{name: partial(robot_spec, name) for name in ROBOTS},
    **{f"unequal {count}": partial(unequal, count) for count in (2, 3, 4)},
    **{f"held {joint}": partial(held, joint, angle)
       for joint, angle in ((1, 0.4), (2, -1.1), (3, 0.8), (5, 0.4), (6, -1.1))},
    "no gripper": partial(RobotSpec, tool_length=0.0, gripper_mass=0.0), "bare": bare,
    "short gripper": partial(RobotSpec, tool_length=0.004, gripper_mass=0.7),
    "cargo": partial(RobotSpec, cargo=Cargo(30.0, (0.45, 0.25, 0.3), (0.02, 0.26, 0.05))),
    "no base": partial(with_base, base_mass=0.0, base_centre=None, base_inertia=None),
    "other base": partial(with_base, base_centre=(0.01, 0.0, 0.02),
                          base_inertia=(0.05, 0.06, 0.03, 0.0, 0.001, 0.0)),
}  # fmt: skip
GIVEN_A_GRIPPER = ("ssrms2", "no gripper", "bare", "short gripper")
"""Robots whose grippers have no shape, or hardly any length: the last link has their mass in MJCF.
"""

READ = {
    "franka": (FRANKA, "joint6", 1.9), "gen3": (GEN3, "joint3", 0.6),
    "gen3-first": (GEN3, "joint1", 0.4), "xarm6": (numeric_frames("xarm6"), None, None),
}  # fmt: skip


def motion(robot):
    """By MuJoCo, the mass matrix in one posture, and where the grasps are."""
    model = robot_alone(robot).compile()
    data, matrix = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[7:] = np.random.default_rng(0).uniform(-np.pi, np.pi, model.nq - 7)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, matrix)
    return matrix, [data.site(f"limb{i}/grasp").xpos for i in range(robot.limbs)]


@pytest.mark.parametrize("name", [*MADE, *READ])
def test_a_robot_is_the_same_from_its_file_and_moves_so_from_its_scene(tmp_path, name):
    if name in MADE:
        robot = MADE[name]()
    else:
        frames, joint, angle = READ[name]
        path = written(tmp_path, one_arm(frames=frames))
        options = {} if joint is None else {"locked_joint": joint, "locked_angle": angle}
        robot = RobotSpec.from_urdf(path, mount_radius=0.2, **options)
    robot.save(tmp_path / "again.json")
    assert robot_spec(tmp_path / "again.json") == robot
    if robot.mounts is None and name not in GIVEN_A_GRIPPER:
        path = written(tmp_path, mjcf_by_mujoco(robot), "again.xml")
        again = RobotSpec.from_mjcf(path)
        for mine, theirs in zip(motion(robot), motion(again), strict=True):
            np.testing.assert_allclose(mine, theirs, atol=1e-4)
