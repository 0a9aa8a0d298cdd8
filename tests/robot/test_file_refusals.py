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
    hinge,
    more,
    one_arm,
    straight_arm,
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
    (more(until("joint6"), hinge("a", "link5", "left"), hinge("b", "link5", "right")), {},
     "branches after link 'link5' into 'left', 'right'; .*tips"),
    (moved("0.1 0.1 0.1"), {}, "the flange lies .* off the axis of joint 'joint6'"),
    (more(ARM, LOOP), {}, "link 'link4' is the child of 2 joints; .* tree"),
    (MJCF, {"limbs": 2}, "equality .* closes a loop"),
    (ARM.replace(f"<limit {THIRD}", f'<mimic joint="joint2"/><limit {THIRD}'), {},
     "joint 'joint3' mimics joint 'joint2'"),
    (ARM.replace(THIRD, ""), {}, "joint 'joint3' has no limits; give it"),
    (one_arm(lengths=tuple(1000.0 * length for length in UR10E)), {},
     "m long; it must be at most 100 m: .* in millimetres"),
    (one_arm(frames=[*KR16[:6], KR16[6] @ frames_along([((0.02, 0, 0), "x", 0)])[0]]), {},
     "the flange lies 0.02 m off the axis of joint 'joint6'"),
    (with_mesh(ARM, f"{'x' * 255}.stl"), {}, "mesh 'xxx.* of link 'link1' is not found"),
    (ARM, {"torque_limits": (1.0, 2.0)}, "torque_limits has 2 entries; the file has 6 joints"),
    (one_arm(frames=FRANKA).replace(THIRD, 'lower="0.2" upper="3.0"'), {},
     "'joint3' cannot be locked at 0 rad, give another locked_angle .* turns from 0.2 to 3 rad"),
    (ARM.replace("<robot", "<model"), {}, "not XML"),
)  # fmt: skip


@pytest.mark.parametrize(("text", "options", "words"), REFUSED, ids=range(len(REFUSED)))
def test_what_is_not_supported_is_refused_in_one_line(tmp_path, text, options, words):
    path = written(tmp_path, text, "arm.xml" if "<mujoco" in text else "arm.urdf")
    with pytest.raises(RobotError, match=words) as caught:
        RobotSpec.from_urdf(Path(path), **options)
    assert "\n" not in str(caught.value)
    assert str(caught.value).count(Path(path).name) == 1
