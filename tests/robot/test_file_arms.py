"""Arms of all forms from URDF: Pinocchio and MuJoCo tell where flanges are and how links move."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from branches import arm_of, solutions
from oracle import frames_of as numeric_frames
from robot_texts import (
    FRANKA,
    GEN3,
    IIWA14,
    INERTIAL,
    KR16,
    PUMA560,
    SHAPE,
    UR10E,
    frames_of,
    joint_of,
    one_arm,
    whole_robot,
    written,
)
from scipy.spatial.transform import Rotation

from mlivr_gym import RobotSpec
from mlivr_gym.robot.from_file import read_robot
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.simulation.scene import compile_spec, robot_alone

DEVIATION = 2e-4
"""Largest shift of an axis along each direction [m], and turn about it [rad]."""


def deviating(frames):
    """Frames of joints whose axes are a little beside and askew of those of given frames."""
    rng, out = np.random.default_rng(1), [frame.copy() for frame in frames]
    for frame in out[:-1]:
        shift, turn = rng.uniform(-DEVIATION, DEVIATION, (2, 3))
        frame[:3, 3] += shift
        frame[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ frame[:3, :3]
    return out


ARMS = {
    "ur10e": frames_of(UR10E), "iiwa": IIWA14, "iiwa-first": IIWA14, "iiwa-second": IIWA14,
    "iiwa-fifth": IIWA14, "iiwa-sixth": IIWA14, "franka": FRANKA, "gen3": GEN3, "gen3-first": GEN3,
    "kr16": KR16, "puma": PUMA560, "xarm6": numeric_frames("xarm6"),
    "jaco2-6": numeric_frames("jaco2"), "ur10e-off": deviating(frames_of(UR10E)),
    "kr16-off": deviating(KR16), "iiwa-off": deviating(IIWA14),
    "kr16-offset": [frame + 0.05 * np.eye(4)[2:3].T @ np.eye(4)[3:] * (k > 4)
                    for k, frame in enumerate(KR16)],
}  # fmt: skip
HELD = {
    "iiwa": 3, "iiwa-first": 1, "iiwa-second": 2, "iiwa-fifth": 5, "iiwa-sixth": 6, "franka": 6,
    "gen3": 3, "gen3-first": 1, "iiwa-off": 3,
}  # fmt: skip
"""The joint that is locked by the names of the arms of seven joints."""
NUMERIC = ("xarm6", "jaco2-6", "kr16-offset")


def held_of(name, angle=0.7):
    return {"locked_joint": f"joint{HELD[name]}", "locked_angle": angle} if name in HELD else {}


def turned(angles, other):
    """Largest angle between joints of many postures and those of one [rad]."""
    return np.abs(np.angle(np.exp(1j * (angles - other)))).max(axis=-1)


@pytest.mark.parametrize("seed", [None, 1])
@pytest.mark.parametrize("name", ARMS)
def test_flanges_are_where_pinocchio_has_them_and_solutions_lead_there(tmp_path, name, seed):
    """Whatever the frames, signs and zero angles of the file are, and the angle that is held."""
    text = one_arm(frames=ARMS[name], seed=seed)
    file, rng = read_robot(written(tmp_path, text), **held_of(name)), np.random.default_rng(1)
    limb, model = file.fields["limb"], pin.buildModelFromXML(text)
    data, tool, apart = model.createData(), model.getFrameId("tool0"), []
    assert bool(arm_of(limb)["form"]["deviates"]) == name.endswith("-off")
    assert ("solved numerically" in file.fields["source"]) == (name in NUMERIC)
    for q in rng.uniform(-2.0, 2.0, (15, 6)):
        every = np.insert(q, HELD[name] - 1, 0.7) if name in HELD else q
        jacobian = pin.computeFrameJacobian(model, data, every, tool)
        pin.framesForwardKinematics(model, data, every)
        pose = link_frames(limb, q)[6]
        apart.append(np.linalg.inv(file.file_limbs[0].mount @ limb.base_in_mount @ pose)
                     @ data.oMf[tool].homogeneous)  # fmt: skip
        moving = np.delete(jacobian, HELD[name] - 1, axis=1) if name in HELD else jacobian
        if name in NUMERIC or np.linalg.svd(moving, compute_uv=False)[-1] < 0.05:
            continue
        mask, branches = solutions(arm_of(limb), pose[:3, 3], pose[:3, :3])
        found = branches[[bool(mask >> k & 1) for k in range(8)]]
        reached = link_frames(limb, found)[:, 6]
        np.testing.assert_allclose(reached, np.broadcast_to(pose, reached.shape), atol=1e-9)
        assert turned(found, q).min() < 1e-8
    # The tool lies at the flange: beyond it by the gripper, perhaps askew by the deviations.
    np.testing.assert_allclose(apart, np.broadcast_to(apart[0], (15, 4, 4)), atol=1e-9)
    np.testing.assert_allclose(apart[0][:3, 3], 0.0, atol=10.0 * DEVIATION)


@pytest.mark.parametrize("name", [name for name in ARMS if not name.endswith("-off")])
def test_links_move_as_mujoco_has_those_of_the_file(tmp_path, name):
    """The inertia of a limb on a fixed base; a locked joint is at its angle in the file."""
    path = written(tmp_path, one_arm(frames=ARMS[name], seed=5))
    options = held_of(name) | {"rotor_inertia": 0.0, "gripper_mass": 0.0, "mount_radius": 0.2}
    robot = RobotSpec.from_urdf(path, **options)
    theirs, ours = mujoco.MjSpec.from_file(path).compile(), compile_spec(robot_alone(robot))
    names = [joint.removeprefix("limb0/") for joint in robot.joint_names[0]]
    moving, rng = [theirs.joint(joint).dofadr[0] for joint in names], np.random.default_rng(2)
    for _ in range(5):
        angles = rng.uniform(-3.0, 3.0, 6)
        there, here = mujoco.MjData(theirs), mujoco.MjData(ours)
        if name in HELD:
            there.joint(options["locked_joint"]).qpos = options["locked_angle"]
        there.qpos[moving] = angles
        here.qpos[:7] = 0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0
        here.qpos[7:13] = angles
        full = []
        for model, data in ((theirs, there), (ours, here)):
            mujoco.mj_forward(model, data)
            full.append(np.zeros((model.nv, model.nv)))
            mujoco.mj_fullM(model, data, full[-1])
        expected = full[0][np.ix_(moving, moving)]
        np.testing.assert_allclose(full[1][6:12, 6:12], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("arms", "held", "angles"),
    [
        ([UR10E, IIWA14], [None, "arm1_joint3"], [None, 0.8]),
        ([FRANKA, UR10E], ["arm0_joint6", None], [-1.3, None]),
        ([IIWA14, IIWA14], ["arm0_joint1", "arm1_joint5"], [0.3, 0.9]),
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
    theirs, robot = (
        spec.compile(),
        RobotSpec.from_urdf(path, locked_joint=held, locked_angle=angles),
    )
    ours, moving = compile_spec(robot_alone(robot)), np.random.default_rng(4).uniform(-2, 2, (2, 6))
    there, here = mujoco.MjData(theirs), mujoco.MjData(ours)
    names, every = np.ravel(robot.joint_names).tolist(), moving.ravel().tolist()
    for name, angle in zip([*held, *names], [*angles, *every], strict=True):
        if name is not None:
            there.joint(name).qpos = angle
    here.qpos[:7], here.qpos[7:] = [0, 0, 0, 1, 0, 0, 0], moving.ravel()
    mujoco.mj_kinematics(theirs, there)
    mujoco.mj_kinematics(ours, here)
    for k in range(2):
        flanges = here.site(f"limb{k}/flange").xpos, there.body(f"arm{k}_tool0").xpos
        np.testing.assert_allclose(*flanges, atol=1e-8)


def test_flanges_are_moved_along_their_axes_so_that_all_tools_are_equal(tmp_path):
    """A gripper of 0.02 m at one arm, none at the other, which is given one of 0.05 m."""
    places, grasp = [np.eye(4), np.eye(4)], np.eye(4)
    places[0][0, 3], places[1][0, 3], grasp[2, 3] = -0.5, 0.5, 0.02
    hand = joint_of("palm", "fixed", "arm0_tool0", "arm0_palm", np.eye(4), "")
    hand += joint_of("grasp", "fixed", "arm0_palm", "arm0_grasp", grasp, "")
    hand += f'<link name="arm0_palm">{INERTIAL.format(mass=0.3)}{SHAPE}</link>'
    hand += '<link name="arm0_grasp"/></robot>'
    text = whole_robot(places).replace("</robot>", hand)
    file, model = read_robot(written(tmp_path, text)), pin.buildModelFromXML(text)
    assert file.fields["tool_length"] == 0.02
    data, theirs = model.createData(), np.random.default_rng(0).uniform(0.4, 1.4, (2, 6))
    pin.framesForwardKinematics(model, data, theirs.ravel())
    for k, (limb, q) in enumerate(zip(file.file_limbs, theirs, strict=True)):
        flange = link_frames(limb.limb, q)[6]
        tool = data.oMf[model.getFrameId(f"arm{k}_tool0")].homogeneous
        reached = (limb.mount @ flange)[:3] @ [0.0, 0.0, 0.02, 1.0]
        np.testing.assert_allclose(reached, tool[:3] @ [0.0, 0.0, (0.02, 0.05)[k], 1.0], atol=1e-8)
