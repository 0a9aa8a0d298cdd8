"""A limb's joint angles in the world against forward kinematics."""

import numpy as np
import pytest
from branches import solutions
from held_paths import mounted, random_ends
from scipy.spatial.transform import Rotation

from mlivr_gym import Limb, robot_spec
from mlivr_gym.collisions.base_path import base_path, base_poses
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.kinematics.limb import Angles, all_angles_at, joints_along
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
    base = random_ends(seed)[:2]
    q = rng.uniform(-np.pi, np.pi, 6)
    place, axes = flange_in_world(base, spec, i, q)
    out = Angles.rows(8)
    all_angles_at(ROBOT.rows, i, pose(*base), pose(place, axes), out)
    frame = link_frames(LIMB, q)[6]
    mask, _ = solutions(mounted()["arm"], frame[:3, 3], frame[:3, :3])
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
    mask, branches = solutions(mounted()["arm"], *_split(link_frames(LIMB, start)))
    there = [b for b in range(8) if mask >> b & 1]
    branch = min(there, key=lambda b: np.abs(np.exp(1j * branches[b]) - np.exp(1j * start)).max())
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
    flanges, branches = poses(np.tile(place, (61, 1)), axes @ about), Angles.rows(8)
    all_angles_at(ROBOT.rows, 0, pose(*first), flanges[0], branches)
    off = np.abs(np.exp(1j * branches["q"]) - np.exp(1j * start)).max(axis=1)
    branch = int(np.nanargmin(off))
    bases = poses(first[0][None], first[1][None])
    joints = joints_along(ROBOT.rows, 0, bases, flanges, branch, start)
    np.testing.assert_allclose(joints, start + turns[:, None] * np.eye(6)[5], atol=1e-9)


def _split(frames):
    return frames[6, :3, 3], frames[6, :3, :3]
