"""A limb's joint angles in the world, and manipulability, against forward kinematics."""

import numpy as np
import pytest
from branches import arm_of, branch_of, flange_axis, solutions
from compiled import called
from oracle import at_grasp, flange, pinocchio_arm
from scipy.spatial.transform import Rotation

from mlivr_gym import Limb, robot_spec
from mlivr_gym.collisions import limb_shapes
from mlivr_gym.collisions.base_path import base_path, base_poses
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.kinematics.limb import Angles, all_angles_at, joints_along
from mlivr_gym.kinematics.manipulability import (
    Inversion,
    base_manipulability,
    inverse_root_determinant,
    limb_information,
    limb_manipulability,
    scaling,
)
from mlivr_gym.kinematics.poses import pose, poses
from mlivr_gym.robot.limb import link_frames

LIMB = Limb()
ROBOT = LimbShapes(robot_spec("mlivr2"))


def flange_in_world(base, spec, i, q):
    """Position and rotation of the flange of limb `i`, of a base position and rotation."""
    place, axes = base
    frame = link_frames(spec.limb, q)[6]
    mount, origin = spec.mount_rotations[i], spec.mount_positions[i]
    return (
        place + axes @ (origin + mount @ frame[:3, 3]),
        axes @ mount @ frame[:3, :3],
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("i", [0, 1])
def test_angles_of_all_branches_reach_the_flange_where_there_are_some(seed, i):
    rng, spec = np.random.default_rng(seed), robot_spec("mlivr2")
    base = rng.uniform(-0.3, 0.3, 3), Rotation.random(None, rng).as_matrix()
    q = rng.uniform(-np.pi, np.pi, 6)
    place, axes = flange_in_world(base, spec, i, q)
    out = Angles.rows(8)
    all_angles_at(ROBOT.rows, i, pose(*base), pose(place, axes), out)
    frame = link_frames(LIMB, q)[6]
    mask, _ = solutions(arm_of(LIMB), frame[:3, 3], frame[:3, :3])
    off = []
    for branch in range(8):
        found = out[branch]["q"]
        assert np.isnan(found).all() != bool(mask >> branch & 1)
        if mask >> branch & 1:
            assert (found >= LIMB.windows[:, 0] - 1e-5).all()
            assert (found <= LIMB.windows[:, 1]).all()
            there, turned = flange_in_world(base, spec, i, found)
            np.testing.assert_allclose(there, place, atol=1e-7)
            np.testing.assert_allclose(turned, axes, atol=1e-7)
            off.append(np.abs(np.exp(1j * found) - np.exp(1j * q)).max())
    assert min(off) < 1e-6


@pytest.mark.parametrize("turns", [0, 1, -2])
@pytest.mark.parametrize("flip", [0, 1])
def test_angles_along_a_path_reach_the_flange_and_go_on_from_the_reference(turns, flip):
    """On the windings of the reference, the tool half a turn off where it is there."""
    spec, start = robot_spec("mlivr2"), np.array([0.3, -1.1, 1.4, 0.2, 0.9, -2.0])
    first = (np.zeros(3), np.eye(3))
    place, axes = flange_in_world(first, spec, 1, start)
    last = (np.array([0.05, -0.1, 0.08]), Rotation.from_rotvec([0.1, 0.2, -0.1]).as_matrix())
    path = base_path(pose(*first), pose(*last))
    positions, rotations = base_poses(path, np.linspace(0.0, 1.0, 25))
    branch = branch_of(arm_of(LIMB), link_frames(LIMB, start)[6], start)
    reference = start + 2.0 * np.pi * turns
    reference[5] += np.pi * flip
    bases, flanges = poses(positions, rotations), poses(place[None], axes[None])
    joints = joints_along(ROBOT.rows, 1, bases, flanges, branch, reference)
    assert joints.shape == (25, 6)
    np.testing.assert_allclose(joints[0], reference, atol=1e-9)
    assert np.abs(np.diff(joints, axis=0)).max() < 0.1
    half_turn = np.diag([(-1.0) ** flip, (-1.0) ** flip, 1.0])
    for k in range(25):
        found = flange_in_world((positions[k], rotations[k]), spec, 1, joints[k])
        np.testing.assert_allclose(found[0], place, atol=1e-9)
        np.testing.assert_allclose(found[1], axes @ half_turn, atol=1e-9)


def test_a_joint_goes_on_where_the_flange_makes_whole_turns():
    """The flange turns three times about its axis, and joint 6 with it."""
    spec, start = robot_spec("mlivr2"), np.array([0.3, -1.1, 1.4, 0.2, 0.9, -2.0])
    first, turns = (np.zeros(3), np.eye(3)), np.linspace(0.0, 6.0 * np.pi, 61)
    place, axes = flange_in_world(first, spec, 0, start)
    about = Rotation.from_rotvec(turns[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    flanges = poses(np.tile(place, (61, 1)), axes @ about)
    branch = branch_of(arm_of(LIMB), link_frames(LIMB, start)[6], start)
    bases = poses(first[0][None], first[1][None])
    joints = joints_along(ROBOT.rows, 0, bases, flanges, branch, start)
    np.testing.assert_allclose(joints, start + turns[:, None] * np.eye(6)[5], atol=1e-9)


ARM, ARM_ROW = pinocchio_arm(LIMB), arm_of(LIMB)


def information(robot, i, flange_pose, branch, l_c):
    """`K^-1` of a limb of a robot."""
    limb, out = limb_shapes.LimbModel.row(), np.full((6, 6), np.nan)
    limb["mount"] = pose(robot.mount_positions[i], robot.mount_rotations[i])
    limb["arm"] = ARM_ROW
    assert called(limb_information)(
        limb, flange_axis(flange_pose), branch, l_c, Inversion.row(), out
    )
    return out


def root_determinant(matrix):
    """What `inverse_root_determinant` finds, which is given the matrix and scratch."""
    return called(inverse_root_determinant)(np.stack([matrix, np.full((6, 6), np.nan)]))


def random_limb(rng):
    """Flange pose, Jacobian and branch of a configuration away from singularities."""
    while True:
        q = rng.uniform(-np.pi, np.pi, 6)
        pose, jacobian = flange(ARM, q)
        if abs(np.linalg.det(jacobian)) > 1e-2:
            break
    return pose, jacobian, branch_of(ARM_ROW, pose, q)


@pytest.mark.parametrize("limbs", [1, 2, 3, 4])
def test_fast_base_manipulability_agrees_with_the_null_space_definition(limbs):
    """Of one limb alone it is the manipulability of that limb."""
    robot, rng = robot_spec(f"mlivr{max(limbs, 2)}"), np.random.default_rng(limbs)
    l_c = robot.characteristic_length
    for _ in range(30):
        total, jacobians, grasps = np.zeros((6, 6)), [], []
        for i in range(limbs):
            pose, jacobian, branch = random_limb(rng)
            total += information(robot, i, pose, branch, l_c)
            jacobian, grasp = at_grasp(robot, i, pose, jacobian)
            jacobians.append(jacobian)
            grasps.append(grasp)
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
