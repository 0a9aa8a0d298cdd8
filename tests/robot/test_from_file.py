"""Robots from URDF and MJCF: Pinocchio and MuJoCo tell where flanges are and how links move."""

import json
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robot_texts import UR10E, one_arm, whole_robot, written
from scipy.spatial.transform import Rotation

from mlivr_gym import RobotSpec, robot_spec
from mlivr_gym.errors import RobotError
from mlivr_gym.kinematics.forms import closed_form


def place(position, axis, after_move=(0.3, 0.4, 0.5)):
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
    places = [place([0.15, 0.0, 0.01], [1, 0.2, 0.1]), place([-0.15, 0.02, 0.0], [-1, 0, 0.3])]
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
    np.testing.assert_allclose(
        robot.mount_rotations[:, :, 2], [p[:3, 2] for p in places], atol=1e-9
    )
    assert (
        RobotSpec.from_urdf(path, tips=("arm1_tool0", "arm0_tool0")).every_limb[1].arm_length > 1.1
    )


@pytest.mark.parametrize("count", [2, 3])
def test_evenly_mounted_arms_are_recognised(tmp_path, count):
    """Their zero angles point alike, so that they have the same limits."""
    places = []
    for angle in 2.0 * np.pi * np.arange(count) / count:
        axis = np.array([np.cos(angle), np.sin(angle), 0.0])
        across = np.array([-0.5 * np.sin(angle), 0.5 * np.cos(angle), np.sqrt(0.75)])
        places.append(place(0.2 * axis, axis, np.cross(axis, across)))
    robot = RobotSpec.from_urdf(written(tmp_path, whole_robot(places)))
    assert robot.mounts is None
    assert robot.limbs == count
    assert robot.mount_radius == pytest.approx(0.2, abs=1e-8)


def test_a_torso_whose_arms_reach_forward_is_told_which_way_is_up(tmp_path):
    places = [place([0.1, side, 0.5], [0.3, side, 0.2]) for side in (-0.2, 0.2)]
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
    for up, words in (((0, 0, 0), r"up is .* must be a direction"), ((1, 0), "up")):
        with pytest.raises(RobotError, match=words):
            RobotSpec.from_urdf(path, up=up)
    with pytest.raises(RobotError, match="up is for a whole robot"):
        RobotSpec.from_urdf(written(tmp_path, one_arm()), up=(0, 0, 1))


def test_first_joints_that_turn_without_end_are_turned_with_their_bases(tmp_path):
    places = []
    for angle in (0.0, np.pi):
        turn = Rotation.from_euler("ZYZ", [angle, 0.5 * np.pi, 0.7])
        places.append(np.eye(4))
        places[-1][:3, :3], places[-1][:3, 3] = turn.as_matrix(), 0.2 * turn.as_matrix()[:, 2]
    text = whole_robot(places).replace('joint1" type="revolute"', 'joint1" type="continuous"')
    robot = RobotSpec.from_urdf(written(tmp_path, text))
    assert robot.mounts is None
    low, high = robot.limb.joint_limits[0]
    assert high - low > 30.0 * np.pi


def test_saved_robots_are_read_again_and_meet_the_published_schema(tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    from mlivr_gym.envs_assets import asset_path
    from mlivr_gym.robot.json_schema import robot_schema

    schema = json.loads(asset_path("robot.schema.json").read_text())
    assert schema == json.loads(json.dumps(robot_schema()))
    path = tmp_path / "saved.json"
    for robot in (robot_spec("mlivr3"), robot_spec(written(tmp_path, one_arm()))):
        robot.save(path)
        jsonschema.validate(json.loads(path.read_text()), schema)
        assert robot_spec(str(path)) == robot
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"limbz": 2}, schema)


def five(text):
    cut = text.index('<joint name="joint6"')
    end = text.index("</robot>")
    return text[:cut] + text[end:]


def one_joint(text):
    return text[: text.index('<joint name="joint2"')] + "</robot>"


def loop(text):
    return text.replace("</robot>", """<joint name="again" type="fixed"><parent link="base_link"/>
    <child link="link4"/></joint></robot>""")  # fmt: skip


def crooked(text):
    """With a flange off the last axis."""
    return re.sub(r'(name="fixed".*?xyz=")[^"]*', r"\g<1>0.1 0.1 0.1", text, flags=re.DOTALL)


def replaced(old, new):
    return lambda text: text.replace(old, new)


def in_millimetres(text):
    return one_arm(lengths=tuple(1000.0 * length for length in UR10E))


@pytest.mark.parametrize(
    ("change", "options", "words"),
    [
        (replaced('type="revolute"', 'type="fixed"'), {}, "the file has no limb"),
        (five, {}, r"'joint1' to 'joint5' has 5 joints; a limb has six, or seven of which one"),
        (one_joint, {}, r"'joint1' to 'joint1' has 1 joint; a limb has six"),
        (crooked, {}, r"the flange lies .* off the axis of joint 'joint6'"),
        (loop, {}, "link 'link4' is the child of 2 joints; .* tree"),
        (
            replaced('name="joint4" type="revolute"', 'name="joint4" type="floating"'),
            {}, "joint 'joint4' is floating; only the whole robot may float",
        ),
        (
            replaced('name="joint4" type="revolute"', 'name="joint4" type="prismatic"'),
            {}, "joint 'joint4' is prismatic; .* must be revolute",
        ),
        (
            replaced('<axis xyz="0.0 0.0 1.0"/><limit lower="-3.1"',
                     '<axis xyz="0 0 1"/><mimic joint="joint2"/><limit lower="-3.1"'),
            {}, "joint 'joint3' mimics joint 'joint2'",
        ),
        (
            replaced('<mass value="3.0"/>', '<mass value="-3"/>'),
            {}, "arm.urdf': link 'link3' has a mass of -3 kg; give it an",
        ),
        (
            replaced('lower="-3.1" upper="3.0"', 'lower="3.1" upper="-3.0"'),
            {}, "joint 'joint3' has the limits 3.1 and -3 rad; the lower one comes first",
        ),
        (
            replaced('lower="-3.1" upper="3.0"', 'lower="-178" upper="172"'),
            {}, "joint 'joint3' has limits from -178 to 172 rad; .* at most 100: are these deg",
        ),
        (replaced("</robot>", '<link name="loose"/></robot>'), {},
         "links 'base_link' and 'loose' hang on no joint; the links must form one tree"),
        (replaced('lower="-3.1" upper="3.0"', ""), {}, "joint 'joint3' has no limits; give it"),
        (in_millimetres, {}, "m long; it must be at most 100 m: .* in millimetres"),
        (replaced("", ""), {"tool_frame": "hand"}, "no link or site 'hand'; it has links base"),
        (replaced("", ""), {"wheels": 2}, "unknown field 'wheels'"),
        (replaced('<sphere radius="0.03"/>', "<mesh filename='package://gone/a.stl'/>"), {},
         "mesh 'package://gone/a.stl' of link 'link1' is not found; .*package_dirs"),
        (replaced("<robot", "<model"), {}, "not XML"),
        (replaced("</robot>", f"{'<a>' * 2000}{'</a>' * 2000}</robot>"), {}, "nested too deeply"),
        (lambda _: "<sdf/>", {}, "outermost element is <sdf>; it must be <robot>"),
        (replaced("<link", '<xacro:arm prefix=""/><link'), {}, "elements of xacro; expand it"),
    ],
)  # fmt: skip
def test_what_is_not_supported_is_refused_in_one_line(tmp_path, change, options, words):
    path = written(tmp_path, change(one_arm()))
    with pytest.raises(RobotError, match=words) as caught:
        RobotSpec.from_urdf(path, **options)
    assert "\n" not in str(caught.value)
    assert "arm.urdf" in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<mass value="3.0"/>', '<mass value="nan"/>', "mass of 'link3' has value 'nan'; numbers"),
        ('lower="-3.1"', 'lower="-NaN"', "limit of 'joint3' has lower '-NaN'; numbers must be"),
        ('xyz="0.01 0.02 0.03" rpy', 'xyz="0 nan 0" rpy', "of 'base_link' has xyz '0 nan 0'"),
    ],
)
def test_what_is_no_number_is_refused_before_mujoco_writes_a_log(
    tmp_path, monkeypatch, old, new, words
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RobotError, match=words) as caught:
        RobotSpec.from_urdf(written(tmp_path, one_arm().replace(old, new)))
    assert "\n" not in str(caught.value)
    assert [file.name for file in tmp_path.iterdir()] == ["arm.urdf"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"limbs": 1}, "limbs is 1; it must be a whole number from 2 to 8"),
        ({"tips": []}, "tips has 0 entries; it must have 1"),
        ({"tool_frame": 3}, "tool_frame is 3; it must be a text"),
        ({"body_size": "x"}, "body_size is 'x'; it must be a finite number"),
        ({"torque_limits": [1, 2, 3, 4, 5, -6]}, r"torque_limits\[5\] is -6.0; it must be from"),
        ({"rotor_inertia": [1]}, r"rotor_inertia has shape \(1,\), \[1\]"),
        ({"capsules": "ur3e"}, "capsules is 'ur3e'; valid choices are 'ur5e'"),
        ({"capsules": [1]}, r"capsules\[0\] is 1; it must be an object"),
        ({"package_dirs": [1]}, r"package_dirs\[0\] is 1; it must be the path of a file"),
    ],
)
def test_arguments_are_refused_by_name(tmp_path, options, words):
    path = written(tmp_path, one_arm())
    with pytest.raises(RobotError, match=f"^{words}"):
        RobotSpec.from_urdf(path, **options)


def test_a_file_is_named_once_and_may_be_a_path(tmp_path):
    path = written(tmp_path, one_arm())
    assert robot_spec(Path(path)) == robot_spec(str(path))
    for content in (b"", b"\xff"):
        Path(path).write_bytes(content)
        with pytest.raises(RobotError) as caught:
            robot_spec(path)
        assert str(caught.value).count("arm.urdf") == 1


def test_a_joint_of_an_mjcf_without_a_range_turns_without_end(tmp_path):
    text = robot_spec("mlivr2").to_mjcf()
    endless = re.sub(r'(name="limb0/joint6"[^>]*?) range="[^"]*"', r"\1", text)
    assert endless != text
    limbs = [robot_spec(written(tmp_path, t, "r.xml")).every_limb[0] for t in (text, endless)]
    spans = [np.diff(limb.joint_limits[5])[0] for limb in limbs]
    assert spans[0] == pytest.approx(4 * np.pi)
    assert spans[1] > 100.0  # as a continuous joint of a URDF


def test_a_loop_of_an_mjcf_and_its_speeds(tmp_path):
    text = robot_spec("mlivr2").to_mjcf()
    weld = '<equality><weld body1="limb0/gripper" body2="limb1/gripper"/></equality>'
    path = written(tmp_path, text.replace("</mujoco>", f"{weld}</mujoco>"), "loop.xml")
    with pytest.raises(RobotError, match=r"equality .* closes a loop"):
        robot_spec(path)
    without = text.replace('name="speed_limits"', 'name="others"')
    path = written(tmp_path, without, "slow.xml")
    assert "lacks speed limit of joint limb0/joint1" in robot_spec(path).source
    assert RobotSpec.from_mjcf(path, speed_limits=1.5).speed_limits.max() == 1.5
