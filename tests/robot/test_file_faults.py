"""Faults of robot files: what is read in spite of them, what is refused, and how each is said."""

import re
import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest
from robot_texts import (
    FRANKA,
    KR16,
    UR10E,
    frames_along,
    hinge,
    joint_of,
    mjcf_by_mujoco,
    more,
    one_arm,
    straight_arm,
    told,
    tool_of,
    whole_robot,
    with_mesh,
    written,
)
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from mlivr_gym import RobotSpec, robot_spec
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.from_file import read_robot
from mlivr_gym.robot.limb import link_frames

SIX = tuple(f"joint{k}" for k in range(1, 7))
INERTIA = 'ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0.002" iyz="0.003"'


def opposite():
    """Frames of two arms on opposite faces of a body."""
    places = np.tile(np.eye(4), (2, 1, 1))
    places[:, :3, :3] = Rotation.from_euler("y", [[90.0], [-90.0]], degrees=True).as_matrix()
    places[:, 0, 3] = 0.3, -0.3
    return places


@pytest.mark.parametrize("parent", ["link6", "tool0"])
@pytest.mark.parametrize("fingers", [1, 2])
def test_fingers_are_no_joints_of_the_arm(tmp_path, fingers, parent):
    """With the tool frame at hand, whatever they are called."""
    names = [("left", "pad1"), ("right", "pad2")][:fingers]
    text = more(straight_arm(), *(hinge(*name[:1], parent, name[1]) for name in names))
    file = read_robot(written(tmp_path, tool_of(text)))
    assert file.file_limbs[0].joint_names == SIX
    assert file.fields["limb"].locked_joint is None
    data = mujoco.MjData(model := mujoco.MjModel.from_xml_string(text))
    mujoco.mj_kinematics(model, data)
    limb, mount = file.file_limbs[0].limb, file.file_limbs[0].mount
    flange = mount @ link_frames(limb, np.zeros(6))[6]
    tool = data.body("link6").xpos + data.body("link6").xmat.reshape(3, 3) @ [0, 0, 0.05]
    grasp = flange[:3, 3] + file.fields["tool_length"] * flange[:3, 2]
    np.testing.assert_allclose(grasp, tool, atol=1e-9)


def test_joints_that_limbs_share_and_a_head_belong_to_the_body(tmp_path):
    text = more(whole_robot(opposite()), hinge("pan", "body", "neck"), hinge("nod", "neck", "head"))
    assert robot_spec(written(tmp_path, text)).limbs == 2
    limits = '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="9" velocity="1"/>'
    waist = joint_of("waist", "revolute", "floor", "body", np.eye(4), limits)
    text = more(text, waist, '<link name="floor"/>')
    robot = RobotSpec.from_urdf(written(tmp_path, text), tips=("arm0_tool0", "arm1_tool0"))
    assert robot.limbs == 2
    assert robot.joint_names[0] == tuple(f"arm0_{name}" for name in SIX)


def stl(edges, as_text=False):
    """A box as an STL file, binary or of text."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = (corners * edges)[ConvexHull(corners).simplices]
    if as_text:
        lines = ["".join(f"vertex {told(corner)}\n" for corner in face) for face in faces]
        facets = "".join(
            f"facet normal 0 0 0\nouter loop\n{one}endloop\nendfacet\n" for one in lines
        )
        return f"solid box\n{facets}endsolid box\n".encode()
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *face.ravel(), 0) for face in faces)
    return bytes(80) + struct.pack("<I", len(faces)) + rows


def test_an_stl_of_text_is_read_and_what_is_no_mesh_is_said(tmp_path):
    path = written(tmp_path, with_mesh(one_arm(), "part.stl"))
    read = []
    for as_text in (False, True):
        (tmp_path / "part.stl").write_bytes(stl((0.1, 0.1, 0.3), as_text))
        read.append(read_robot(path).fields["capsules"])
    for one, other in zip(*read, strict=True):
        np.testing.assert_allclose(
            [*one.start, one.radius], [*other.start, other.radius], atol=1e-6
        )
    pointer = b"version https://git-lfs.github.com/spec/v1\n"
    for content, words in ((pointer, "'part.stl' is a pointer of .*pull"), (b"broken", "part.stl")):
        (tmp_path / "part.stl").write_bytes(content)
        with pytest.raises(RobotError, match=words):
            read_robot(path)
        assert read_robot(path, capsules="ur5e").fields["limb"] == read_robot(path, capsules=[
            {"link": "forearm", "start": [0, 0, 0], "end": [0, 0, 0.3], "radius": 0.05}
        ]).fields["limb"]  # fmt: skip


def test_rounded_inertias_are_repaired_within_one_per_cent_and_it_is_said(tmp_path):
    figures = 'ixx="0.0139" iyy="0.014" izz="{}" ixy="0" ixz="0" iyz="0"'
    text = one_arm().replace(INERTIA, figures.format(0.02791), 1)
    robot = robot_spec(written(tmp_path, text))
    assert re.search("inertia of base_link repaired: .* by 0.036 % at most", robot.source)
    dynamics = robot.dynamics_of(0)
    moments = np.linalg.eigvalsh(np.array(dynamics.base_inertia)[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]])
    np.testing.assert_allclose(moments, [0.0139, 0.014, 0.0279], rtol=1e-6)
    worse = one_arm().replace(INERTIA, figures.format(0.0290), 1)
    with pytest.raises(RobotError, match=r"link 'base_link' has the principal moments 0\.0139"):
        read_robot(written(tmp_path, worse))
    asked = '<mujoco><compiler balanceinertia="true"/></mujoco>'
    source = read_robot(written(tmp_path, more(worse, asked))).fields["source"]
    assert "exceeded the sum of the others by 3.9 %" in source


@pytest.mark.parametrize(
    ("change", "lacks"),
    [
        (lambda text: re.sub("<inertial>.*?</inertial>", "", text, flags=re.DOTALL),
         "mass or inertia of link link1, link2, link3, link4, link5, link6"),
        (lambda text: text.replace('effort="102"', 'effort="0"'), "torque limit of joint joint3"),
    ],
)  # fmt: skip
def test_what_only_a_simulation_needs_may_be_missing_and_is_named(tmp_path, change, lacks):
    path = written(tmp_path, change(one_arm()))
    robot = robot_spec(path)
    assert robot.dynamics is None
    with pytest.raises(RobotError, match=f"cannot be simulated.*lacks {lacks}"):
        robot.dynamics_of(0)
    assert RobotSpec.from_urdf(path, dynamics="ur10e").torque_limits.max() == 330.0


@pytest.mark.parametrize("encoding", ["iso-8859-1", "utf-16", "utf-8-sig"])
def test_a_file_is_read_by_its_own_declaration(tmp_path, encoding):
    said = encoding.removesuffix("-sig")
    text = f'<?xml version="1.0" encoding="{said}"?><!-- für Arme -->{one_arm()}'
    path = tmp_path / "arm.urdf"
    path.write_bytes(text.encode(encoding))
    assert robot_spec(path) == robot_spec(written(tmp_path, one_arm(), "plain.urdf"))


ARM = one_arm()
WELD = '<equality><weld body1="limb0/gripper" body2="limb1/gripper"/></equality></mujoco>'
MJCF = mjcf_by_mujoco(robot_spec("mlivr2")).replace("</mujoco>", WELD)
LOOP = '<joint name="again" type="fixed"><parent link="base_link"/><child link="link4"/></joint>'
THIRD = 'lower="-3.1" upper="3.0"'


def until(name, text=None):
    """An arm without a joint and what comes after it."""
    text = straight_arm() if text is None else text
    return text[: text.index(f'<joint name="{name}"')] + "</robot>"


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
