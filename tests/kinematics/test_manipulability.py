import numpy as np
import pytest
from branches import arm_of, flange_axis, solutions
from compiled import called
from oracle import flange, pinocchio_arm

from mlivr_gym import Limb, robot_spec
from mlivr_gym.collisions import limb_shapes
from mlivr_gym.kinematics.manipulability import (
    Inversion,
    base_manipulability,
    inverse_root_determinant,
    limb_information,
    limb_manipulability,
    scaling,
)
from mlivr_gym.kinematics.poses import pose as pose_row

LIMB = Limb()


ARM, ARM_ROW = pinocchio_arm(LIMB), arm_of(LIMB)


def information(robot, i, pose, branch, l_c):
    """`K^-1` of a limb of a robot."""
    limb, out = limb_shapes.LimbModel.row(), np.full((6, 6), np.nan)
    limb["mount"] = pose_row(robot.mount_positions[i], robot.mount_rotations[i])
    limb["arm"] = ARM_ROW
    assert called(limb_information)(limb, flange_axis(pose), branch, l_c, Inversion.row(), out)
    return out


def root_determinant(matrix):
    """What `inverse_root_determinant` finds, which is given the matrix and scratch."""
    return called(inverse_root_determinant)(np.stack([matrix, np.full((6, 6), np.nan)]))


def random_limb(rng):
    """A configuration away from singularities, its flange pose and its branch."""
    while True:
        q = rng.uniform(-np.pi, np.pi, 6)
        pose, jacobian = flange(ARM, q)
        if abs(np.linalg.det(jacobian)) > 1e-2:
            break
    mask, out = solutions(ARM_ROW, pose[:3, 3], pose[:3, :3])
    branch = min(
        (b for b in range(8) if mask >> b & 1), key=lambda b: np.abs(np.sin((out[b] - q) / 2)).max()
    )
    return q, pose, jacobian, branch


@pytest.mark.parametrize("limbs", [1, 2, 3, 4])
def test_fast_base_manipulability_agrees_with_the_null_space_definition(limbs):
    """Of one limb alone it is the manipulability of that limb."""
    robot, rng = robot_spec(f"mlivr{max(limbs, 2)}"), np.random.default_rng(limbs)
    l_c = robot.characteristic_length
    for _ in range(30):
        total, jacobians, grasps = np.zeros((6, 6)), [], []
        for i in range(limbs):
            _, pose, jacobian, branch = random_limb(rng)
            mount, origin = robot.mount_rotations[i], robot.mount_positions[i]
            total += information(robot, i, pose, branch, l_c)
            tip = pose[:3, 3] + robot.tool_length * pose[:3, 2]
            jacobian = jacobian.copy()
            jacobian[:3] += np.cross(jacobian[3:].T, tip - pose[:3, 3]).T
            jacobians.append(np.kron(np.eye(2), mount) @ jacobian)
            grasps.append(mount @ tip + origin)
        truth = base_manipulability(np.array(jacobians), np.array(grasps), l_c)
        assert root_determinant(total) == pytest.approx(truth, rel=1e-8)
        if limbs == 1:
            assert truth == pytest.approx(limb_manipulability(jacobian, l_c), rel=1e-8)


def test_limb_manipulability_is_the_volume_of_the_normalised_jacobian():
    _, jacobian = flange(ARM, np.array([0.1, -1.2, 1.5, 0.4, 1.2, 0.0]))
    normalised = scaling(0.87) @ jacobian
    assert limb_manipulability(jacobian, 0.87) == pytest.approx(
        np.prod(np.linalg.svd(normalised)[1])
    )
