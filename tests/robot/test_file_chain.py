"""Arms whose axes nearly have a closed form, as calibrated ones do, against Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest
from branches import arm_of, solutions
from robot_texts import (
    IIWA14,
    INERTIAL,
    KR16,
    SHAPE,
    UR10E,
    frames_of,
    joint_of,
    one_arm,
    whole_robot,
    written,
)
from scipy.spatial.transform import Rotation

from mlivr_gym.robot.from_file import read_robot
from mlivr_gym.robot.limb import link_frames

ARMS = {"ur10e": (frames_of(UR10E), {}), "kr16": (KR16, {}),
        "iiwa": (IIWA14, {"held_joint": "joint3", "held_angle": 0.8})}  # fmt: skip
DEVIATION = 2e-4
"""Largest shift of an axis along each direction [m], and turn about it [rad]."""


def deviating(frames, seed):
    """Frames of joints whose axes are a little beside and askew of those of given frames."""
    rng, out = np.random.default_rng(seed), [frame.copy() for frame in frames]
    for frame in out[:-1]:
        shift, turn = rng.uniform(-DEVIATION, DEVIATION, (2, 3))
        frame[:3, 3] += shift
        frame[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ frame[:3, :3]
    return out


class Truth:
    """Pinocchio's model of a file with one arm, whose held joint stays where it is."""

    def __init__(self, text, held_joint=None, held_angle=0.0):
        self.model = pin.buildModelFromXML(text)
        if held_joint is not None:
            at = self.model.getJointId(held_joint)
            angles = np.zeros(self.model.nq)
            angles[at - 1] = held_angle
            self.model = pin.buildReducedModel(self.model, [at], angles)
        self.data, self.tool = self.model.createData(), self.model.getFrameId("tool0")

    def flange(self, angles):
        pin.framesForwardKinematics(self.model, self.data, np.asarray(angles))
        return self.data.oMf[self.tool].homogeneous.copy()

    def least_gain(self, angles):
        """Smallest singular value of the Jacobian."""
        jacobian = pin.computeFrameJacobian(self.model, self.data, np.array(angles), self.tool)
        return np.linalg.svd(jacobian, compute_uv=False)[-1]

    def found_from(self, target, angles):
        """Damped least squares from given angles; None where it does not converge."""
        target, q = pin.SE3(target), np.array(angles)
        for _ in range(60):
            pin.framesForwardKinematics(self.model, self.data, q)
            error = pin.log6(self.data.oMf[self.tool].inverse() * target).vector
            size = np.linalg.norm(error)
            if size < 1e-11:
                return q
            frame = pin.ReferenceFrame.LOCAL
            jacobian = pin.computeFrameJacobian(self.model, self.data, q, self.tool, frame)
            damped = jacobian @ jacobian.T + min(1e-2 * size, 1e-3) * np.eye(6)
            q += np.clip(jacobian.T @ np.linalg.solve(damped, error), -0.5, 0.5)
        return None


def read(tmp_path, name, seed):
    frames, held = ARMS[name]
    text = one_arm(frames=deviating(frames, seed), seed=seed)
    return read_robot(written(tmp_path, text), **held), Truth(text, **held)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ARMS)
def test_flanges_are_where_the_file_has_them(tmp_path, name, seed):
    """Though the joints are beside those of the form; so are the solutions of the kernels."""
    file, truth = read(tmp_path, name, seed)
    limb, mount = file.fields["limb"], file.file_limbs[0].mount
    assert bool(arm_of(limb)["form"]["deviates"])
    rng, apart = np.random.default_rng(seed), []
    for q in rng.uniform(-2.0, 2.0, (30, 6)):
        if truth.least_gain(q) < 0.05:
            continue  # singular
        pose, tool = link_frames(limb, q)[6], truth.flange(q)
        apart.append(np.linalg.inv(mount @ pose) @ tool)
        mask, branches = solutions(arm_of(limb), pose[:3, 3], pose[:3, :3])
        found = [link_frames(limb, b)[6] for k, b in enumerate(branches) if mask >> k & 1]
        np.testing.assert_allclose(found, np.broadcast_to(pose, (len(found), 4, 4)), atol=1e-9)
        turns = np.angle(np.exp(1j * (branches[[bool(mask >> k & 1) for k in range(8)]] - q)))
        assert np.abs(turns).max(axis=1).min() < 1e-8
    # The tool lies at the flange, its axes turned by the deviations at most.
    np.testing.assert_allclose(apart, np.broadcast_to(apart[0], (len(apart), 4, 4)), atol=1e-10)
    np.testing.assert_allclose(apart[0], np.eye(4), atol=10.0 * DEVIATION)
    assert len(apart) > 15


@pytest.mark.parametrize("name", ARMS)
def test_there_are_as_many_solutions_as_branches_of_the_closed_form(tmp_path, name):
    """Those found from random angles are those next to the closed form's, one for each branch."""
    file, truth = read(tmp_path, name, 1)
    limb, rng = file.fields["limb"], np.random.default_rng(4)
    q = {"ur10e": [0.3, -1.1, 1.4, 0.2, 0.9, -2.0]}.get(name, [0.3, 0.5, 1.2, 0.4, 0.9, -1.0])
    pose = link_frames(limb, np.array(q))[6]
    mask, branches = solutions(arm_of(limb), pose[:3, 3], pose[:3, :3])
    ours = [b for k, b in enumerate(branches) if mask >> k & 1]
    target = truth.flange(ours[0])
    for angles in ours:
        np.testing.assert_allclose(truth.flange(angles), target, atol=1e-9)
    found = [False] * len(ours)
    for _ in range(150):
        theirs = truth.found_from(target, rng.uniform(-np.pi, np.pi, 6))
        if theirs is not None:
            apart = [np.abs(np.angle(np.exp(1j * (theirs - one)))).max() for one in ours]
            assert min(apart) < 1e-7
            found[int(np.argmin(apart))] = True
    assert all(found)


def test_flanges_are_moved_along_their_axes_so_that_all_tools_are_equal(tmp_path):
    """A gripper of 0.02 m at one arm, none at the other, which is given one of 0.05 m."""
    places, palm, grasp = [np.eye(4), np.eye(4)], np.eye(4), np.eye(4)
    places[0][0, 3], places[1][0, 3], grasp[2, 3] = -0.5, 0.5, 0.02
    hand = joint_of("palm", "fixed", "arm0_tool0", "arm0_palm", palm, "")
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
