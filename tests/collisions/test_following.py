"""A limb that holds follows a base on a straight way as far as is proved, for every kind of arm.

Truth is the limb's joints all along the interval: from the middle on, Newton's method on the
forward kinematics of NumPy holds the flange where it is in the world while the base moves.
"""

from collections import Counter

import numpy as np
import pytest
from compiled import called
from numeric_arms import TABLES, limb_of
from scipy.spatial.transform import Rotation, Slerp
from wrist_arms import OTHERS

from mlivr_gym import Limb
from mlivr_gym.collisions.following import (
    Following,
    JointAxesSeen,
    bound_changes,
    invert_jacobian,
)
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.rigid import inverse, rigid

ARMS = {
    "ur5e": Limb(), "iiwa-fifth": OTHERS["iiwa-fifth"], "numeric": limb_of(TABLES["xarm6"]),
}  # fmt: skip

SAMPLES = np.linspace(-1.0, 1.0, 21)


def axes_seen(limb, q):
    """Joint axes of a limb whose mount is the body, a row of `JointAxesSeen`, by differences."""
    out, flange = JointAxesSeen.row(), link_frames(limb, q)[6]
    for j in range(6):
        h = 1e-6 * np.eye(6)[j]
        ahead, behind = (link_frames(limb, q + d)[6] for d in (h, -h))
        out["axis"][j] = Rotation.from_matrix(ahead[:3, :3] @ behind[:3, :3].T).as_rotvec() / 2e-6
        move = (ahead[:3, 3] - behind[:3, 3]) / 2e-6
        out["point"][j] = flange[:3, 3] - np.cross(move, out["axis"][j])
    return out


def jacobian(limb, q):
    """Jacobian of the flange, by differences, shape (6, 6): three rows of velocity, then turns."""
    joints, flange = axes_seen(limb, q), link_frames(limb, q)[6, :3, 3]
    return np.vstack([np.cross(joints["axis"], flange - joints["point"]).T, joints["axis"].T])


def held(limb, q, base, grasp):
    """Joint angles near q (6,) with which the flange is at a grasp in the world; None if none."""
    for _ in range(30):
        off = inverse(base @ link_frames(limb, q)[6]) @ grasp
        error = np.array([*off[:3, 3], *Rotation.from_matrix(off[:3, :3]).as_rotvec()])
        if np.abs(error).max() < 1e-11:
            return q
        frame = link_frames(limb, q)[6]
        turned = np.concatenate([frame[:3, :3] @ error[:3], frame[:3, :3] @ error[3:]])
        q = q + np.linalg.solve(jacobian(limb, q), turned)
    return None


def way(rng, size):
    """Base frames along a straight way, as a function of places from -1 to 1."""
    shift, turn = rng.normal(size=3) * size, rng.normal(size=3) * size * rng.integers(0, 2)
    slerp = Slerp([-1.0, 1.0], Rotation.from_rotvec([-0.5 * turn, 0.5 * turn]))
    where = Rotation.random(None, rng).as_matrix()
    at = rigid(where, rng.normal(size=3))
    return lambda s: at @ rigid(slerp(s).as_matrix(), 0.5 * s * shift), (shift, turn)


@pytest.mark.parametrize("name", ARMS)
def test_joints_turn_no_farther_than_is_proved(name):
    limb, rng, counts, used = ARMS[name], np.random.default_rng(0), Counter(), []
    for n in range(120):
        q = rng.uniform(-np.pi, np.pi, 6)
        frames, (shift, turn) = way(rng, (0.01, 0.03, 0.1)[n % 3])
        joints, scratch, change = axes_seen(limb, q), Following.row(), np.zeros(6)
        det = called(invert_jacobian)(joints, scratch)
        truth = jacobian(limb, q)
        assert det == pytest.approx(abs(np.linalg.det(truth)), abs=1e-6)
        # Of the whole way, 0 to 1, the interval is all; the shift is seen from its middle.
        proved = called(bound_changes)(0.5, tuple(shift), tuple(turn), joints, scratch, change)
        counts[bool(proved)] += 1
        if not proved:
            continue
        grasp = frames(0.0) @ link_frames(limb, q)[6]
        farthest = np.zeros(6)
        for side in (-1.0, 1.0):
            here = q
            for s in np.abs(SAMPLES[SAMPLES >= 0.0]) * side:
                here = held(limb, here, frames(s), grasp)
                assert here is not None
                farthest = np.maximum(farthest, np.abs(here - q))
        assert (farthest <= change + 1e-9).all()
        used.append((farthest / change).max())
    assert min(counts.values()) > 10
    assert max(used) > 0.9


def test_no_proof_leads_through_a_singularity():
    """The elbow of the default arm is nearly straight, and the base moves away from the grasp."""
    limb, found = Limb(), Counter()
    for bent in (0.02, 0.05, 0.1, 0.5, 1.0):
        q = np.array([0.3, -1.2, bent, 0.4, 1.1, 0.2])
        joints, scratch, change = axes_seen(limb, q), Following.row(), np.zeros(6)
        called(invert_jacobian)(joints, scratch)
        flange = link_frames(limb, q)[6, :3, 3]
        away = -0.02 * flange / np.linalg.norm(flange)
        half = called(bound_changes)(0.5, tuple(away), (0.0,) * 3, joints, scratch, change)
        grasp = link_frames(limb, q)[6]
        there = all(
            held(limb, q, rigid(np.eye(3), s * away), grasp) is not None for s in (-0.5, 0.5)
        )
        assert there or not half
        found[bool(half)] += 1
    assert min(found.values()) > 0
