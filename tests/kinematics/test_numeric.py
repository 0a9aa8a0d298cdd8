"""Arms without a closed form against Pinocchio, against a closed form, and against small steps."""

import numpy as np
import pinocchio as pin
import pytest
from arms import flanges_in_mount, frames_at, turned
from branches import angles_on, arm_of, flange_axis, flanges_nearby, solutions
from compiled import called
from held_paths import EVERY_BRANCH, FLANGE, GRIP, mounted, path_between, random_ends
from numeric_arms import LIMBS, MODELS
from oracle import flange, volume

from mlivr_gym import Limb
from mlivr_gym.collisions.placement import IntervalAngles, Placed, are_changes_bounded
from mlivr_gym.kinematics.arm import JointAxes
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT
from mlivr_gym.kinematics.families import (
    branch_frames,
    branch_terms,
    grasp_motion,
    held_turns,
    joint_axes,
    link_motion,
)
from mlivr_gym.kinematics.holding import Holding, held_branches
from mlivr_gym.kinematics.limb import Track, begin
from mlivr_gym.kinematics.numeric_path import follow_numerically
from mlivr_gym.kinematics.turns import FlangeMotion, Turns, line_turns
from mlivr_gym.robot.link_frames import link_frames

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


def test_solutions_are_those_of_the_closed_form():
    """All branches of a UR5e, each with a name of its own, but for one in a thousand."""
    numeric, closed, missed, count = arm_of(LIMBS["ur5e"]), arm_of(Limb()), 0, 0
    for _, pose in random_poses("ur5e", 200):
        _, mine = solutions(numeric, pose[:3, 3], pose[:3, :3])
        _, theirs = solutions(closed, pose[:3, 3], pose[:3, :3], 0.0)
        regular = [q for q in theirs if volume(flange(MODELS["ur5e"], q)[1]) > LEAST]
        missed += sum(np.nanmin([turned(a, q) for a in mine]) > 1e-6 for q in regular)
        count += len(regular)
    assert count > 1000
    assert missed <= 1e-3 * count


@each_arm
def test_terms_and_axes_are_those_of_the_jacobian(name):
    arm, terms, axes = arm_of(LIMBS[name]), np.empty((4, 4)), JointAxes.row()
    for _, pose in random_poses(name, 40):
        mask, out = solutions(arm, pose[:3, 3], pose[:3, :3])
        called(branch_terms)(arm, flange_axis(pose), terms)
        sizes = {}
        for b in range(8):
            frames = np.empty((7, 4, 3))
            there = called(branch_frames)(arm, flange_axis(pose), b, JointAxes.row(), frames)
            assert there == bool(mask >> b & 1)
            if not there:
                continue
            _, jacobian = flange(MODELS[name], out[b])
            sizes.setdefault(b >> 1, []).append(volume(jacobian))
            assert called(joint_axes)(arm, flange_axis(pose), b, axes)
            moments = np.cross(axes["axis"], pose[:3, 3] - axes["point"])
            np.testing.assert_allclose(np.vstack([moments.T, axes["axis"].T]), jacobian, atol=1e-7)
            here = frames_at(arm, np.array([*out[b][:5], 0.0]))
            np.testing.assert_allclose(frames[:, [0, 3]], here[:, [0, 3]], atol=1e-9)
        for c in range(4):
            least = min(sizes[c]) ** 2 if c in sizes else -1.0
            assert terms[c, 3] == pytest.approx(least, rel=1e-6, abs=1e-12)


@each_arm
def test_joints_turn_no_farther_than_bounded_wherever_the_flange_goes(name):
    limb, arm, rng = LIMBS[name], arm_of(LIMBS[name]), np.random.default_rng(0)
    loose = []
    for k, (q, pose) in enumerate(random_poses(name, 150)):
        mask, out = solutions(arm, pose[:3, 3], pose[:3, :3])
        branch = min((turned(out[b], q), b) for b in range(8) if mask >> b & 1)[1]
        size, most = 10.0 ** rng.uniform(-4.0, -2.5), Turns.row()
        change = (size, 0.0) if k % 2 else (0.0, size)
        q = out[branch]
        if not called(held_turns)(arm, q.copy(), FlangeMotion(*change, change[1]), most):
            continue
        bounds = np.array([most[f"q{i + 1}"] for i in range(5)])
        for near in flanges_nearby(limb, pose, change, rng, 10):
            there = angles_on(arm, *near, branch)
            if there is None:
                continue  # beyond the angle at which the name changes
            off = np.abs(np.angle(np.exp(1j * (there - q))))[:5]
            if (off < 0.3).all():  # another solution of the name is elsewhere
                assert (off <= bounds + 1e-8).all()
                loose.append((bounds / np.maximum(off, 1e-12)).min())
    assert len(loose) > 500
    assert np.median(loose) < 4.0


@each_arm
def test_links_and_anchors_move_no_farther_than_bounded(name):
    """Seen from each link, and followed from the grasp; anchors are told by the limb."""
    limb, arm, rng = LIMBS[name], arm_of(LIMBS[name]), np.random.default_rng(0)
    shift, spin, turns = np.empty((5, 4)), np.empty((5, 7)), Turns.row()
    for _ in range(60):
        q = rng.uniform(-np.pi, np.pi, 6)
        change = rng.normal(size=6) * 10.0 ** rng.uniform(-2.0, -0.3) * (rng.random(6) < 0.6)
        called(line_turns)(arm, change, turns)
        called(link_motion)(arm, turns, shift, spin)
        grasp = called(grasp_motion)(arm, turns)
        before, after = (link_frames(limb, p) for p in (q, q + change))
        for row in range(5):
            (a, b) = (np.linalg.inv(frames[row]) @ frames for frames in (before, after))
            for link, anchors in limb.anchors.items():
                if link <= row:
                    continue
                angle = np.linalg.norm(pin.log3(a[link, :3, :3].T @ b[link, :3, :3]))
                assert angle <= spin[row, link] + 1e-9
                for anchor, place in anchors:
                    went = (b[link] - a[link])[:3] @ [*place, 1.0]
                    assert np.linalg.norm(went) <= shift[row, anchor] + 1e-9
        a, b = (np.linalg.inv(frames[6]) @ frames for frames in (before, after))
        for link, most, anchor, travel in (
            (5, grasp.wrist_2, 3, 0.0), (4, grasp.wrist_1, 2, grasp.forearm_end),
            (3, grasp.forearm, 2, grasp.forearm_end), (3, grasp.forearm, 1, grasp.elbow),
            (2, grasp.upper_arm, 1, grasp.elbow),
        ):  # fmt: skip
            assert np.linalg.norm(pin.log3(a[link, :3, :3].T @ b[link, :3, :3])) <= most + 1e-9
            place = dict(limb.anchors[link])[anchor]
            assert np.linalg.norm((b[link] - a[link])[:3] @ [*place, 1.0]) <= travel + 1e-9


def stepped(name, path, branch, count=90):
    """Least `|det J|` along a path in small steps, extents of joints, and whether it arrives.

    It is followed by Newton's method with Pinocchio's Jacobian from the branch at the start.
    """
    arm, model = arm_of(LIMBS[name]), MODELS[name]
    places = list(zip(*flanges_in_mount(path, np.linspace(0.0, 1.0, count)), strict=True))
    q = angles_on(arm, *places[0], branch)
    if q is None:
        return None
    least, rows = np.inf, [q]
    for p, r in places:
        for _ in range(8):
            pose, jacobian = flange(model, q)
            error = np.concatenate([p - pose[:3, 3], pin.log3(r @ pose[:3, :3].T)])
            if np.abs(error).max() < 1e-9:
                break
            q = q + np.linalg.lstsq(jacobian, error, rcond=None)[0]
        else:
            return 0.0, rows, False
        least = min(least, volume(jacobian))
        rows.append(q)
    named = angles_on(arm, *places[-1], branch)
    return least, np.array(rows[1:]), named is not None and turned(named, q) < 1e-6


def path_near(name, seed, kind):
    """A random base path near enough for the arm."""
    ends = random_ends(seed)
    for place in ends[::2] if name in ("xarm6", "jaco2") else ():
        place *= 0.5
        place += [0.1, 0.0, -0.2]
    return path_between(ends, kind, GRIP)


@pytest.mark.parametrize(
    ("name", "kind"), [("xarm6", STRAIGHT), ("crx10", STRAIGHT), ("jaco2", ARC)]
)
def test_a_limb_holds_where_small_steps_arrive_on_its_branch(name, kind):
    limb, floor, seen = LIMBS[name], 2e-3, [0, 0, 0]
    for seed in range(8):
        path = path_near(name, seed, kind)
        held = called(held_branches)(
            mounted(limb), FLANGE, path, floor, EVERY_BRANCH, Holding.row()
        )
        for branch in range(8):
            both = 0x0101 << branch
            if seed and not held & both:
                continue
            found = stepped(name, path, branch)
            if held & both:
                least, rows, arrives = found
                assert arrives
                assert least >= floor * (1 - 1e-9)
                for flip in range(2):
                    turns = rows + np.pi * flip * np.eye(6)[5]
                    shifted = turns + 2.0 * np.pi * np.round(-turns[0] / (2.0 * np.pi))
                    if held >> (branch + 8 * flip) & 1:
                        assert np.abs(shifted).max() <= np.pi + 1e-6
                assert not called(held_branches)(
                    mounted(limb), FLANGE, path, 1.001 * least, both, Holding.row()
                )
                track = Track.row()
                called(begin)(track)
                assert called(follow_numerically)(mounted(limb), FLANGE, path, floor, branch, track)
                extent = np.ptp(np.unwrap(rows, axis=0), axis=0)
                assert (extent <= track["high"] - track["low"] + 1e-9).all()
                seen[0] += 1
            elif found is not None and found[2] and found[0] > 1.05 * floor:
                extents = np.ptp(found[1], axis=0)
                seen[1 if (extents < 1.0).all() else 2] += 1
    assert seen[0] >= 5
    assert seen[1] <= seen[0]


def test_a_limb_does_not_hold_where_it_would_arrive_under_another_name():
    """Found by search: no posture on the way is near singular, but the name changes."""
    path, limb = path_near("crx10", 245, STRAIGHT), LIMBS["crx10"]
    least, rows, arrives = stepped("crx10", path, 0)
    assert least > 0.03
    assert np.ptp(rows, axis=0).max() < 2.0
    assert not arrives
    held = called(held_branches)(mounted(limb), FLANGE, path, 1e-3, 0x0101, Holding.row())
    assert not held


def test_changes_of_angles_beyond_their_bounds_are_seen():
    """As where a branch has other angles at an end, which belong to another solution."""
    for joint in range(6):
        for end in ("first", "last"):
            placed, ends = Placed.row(), IntervalAngles.row()
            for k in range(6):
                placed["turns"][f"q{k + 1}"] = 0.1
            ends[end][joint] = 0.1 - 2.0 * np.pi
            assert called(are_changes_bounded)(ends, placed)
            assert placed[f"to_{end}"][joint] == pytest.approx(0.1)
            ends[end][joint] = -0.11
            assert not called(are_changes_bounded)(ends, placed)
