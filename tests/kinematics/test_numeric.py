"""Arms without a closed form against Pinocchio, and against a closed form."""

import numpy as np
import pinocchio as pin
import pytest
from arms import frames_at, turned
from branches import arm_of, flange_axis, solutions
from compiled import called
from oracle import LIMBS, TABLES, flange, model_of, volume

from mlivr_gym import Limb
from mlivr_gym.kinematics.chain import Chain
from mlivr_gym.kinematics.chain_record import set_seeds
from mlivr_gym.kinematics.forms import NUMERIC
from mlivr_gym.kinematics.inverse import branch_frames, branch_sizes
from mlivr_gym.robot.limb import link_frames

MODELS = {name: model_of(table) for name, table in TABLES.items()}
each_arm = pytest.mark.parametrize("name", LIMBS)
LEAST = 5e-3
"""Least `|det J|` of a posture that is used [m^3]."""


def of_pinocchio(name, q):
    """Poses of the links in Pinocchio, (6, 4, 4)."""
    model, data = MODELS[name], MODELS[name].createData()
    pin.forwardKinematics(model, data, q)
    return np.array([place.homogeneous for place in data.oMi.tolist()[1:]])


def random_poses(name, count, seed=0):
    """Random joint angles whose flange pose is not close to a singular one, and the pose."""
    rng = np.random.default_rng(seed)
    while count:
        q = rng.uniform(-np.pi, np.pi, 6)
        pose, jacobian = flange(MODELS[name], q)
        if volume(jacobian) > LEAST:
            count -= 1
            yield q, pose


@each_arm
def test_links_are_where_pinocchio_has_them(name):
    arm, rng = arm_of(LIMBS[name]), np.random.default_rng(0)
    for q in rng.uniform(-np.pi, np.pi, (30, 6)):
        frames, plain = frames_at(arm, q), link_frames(LIMBS[name], q)
        np.testing.assert_allclose(plain[1:], of_pinocchio(name, q), atol=1e-12)
        np.testing.assert_allclose(frames[:, 0], plain[:, :3, 3], atol=1e-12)
        np.testing.assert_allclose(frames[:, 1:], plain[:, :3, :3].transpose(0, 2, 1), atol=1e-12)


@each_arm
def test_the_postures_of_random_poses_are_found_but_for_those_of_one_name(name):
    """Every solution reaches the pose; few of a general arm's share a name with another one."""
    limb, arm, found, count = LIMBS[name], arm_of(LIMBS[name]), 0, 300
    for q, pose in random_poses(name, count):
        mask, out = solutions(arm, pose[:3, 3], pose[:3, :3])
        assert mask
        for b in range(8):
            if mask >> b & 1:
                np.testing.assert_allclose(flange(MODELS[name], out[b])[0], pose, atol=1e-8)
        found += min(turned(out[b], q) for b in range(8) if mask >> b & 1) < 1e-6
    least = {"ur5e": 1.0, "crx10": 0.9}.get(name, 0.98)
    assert found >= least * count
    pose = np.eye(4)
    pose[0, 3] = 1.1 * limb.reach
    assert solutions(arm, pose[:3, 3], pose[:3, :3])[0] == 0


def solved_numerically(limb):
    """The chain of a limb that has a closed form as one that has none."""
    rows = Chain.rows(1)
    rows[0] = arm_of(limb)
    out = rows[0]
    out["form"]["kind"] = NUMERIC
    set_seeds(out["form"], limb.steps, limb.windows)
    return out


def test_solutions_are_those_of_the_closed_form():
    """All branches of a UR5e, each with a name of its own, but for one in a thousand."""
    numeric, closed, missed, count = solved_numerically(LIMBS["ur5e"]), arm_of(Limb()), 0, 0
    for _, pose in random_poses("ur5e", 200):
        _, mine = solutions(numeric, pose[:3, 3], pose[:3, :3])
        _, theirs = solutions(closed, pose[:3, 3], pose[:3, :3], 0.0)
        regular = [q for q in theirs if volume(flange(MODELS["ur5e"], q)[1]) > LEAST]
        missed += sum(np.nanmin([turned(a, q) for a in mine]) > 1e-6 for q in regular)
        count += len(regular)
    assert count > 1000
    assert missed <= 1e-3 * count


@each_arm
def test_sizes_and_axes_are_those_of_the_jacobian(name):
    arm, every = arm_of(LIMBS[name]), np.empty(4)
    for _, pose in random_poses(name, 40):
        mask, out = solutions(arm, pose[:3, 3], pose[:3, :3])
        called(branch_sizes)(arm, flange_axis(pose), every)
        sizes = {}
        for b in range(8):
            frames = np.empty((7, 4, 3))
            there = called(branch_frames)(arm, flange_axis(pose), b, frames)
            assert there == bool(mask >> b & 1)
            if not there:
                continue
            _, jacobian = flange(MODELS[name], out[b])
            sizes.setdefault(b >> 1, []).append(volume(jacobian))
            moments = np.cross(frames[1:, 3], pose[:3, 3] - frames[1:, 0])
            built = np.vstack([moments.T, frames[1:, 3].T])
            np.testing.assert_allclose(built, jacobian, atol=1e-7)
            here = frames_at(arm, np.array([*out[b][:5], 0.0]))
            np.testing.assert_allclose(frames[:, [0, 3]], here[:, [0, 3]], atol=1e-9)
        for c in range(4):
            least = min(sizes[c]) if c in sizes else 0.0
            assert every[c] == pytest.approx(least, rel=1e-6, abs=1e-12)
