"""Limbs on lines and limbs that follow the base: axes, travel and turns against sampled motions."""

from collections import Counter

import numpy as np
import oracle
import pytest
from compiled import called
from joint_lines import flange_in_body, line_scratch
from scipy.spatial.transform import Rotation, Slerp
from wrist_arms import OTHERS

from mlivr_gym import Limb, robot_spec
from mlivr_gym.collisions.following import (
    Following,
    JointAxesSeen,
    bound_changes,
    invert_jacobian,
)
from mlivr_gym.collisions.joint_lines import (
    LimbPlace,
    place_limb,
    travel,
)
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.compiled.bit_sets import EVERY
from mlivr_gym.kinematics.chain_record import set_chain
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.rigid import inverse, rigid

ROBOT = robot_spec("mlivr2")
SHAPES = LimbShapes(ROBOT)
SHARES = np.linspace(-1.0, 1.0, 9)
ARMS = {
    "ur5e": ROBOT.every_limb[0], "iiwa-fifth": OTHERS["iiwa-fifth"],
    "numeric": oracle.LIMBS["xarm6"],
}  # fmt: skip


def with_arm(name):
    """The record of a limb of the robot with another arm, and that arm."""
    arm, rows = ARMS[name], SHAPES.rows.copy()
    limb = rows[0]["limbs"][1]
    set_chain(limb["arm"], arm.steps, arm.senses, arm.windows)
    return limb, arm


def placed_at(limb, q, change=0.0):
    """A limb in the middle of a line that turns each joint by `change` to either side [rad]."""
    placed = LimbPlace.row()
    joints = np.zeros((2, 2, 6))
    joints[:, 1] = q - change, q + change
    called(place_limb)(limb, line_scratch(joints, np.eye(4))["line"], 0.5, 0.5, EVERY, placed)
    return placed


@pytest.mark.parametrize("name", ARMS)
def test_axes_and_flange_are_those_of_forward_kinematics(name):
    rng = np.random.default_rng(0)
    limb, arm = with_arm(name)
    mount = rigid(limb["mount"]["rotation"], limb["mount"]["position"])
    for _ in range(10):
        q = rng.uniform(-np.pi, np.pi, 6)
        placed = placed_at(limb, q)
        axis, point = placed["joints"]["axis"], placed["joints"]["point"]
        radius = (mount @ link_frames(arm, q)[6])[:3, 3] - point
        truth = np.kron(np.eye(2), mount[:3, :3]) @ jacobian(arm, q)
        np.testing.assert_allclose(np.vstack([np.cross(axis, radius).T, axis.T]), truth, atol=1e-8)
        ours = called(invert_jacobian)(placed["joints"], Following.row())
        np.testing.assert_allclose(ours, abs(np.linalg.det(truth)), atol=1e-7)


def ends_in_body(q):
    """Ends of the capsules of limb 1 in the body frame, shape (c, 2, 3)."""
    shapes = SHAPES.each[1]
    frames = link_frames(ROBOT.every_limb[1], q)[shapes.links]
    mount = rigid(ROBOT.mount_rotations[1], ROBOT.mount_positions[1])
    frames = mount @ frames
    return np.einsum("cij,cej->cei", frames[:, :3, :3], shapes.ends) + frames[:, None, :3, 3]


def carried(grasp, q):
    """Frame of the base in the world while limb 1 holds a flange frame (4, 4)."""
    return grasp @ np.linalg.inv(flange_in_body(ROBOT, 1, q))


@pytest.mark.parametrize("size", [0.02, 0.3, 1.2])
def test_nothing_travels_farther_than_its_bound(size):
    """As seen from the body, from each link of the limb, and in the world of a grasp it holds."""
    rng, limb, links = np.random.default_rng(1), SHAPES.rows[0]["limbs"][1], SHAPES.each[1].links
    used = []
    for _ in range(60):
        q = rng.uniform(-np.pi, np.pi, 6)
        change = rng.uniform(-size, size, 6) * rng.integers(0, 2, 6)
        placed, middle = placed_at(limb, q, change), ends_in_body(q)
        np.testing.assert_allclose(placed["in_body"]["ends"][: len(links)], middle, atol=1e-12)
        grasp = rigid(Rotation.random(None, rng).as_matrix(), rng.normal(size=3))
        in_world = [carried(grasp, q + s * change) for s in SHARES]
        here = carried(grasp, q)
        ends = [ends_in_body(q + s * change) for s in SHARES]
        for c, link in enumerate(links.tolist()):
            for e in range(2):
                p = middle[c, e]
                far = max(np.linalg.norm(there[c, e] - p) for there in ends)
                bound = placed["in_body"]["motion"][c, e]
                assert far <= bound + 1e-12
                used.append(far / bound if bound > 1e-9 else 1.0)
                # In the world, where the flange stands still.
                moved = max(
                    np.linalg.norm(b[:3, :3] @ t[c, e] + b[:3, 3] - here[:3, :3] @ p - here[:3, 3])
                    for b, t in zip(in_world, ends, strict=True)
                )
                bound = called(travel)(placed, link, 6, tuple(p))
                assert moved <= bound + 1e-12
                # Another body that is fixed to the base goes with all joints.
                carried_along = max(
                    np.linalg.norm(b[:3, :3] @ p + b[:3, 3] - here[:3, :3] @ p - here[:3, 3])
                    for b in in_world
                )
                assert carried_along <= called(travel)(placed, 0, 6, tuple(p)) + 1e-12
        for row in range(1, 6):
            flange_of_row = [link_frames(ROBOT.every_limb[1], q + s * change) for s in SHARES]
            start = link_frames(ROBOT.every_limb[1], q)
            seen = np.linalg.inv(start[row]) @ start[6]
            moved = max(
                np.linalg.norm((np.linalg.inv(f[row]) @ f[6] - seen)[:3, 3]) for f in flange_of_row
            )
            p = flange_in_body(ROBOT, 1, q)[:3, 3]
            assert moved <= called(travel)(placed, row, 6, tuple(p)) + 1e-12
    # On short lines that turn joints alike the bound is used up, on long ones a part of it.
    assert max(used) > (0.999 if size < 0.1 else 0.6)


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
