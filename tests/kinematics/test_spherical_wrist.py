"""What is particular to arms with a spherical wrist: the makers' angles, labels and robot files."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from arms import jacobian, turned
from branches import arm_of
from branches import solutions as solutions_of
from wrist_arms import IIWA, LIMBS

from mlivr_gym import RobotSpec
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.limb import link_frames

each_limb = pytest.mark.parametrize("name", LIMBS)


def solutions(name, pose):
    return solutions_of(arm_of(LIMBS[name]), pose[:3, 3], pose[:3, :3])


def test_joint_angles_are_the_maker_s_but_for_two_signs():
    """The axes of the iiwa are z, y, z, -y, z, y, z; A2 and A6 turn in the other sense here."""
    heights, axes = (0.0, 0.36, 0.36, 0.78, 1.18, 1.18, 1.18), ["z", "y", "z", "-y", "z", "y", "z"]
    q, pose = np.array([0.3, -0.9, 1.2, 0.4, 0.8, -1.1]), pin.SE3.Identity()
    maker = np.array([q[0], -q[1], 0.7, q[2], q[3], -q[4], q[5]])
    last = 0.0
    for angle, height, axis in zip(maker, heights, axes, strict=True):
        about = pin.utils.rotate(axis[-1], -angle if axis[0] == "-" else angle)
        pose = pose * pin.SE3(about, np.array([0.0, 0.0, height - last]))
        last = height
    pose = pose * pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.126]))
    found = link_frames(replace(IIWA, locked_angle=0.7), q)[6]
    np.testing.assert_allclose(found, pose.homogeneous, atol=1e-12)


@each_limb
def test_labels_change_only_where_the_determinant_is_zero(name):
    """Along lines in joint space; the branch is that of the solution with the line's angles."""
    limb, rng = LIMBS[name], np.random.default_rng(3)
    for _ in range(4):
        ends = rng.uniform(-np.pi, np.pi, (2, 6))
        last, changes = None, 0
        for q in np.linspace(*ends, 300):
            pose = link_frames(limb, q)[6]
            mask, out = solutions(name, pose)
            off = [turned(out[b], q) if mask >> b & 1 else np.inf for b in range(8)]
            here = int(np.argmin(off)), np.linalg.det(jacobian(limb, q))
            if last is not None and last[0] != here[0]:
                changes += 1
                assert last[1] * here[1] < 0.0 or min(abs(last[1]), abs(here[1])) < 2e-4
            last = here
        assert changes < 20


def test_a_robot_with_such_limbs_is_written_and_read():
    for limb in LIMBS.values():
        robot = RobotSpec(limb=limb)
        assert RobotSpec.from_dict(robot.to_dict()) == robot
        assert robot.folds == limb.default_folds


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"locked_joint": 4}, "singular in every posture with joint 4 locked"),
        ({"locked_joint": 7}, "quaternions make the last two axes that move parallel"),
        ({"locked_angle": 3.0}, "limb.locked_angle is 3 rad; joint 3 turns from -2.9"),
        ({"origins": ((0.1, 0.0, 0.0), *IIWA.origins[1:])}, "put joint 1 beside the z axis"),
    ],
)
def test_bad_limbs_are_refused(changes, told):
    with pytest.raises(RobotError, match=told) as caught:
        replace(IIWA, **changes)
    assert "\n" not in str(caught.value)
