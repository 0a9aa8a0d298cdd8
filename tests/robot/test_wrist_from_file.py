"""Arms of all families from URDF and MJCF: Pinocchio tells where flanges are."""

import mujoco
import numpy as np
import pytest
from numeric_arms import frames_of as numeric_frames
from robot_texts import (
    FRANKA,
    GEN3,
    IIWA14,
    KR16,
    PUMA560,
    UR10E,
    frames_along,
    frames_of,
    one_arm,
    whole_robot,
    written,
)
from scipy.spatial.transform import Rotation

from mlivr_gym import RobotSpec
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.from_file import read_robot
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.simulation.scene import compile_spec, robot_alone

ARMS = {
    "ur10e": frames_of(UR10E),
    "iiwa": IIWA14, "iiwa-first": IIWA14, "iiwa-second": IIWA14, "iiwa-fifth": IIWA14,
    "iiwa-sixth": IIWA14, "franka": FRANKA, "gen3": GEN3, "gen3-first": GEN3, "kr16": KR16,
    "puma": PUMA560, "xarm6": numeric_frames("xarm6"), "jaco2-6": numeric_frames("jaco2"),
}  # fmt: skip
HELD = {
    "iiwa": "joint3", "iiwa-first": "joint1", "iiwa-second": "joint2", "iiwa-fifth": "joint5",
    "iiwa-sixth": "joint6", "franka": "joint6", "gen3": "joint3", "gen3-first": "joint1",
}  # fmt: skip
"""The joint that is held by the names of the arms of seven joints."""
CLEAR = 0.2
"""Mount radius at which the arms stand clear of the body [m]."""


def held_of(name, rng):
    held = {"held_joint": HELD.get(name), "held_angle": rng.uniform(-1.4, 1.4)}
    return held if name in HELD else {}


@pytest.mark.parametrize("seed", [None, 0, 1])
@pytest.mark.parametrize("name", ARMS)
def test_flanges_are_where_pinocchio_has_them(tmp_path, name, seed):
    """Whatever the frames, signs and zero angles of the file are, and the angle that is held."""
    pinocchio = pytest.importorskip("pinocchio")
    text = one_arm(frames=ARMS[name], seed=seed)
    rng = np.random.default_rng(1)
    held = held_of(name, rng)
    file = read_robot(written(tmp_path, text), **held)
    limb = file.fields["limb"]
    model = pinocchio.buildModelFromXML(text)
    data, tool, seen = model.createData(), model.getFrameId("tool0"), []
    for _ in range(20):
        angles = rng.uniform(-3.0, 3.0, 6)
        every = angles
        if held:
            every = np.insert(angles, int(held["held_joint"][-1]) - 1, held["held_angle"])
        pinocchio.framesForwardKinematics(model, data, every)
        flange = link_frames(limb, angles)[-1]
        seen.append(data.oMf[tool].homogeneous @ np.linalg.inv(flange))
    # All postures agree on where the limb's base is, which lies on joint 1.
    np.testing.assert_allclose(seen, np.broadcast_to(seen[0], (20, 4, 4)), atol=1e-9)


def test_limits_and_the_held_joint_are_those_of_the_file(tmp_path):
    file = read_robot(written(tmp_path, one_arm(frames=IIWA14)), held_angle=0.8)
    limb = file.fields["limb"]
    assert limb.held_angle == 0.8
    assert file.file_limbs[0].joint_names == (
        "joint1",
        "joint2",
        "joint4",
        "joint5",
        "joint6",
        "joint7",
    )
    assert limb.joint_limits[2] == pytest.approx((-3.1, 3.0))
    assert limb.joint_limits[3] == pytest.approx((-6.0, 6.1))
    assert "joint joint3 held at 0.8 rad" in file.fields["source"]


@pytest.mark.parametrize("name", ARMS)
def test_links_move_as_mujoco_has_those_of_the_file(tmp_path, name):
    """The inertia of a limb on a fixed base; a held joint is at its angle in the file."""
    path = written(tmp_path, one_arm(frames=ARMS[name], seed=5))
    options = held_of(name, np.random.default_rng(1)) | {"rotor_inertia": 0.0}
    file = read_robot(path, **options)
    robot = RobotSpec.from_urdf(path, gripper_mass=0.0, mount_radius=CLEAR, **options)
    theirs, ours = mujoco.MjSpec.from_file(path).compile(), compile_spec(robot_alone(robot))
    rng = np.random.default_rng(2)
    moving = [theirs.joint(joint).dofadr[0] for joint in file.file_limbs[0].joint_names]
    for _ in range(5):
        angles = rng.uniform(-3.0, 3.0, 6)
        there, here = mujoco.MjData(theirs), mujoco.MjData(ours)
        if name in HELD:
            there.joint(HELD[name]).qpos = options["held_angle"]
        there.qpos[moving] = angles
        here.qpos[:7] = 0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0
        here.qpos[7:13] = angles
        full = []
        for model, data in ((theirs, there), (ours, here)):
            mujoco.mj_forward(model, data)
            dense = np.zeros((model.nv, model.nv))
            mujoco.mj_fullM(model, data, dense)
            full.append(dense)
        expected = full[0][np.ix_(moving, moving)]
        np.testing.assert_allclose(full[1][6:12, 6:12], expected, atol=1e-6)


def test_the_joint_that_is_held_is_named_as_in_the_file(tmp_path):
    path = written(tmp_path, one_arm(frames=IIWA14))
    assert read_robot(path, held_joint="joint3").fields["limb"].held_joint == 3
    for options, words in (
        ({"held_joint": "joint9"}, "held_joint is 'joint9'; the limb's joints are joint1, joint2"),
        ({"held_angle": 4.0}, "held_angle is 4 rad; joint 'joint3' turns from -3.1 to 3 rad"),
        ({"held_joint": 1}, "held_joint is 1"),
        ({"held_angle": "wide"}, "held_angle is 'wide'"),
        ({"held_angle": [float("nan")]}, "held_angle"),
        ({"held_joint": ["joint3", "joint3"]}, "held_joint has 2 entries; the file has 1 limbs"),
        (
            {"held_joint": "joint4"},
            "joint 'joint4' cannot be held at 0 rad, .* singular in every posture",
        ),
    ):
        with pytest.raises(RobotError, match=words) as caught:
            read_robot(path, **options)
        assert "\n" not in str(caught.value)
    six = written(tmp_path, one_arm(frames=KR16), "six.urdf")
    for field, value in (("held_joint", "joint3"), ("held_angle", 0.8), ("held_angle", [0.0])):
        with pytest.raises(RobotError, match=rf"{field} is .*holds none of them, as only"):
            read_robot(six, **{field: value})


@pytest.mark.parametrize(
    ("arms", "held", "angles"),
    [
        ([UR10E, IIWA14], [None, "arm1_joint3"], [None, 0.8]),
        ([FRANKA, UR10E], ["arm0_joint6", None], [-1.3, None]),
        ([IIWA14, IIWA14], ["arm0_joint1", "arm1_joint1"], [0.3, 0.9]),
        ([IIWA14, IIWA14], ["arm0_joint3", "arm1_joint5"], [0.3, 0.9]),
        ([UR10E, tuple(0.7 * length for length in UR10E)], [None, None], [None, None]),
    ],
)
def test_each_arm_of_a_robot_holds_its_own_joint_or_none(tmp_path, arms, held, angles):
    """The flange of each is where MuJoCo has that of the file; one of the mounts is tilted."""
    places = np.tile(np.eye(4), (2, 1, 1))
    places[:, :3, :3] = Rotation.from_euler("ZY", [[0.0, 90.0], [200.0, 80.0]], True).as_matrix()
    places[:, :3, 3] = [[0.3, 0.0, 0.0], [-0.3, 0.02, 0.01]]
    path = written(tmp_path, whole_robot(places, arms))
    spec = mujoco.MjSpec.from_file(path)
    spec.compiler.fusestatic = False
    theirs, options = spec.compile(), {"held_joint": held, "held_angle": angles}
    robot = RobotSpec.from_urdf(path, **options)
    ours, moving = compile_spec(robot_alone(robot)), np.random.default_rng(4).uniform(-2, 2, (2, 6))
    there, here = mujoco.MjData(theirs), mujoco.MjData(ours)
    for name, angle in zip(held, angles, strict=True):
        if name is not None:
            there.joint(name).qpos = angle
    for name, angle in zip(np.ravel(robot.joint_names), moving.ravel(), strict=True):
        there.joint(name).qpos = angle
    here.qpos[:7], here.qpos[7:] = [0, 0, 0, 1, 0, 0, 0], moving.ravel()
    mujoco.mj_kinematics(theirs, there)
    mujoco.mj_kinematics(ours, here)
    for k in range(2):
        flanges = here.site(f"limb{k}/flange").xpos, there.body(f"arm{k}_tool0").xpos
        np.testing.assert_allclose(*flanges, atol=1e-8)


def test_an_angle_of_an_arm_that_holds_no_joint_is_refused(tmp_path):
    path = written(tmp_path, whole_robot(np.tile(np.eye(4), (2, 1, 1)), [UR10E, IIWA14]))
    with pytest.raises(RobotError, match=r"held_angle is 0.8; the limb of joints arm0_joint1"):
        read_robot(path, held_angle=0.8)


@pytest.mark.parametrize(
    ("frames", "held", "words"),
    [
        (IIWA14, "joint7", "joint 'joint7' cannot be held at 0.5 rad, .* singular|parallel"),
        (IIWA14, "joint4", "joint 'joint4' cannot be held at 0.5 rad, .* singular in every"),
        ([*KR16[:2], KR16[1], *KR16[3:]], None, "singular in every posture"),
        ([*KR16[:6], KR16[6] @ frames_along([((0.02, 0, 0), "x", 0)])[0]], None,
         "the flange lies 0.02 m off the axis of joint 'joint6'"),
    ],
)  # fmt: skip
def test_joints_that_make_no_limb_are_refused_in_one_line(tmp_path, frames, held, words):
    options = {"held_joint": held, "held_angle": 0.5} if held else {}
    with pytest.raises(RobotError, match=words) as caught:
        read_robot(written(tmp_path, one_arm(frames=frames)), **options)
    assert "\n" not in str(caught.value)


def test_a_joint_that_is_held_without_an_angle_is_told_in_the_terms_of_the_file(tmp_path):
    path = written(tmp_path, one_arm(frames=FRANKA))
    words = "joint 'joint6' cannot be held at 0 rad, give another held_angle"
    with pytest.raises(RobotError, match=words):
        read_robot(path, held_joint="joint6")
    text = one_arm(frames=FRANKA).replace('lower="-3.1" upper="3.0"', 'lower="0.2" upper="3.0"')
    words = "held_angle is missing; joint 'joint3' turns from 0.2 to 3 rad and cannot be at 0"
    with pytest.raises(RobotError, match=words):
        read_robot(written(tmp_path, text))
