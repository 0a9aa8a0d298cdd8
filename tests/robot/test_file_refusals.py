"""What files of robots and options on them are refused for, each in one line that says why."""

import re
from pathlib import Path

import numpy as np
import pytest
from robot_texts import (
    FRANKA,
    IIWA14,
    KR16,
    UR10E,
    frames_along,
    frames_of,
    hinge,
    more,
    one_arm,
    straight_arm,
    tool_of,
    whole_robot,
    with_mesh,
    written,
)

from mlivr_gym import RobotSpec, robot_spec
from mlivr_gym.errors import RobotError

ARM, SEVEN, BESIDE = one_arm(), one_arm(frames=IIWA14), [np.eye(4), np.eye(4)]
WELD = '<equality><weld body1="limb0/gripper" body2="limb1/gripper"/></equality></mujoco>'
MJCF = robot_spec("mlivr2").to_mjcf().replace("</mujoco>", WELD)
LFS = "version https://git-lfs.github.com/spec/v1\noid sha256:0\n"
LOOP = '<joint name="again" type="fixed"><parent link="base_link"/><child link="link4"/></joint>'
THIRD = 'lower="-3.1" upper="3.0"'


def until(name, text=None):
    """An arm without a joint and what comes after it."""
    text = straight_arm() if text is None else text
    return text[: text.index(f'<joint name="{name}"')] + "</robot>"


def kind(joint, other):
    return ARM.replace(f'"{joint}" type="revolute"', f'"{joint}" type="{other}"')


def moved(place):
    """An arm whose tool frame lies elsewhere."""
    return re.sub(r'(name="fixed".*?xyz=")[^"]*', rf"\g<1>{place}", ARM, flags=re.DOTALL)


REFUSED = (
    (ARM.replace('"revolute"', '"fixed"'), {}, "the file has no limb"),
    (until("joint6", ARM), {}, "'joint1' to 'joint5' has 5 joints; a limb has six, or seven of"),
    (until("joint2", ARM), {}, r"'joint1' to 'joint1' has 1 joint; a limb has six"),
    (more(until("joint6"), hinge("gripper", "link5", "jaw")), {}, "'joint5' has 5 joints"),
    (more(until("joint6"), hinge("a", "link5", "left"), hinge("b", "link5", "right")), {},
     "branches after link 'link5' into 'left', 'right'; .*tips"),
    (moved("0.1 0.1 0.1"), {}, "the flange lies .* off the axis of joint 'joint6'"),
    (tool_of(straight_arm(), (np.deg2rad(30.0), 0.0, 0.0)), {},
     "tool frame 'tool0' leans by 30 degrees from the axis of joint 'joint6'"),
    (more(ARM, LOOP), {}, "link 'link4' is the child of 2 joints; .* tree"),
    (MJCF, {"limbs": 2}, "equality .* closes a loop"),
    (kind("joint4", "floating"), {}, "joint 'joint4' is floating; only the whole robot may float"),
    (kind("joint4", "prismatic"), {}, "joint 'joint4' is prismatic; .* must be revolute"),
    (ARM.replace(f"<limit {THIRD}", f'<mimic joint="joint2"/><limit {THIRD}'), {},
     "joint 'joint3' mimics joint 'joint2'"),
    (ARM.replace('<mass value="3.0"/>', '<mass value="-3"/>'), {},
     "link 'link3' has a mass of -3 kg; give it an"),
    (ARM.replace(THIRD, 'lower="3.1" upper="-3.0"'), {},
     "joint 'joint3' has the limits 3.1 and -3 rad; the lower one comes first"),
    (ARM.replace(THIRD, 'lower="-178" upper="172"'), {},
     "joint 'joint3' has limits from -178 to 172 rad; .* at most 100: are these deg"),
    (ARM.replace(THIRD, ""), {}, "joint 'joint3' has no limits; give it"),
    (ARM.replace('velocity="2"', 'velocity="fast"'), {}, "has the speed limit 'fast'; it must be"),
    (more(ARM, '<link name="loose"/>'), {},
     "links 'base_link' and 'loose' hang on no joint; the links must form one tree"),
    (one_arm(lengths=tuple(1000.0 * length for length in UR10E)), {},
     "m long; it must be at most 100 m: .* in millimetres"),
    (one_arm(frames=[*KR16[:2], KR16[1], *KR16[3:]]), {}, "singular in every posture"),
    (one_arm(frames=[*KR16[:6], KR16[6] @ frames_along([((0.02, 0, 0), "x", 0)])[0]]), {},
     "the flange lies 0.02 m off the axis of joint 'joint6'"),
    (with_mesh(ARM, "package://gone/a.stl"), {},
     "mesh 'package://gone/a.stl' of link 'link1' is not found; .*package_dirs"),
    (with_mesh(ARM, f"{'x' * 255}.stl"), {}, "mesh 'xxx.* of link 'link1' is not found"),
    (ARM, {"tool_frame": "hand"}, "no link or site 'hand'; it has base"),
    (ARM, {"tool_frame": ("tool0", "tool0")}, "tool_frame has 2 entries; the file has 1 limbs"),
    (ARM, {"tips": ["base_link"]}, "no joint lies before 'base_link'"),
    (ARM, {"torque_limits": (1.0, 2.0)}, "torque_limits has 2 entries; the file has 6 joints"),
    (ARM, {"wheels": 2}, "unknown field 'wheels'"),
    (ARM, {"up": (0, 0, 1)}, "up is for a whole robot"),
    (whole_robot(BESIDE), {"up": (0, 0, 0)}, "up is .* must be a direction"),
    (whole_robot(BESIDE), {"limbs": 3}, "limbs is 3; the file has 2 limbs"),
    (whole_robot(BESIDE), {"mount_radius": 0.2}, "mount_radius is 0.2; the file is a whole robot"),
    (SEVEN, {"locked_joint": "joint9"}, "'joint9'; the limb's joints are joint1, jo"),
    (SEVEN, {"locked_angle": 4.0},
     "'joint3' cannot be locked at 4 rad, .*_angle is 4 rad; joint 3 turns from -3.1 to 3 rad"),
    (SEVEN, {"locked_joint": ["joint3"] * 2}, "locked_joint has 2 entries; the file has 1 limbs"),
    (SEVEN, {"locked_joint": "joint4"}, "'joint4' cannot be locked at 0 rad, .* singular in every"),
    (SEVEN, {"locked_joint": "joint7", "locked_angle": 0.5},
     "'joint7' cannot be locked .*parallel"),
    (one_arm(frames=FRANKA), {"locked_joint": "joint6"},
     "joint 'joint6' cannot be locked at 0 rad, give another locked_angle"),
    (one_arm(frames=FRANKA).replace(THIRD, 'lower="0.2" upper="3.0"'), {},
     "'joint3' cannot be locked at 0 rad, give another locked_angle .* turns from 0.2 to 3 rad"),
    (ARM, {"locked_joint": "joint3"}, "locked_joint is .*has none locked, as only"),
    (whole_robot(BESIDE, [frames_of(UR10E), IIWA14]), {"locked_angle": 0.8},
     "locked_angle is 0.8; the limb of joints arm0_joint1"),
    (ARM.replace("<robot", "<model"), {}, "not XML"),
    (more(ARM, f"{'<a>' * 2000}{'</a>' * 2000}"), {}, "nested too deeply"),
    ("<sdf/>", {}, "outermost element is <sdf>; it must be <robot>"),
    (ARM.replace("<link", '<xacro:arm prefix=""/><link'), {}, "elements of xacro; expand it"),
    (LFS, {}, "pointer of Git LFS; .*pull"),
    ("<!DOCTYPE html>\n<html><body>404</body></html>", {}, "a web page; save the raw file"),
    ('<?xml version="1.0" encoding="klingon"?><robot/>', {}, "not KLINGON text"),
    ("", {}, "empty or larger"),
)  # fmt: skip


@pytest.mark.parametrize(("text", "options", "words"), REFUSED, ids=range(len(REFUSED)))
def test_what_is_not_supported_is_refused_in_one_line(tmp_path, text, options, words):
    path = written(tmp_path, text, "arm.xml" if "<mujoco" in text else "arm.urdf")
    with pytest.raises(RobotError, match=words) as caught:
        RobotSpec.from_urdf(Path(path), **options)
    assert "\n" not in str(caught.value)
    assert str(caught.value).count(Path(path).name) == 1


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<mass value="3.0"/>', '<mass value="nan"/>', "mass of 'link3' has value 'nan'; numbers"),
        ('lower="-3.1"', 'lower="-NaN"', "limit of 'joint3' has lower '-NaN'; numbers must be"),
    ],
)
def test_no_number_is_refused_before_mujoco_writes_a_log(tmp_path, monkeypatch, old, new, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RobotError, match=words):
        RobotSpec.from_urdf(written(tmp_path, one_arm().replace(old, new)))
    assert [file.name for file in tmp_path.iterdir()] == ["arm.urdf"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"limbs": 1}, "limbs is 1; it must be a whole number from 2 to 8"),
        ({"tips": []}, "tips has 0 entries; it must have 1"),
        ({"tool_frame": 3}, "tool_frame is 3; it must be a text"),
        ({"body_size": "x"}, "body_size is 'x'; it must be a finite number"),
        ({"torque_limits": [1, 2, 3, 4, 5, -6]}, r"torque_limits\[5\] is -6.0; it must be from"),
        ({"locked_joint": 1}, "locked_joint is 1"),
        ({"locked_angle": [float("nan")]}, r"locked_angle\[0\] is nan"),
        ({"rotor_inertia": [1]}, r"rotor_inertia has shape \(1,\), \[1\]"),
        ({"capsules": "ur3e"}, "capsules is 'ur3e'; valid choices are 'ur5e'"),
        ({"capsules": [1]}, r"capsules\[0\] is 1; it must be an object"),
        ({"package_dirs": [1]}, r"package_dirs\[0\] is 1; it must be the path of a file"),
    ],
)
def test_options_are_refused_by_name(tmp_path, options, words):
    with pytest.raises(RobotError, match=f"^{words}"):
        RobotSpec.from_urdf(written(tmp_path, one_arm()), **options)
