"""Robots written to JSON, URDF and MJCF and read again are the same.

Files that nobody changed hold the robot itself; of changed ones the elements are read.
"""

import re
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest
from numeric_arms import frames_of as numeric_frames
from robot_texts import FRANKA, GEN3, one_arm, written
from unequal_robots import unequal

from mlivr_gym import RobotSpec, robot_spec
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.robot.specification import ROBOTS
from mlivr_gym.simulation.scene import robot_alone

SAVED = {"json": RobotSpec.save, "urdf": RobotSpec.to_urdf, "xml": RobotSpec.to_mjcf}


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
"""Robots whose grippers have no shape, or hardly any length: the last link has their mass in a file
that was changed."""
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
def test_a_robot_is_the_same_from_its_own_files_and_from_changed_ones(tmp_path, name):
    if name in MADE:
        robot = MADE[name]()
    else:
        frames, joint, angle = READ[name]
        path = written(tmp_path, one_arm(frames=frames))
        options = {} if joint is None else {"locked_joint": joint, "locked_angle": angle}
        robot = RobotSpec.from_urdf(path, mount_radius=0.2, **options)
    for kind, save in SAVED.items():
        save(robot, tmp_path / f"again.{kind}")
        assert robot_spec(tmp_path / f"again.{kind}") == robot
        if kind != "json":
            text = (tmp_path / f"again.{kind}").read_text()
            changed = re.sub(r'(<robot name|<mujoco model)="[^"]*"', r'\1="other"', text)
            assert text != changed
            again = robot_spec(written(tmp_path, changed, f"changed.{kind}"))
            assert (again.name, again.heights, again.span) == ("other", robot.heights, robot.span)
            if robot.mounts is None and name not in GIVEN_A_GRIPPER:
                for mine, theirs in zip(motion(robot), motion(again), strict=True):
                    np.testing.assert_allclose(mine, theirs, atol=1e-9)
