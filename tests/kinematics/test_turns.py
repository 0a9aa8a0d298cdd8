"""How far joints turn and links move, against joint angles at many places."""

from collections import defaultdict

import numpy as np
import pytest
from arms import (
    NEAR,
    angles_nearby,
    flanges_in_mount,
    frames_at,
    jacobian,
    path_near,
    random_posture,
)
from branches import angles_on, arm_of
from compiled import called
from held_paths import GRIP, TOOL
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from wrist_arms import FURTHER, LIMBS, OTHERS

from mlivr_gym.kinematics.arm import SPHERICAL_SHOULDER, UR
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, base_poses, travel_seen, turn_seen
from mlivr_gym.kinematics.families import grasp_motion, held_turns, link_motion
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.kinematics.turns import FlangeMotion, Turns, line_turns, lower_turns, more_turns
from mlivr_gym.robot.link_frames import link_frames

OFFSET = {"gen3-offset": FURTHER["gen3-offset"]}
"""An arm whose shoulder lies far beside the plane of its elbow."""

each_limb = pytest.mark.parametrize("limb", (NEAR | OFFSET).values(), ids=NEAR | OFFSET)
WRISTS = LIMBS | OTHERS
each_wrist = pytest.mark.parametrize("limb", WRISTS.values(), ids=WRISTS)
PLACES = 61


def scalars(limb, changes):
    """What `Turns` bounds, of changes of joint angles, shape (k, 6)."""
    out = {f"q{k + 1}": column for k, column in enumerate(changes.T)}
    out["q23"] = arm_of(limb)["c_held"] * changes[:, 1] + changes[:, 2]
    if limb.family_code == UR:
        out |= {"q234": changes[:, 1:4].sum(axis=1), "q34": changes[:, 2:4].sum(axis=1)}
    return out


def followed(limb, places, turned, branch):
    """Joint angles at flange poses in the limb base frame, continuous; None out of reach."""
    arm = arm_of(limb)
    found = [angles_on(arm, p, r, branch) for p, r in zip(places, turned, strict=True)]
    return None if any(q is None for q in found) else np.unwrap(np.array(found), axis=0)


def farthest(limb, q):
    """How far joints and sums of joints are at most from where they were in the middle."""
    off = scalars(limb, q - q[len(q) // 2])
    return {one: float(np.abs(values).max()) for one, values in off.items()}


def flange_motion(limb, path, s, half):
    """How far wrist and axis of a flange at rest go at most, seen from the base."""
    (position,), (rotation,) = base_poses(path, np.array([s]))
    wrist, base = GRIP - limb.d6 * TOOL[:, 2], pose(position, rotation)
    return FlangeMotion(
        called(travel_seen)(path, base, s, half, tuple(wrist.tolist())),
        called(turn_seen)(path, base, half, tuple(TOOL[:, 2].tolist())),
        float(path["angle"]) * half,
    )


def bounded(limb, q, moved):
    """Bounds before and after the angles at the ends are used; None where there are none."""
    middle, turns = q[len(q) // 2].copy(), Turns.row()
    if not called(held_turns)(arm_of(limb), middle, moved, turns):
        return None
    way = {one: float(turns[one]) for one in Turns.dtype.names}
    called(lower_turns)(arm_of(limb), q[0] - middle, q[-1] - middle, turns)
    return way, turns


@each_limb
@given(
    st.integers(0, 10**6),
    st.sampled_from([STRAIGHT, ARC]),
    st.floats(0.1, 0.9),
    st.floats(-5.0, -0.5),
    st.integers(0, 7),
)
@settings(max_examples=60, deadline=None)
def test_joints_of_a_limb_that_holds_turn_no_farther(limb, seed, kind, s, exponent, branch):
    half, path = min(10.0**exponent, s, 1.0 - s), path_near(limb, seed, kind)
    places, turned = flanges_in_mount(path, s + half * np.linspace(-1, 1, PLACES))
    q = followed(limb, places, turned, branch)
    assume(q is not None)
    moved = flange_motion(limb, path, s, half)
    gone = np.linalg.norm(np.diff(places - limb.d6 * turned[:, :, 2], axis=0), axis=1)
    assert max(gone[: PLACES // 2].sum(), gone[PLACES // 2 :].sum()) <= moved.travel + 1e-12
    cosine = turned[:, :, 2] @ turned[PLACES // 2, :, 2]
    assert np.arccos(np.clip(cosine, -1, 1)).max() <= moved.axis + 1e-7
    found = bounded(limb, q, moved)
    if found is None:
        return
    way, most = found
    steps = scalars(limb, np.diff(q, axis=0))
    for one, angle in farthest(limb, q).items():
        gone = np.abs(steps[one])
        assert max(gone[: PLACES // 2].sum(), gone[PLACES // 2 :].sum()) <= way[one] + 1e-9, one
        assert angle <= most[one] + 1e-9, one
        assert most[one] <= way[one]


@each_limb
def test_joints_turn_no_farther_wherever_wrist_and_axis_go_and_nearly_as_far(limb):
    """To poses all round; also where the elbow is nearly stretched, where little moves it most."""
    rng, loose = np.random.default_rng(0), defaultdict(list)
    for k in range(250):
        q = random_posture(limb, rng, k)
        size = 10.0 ** rng.uniform(-3.0, -1.5)
        change, most = [(size, 0.0), (0.0, size)][rng.integers(2)], Turns.row()
        if not called(held_turns)(arm_of(limb), q, FlangeMotion(*change, change[1]), most):
            continue
        found = np.array(angles_nearby(limb, q, change, rng), dtype=np.float64)
        # Rounding of a pose, magnified where the arm is nearly singular.
        noise = 1e-12 + 1e-15 * np.linalg.norm(np.linalg.inv(jacobian(limb, q)))
        for one, off in scalars(limb, np.angle(np.exp(1j * (found - q)))).items():
            angle = np.abs(off).max()
            assert angle <= most[one] + noise, one
            if angle > 1e-9:
                loose[one].append(most[one] / angle)
    assert min(map(len, loose.values())) > 25
    # Those of a spherical shoulder are proved in two steps, the first of them to the flange.
    most = {UR: 3.0, SPHERICAL_SHOULDER: 12.0}.get(limb.family_code, 5.0)
    assert max(map(np.median, loose.values())) < most


@each_limb
@given(st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_on_lines_joints_turn_as_far_as_the_longer_one(limb, seed):
    both, turns = np.random.default_rng(seed).normal(size=(2, 6)), Turns.row()
    found = scalars(limb, both)
    called(line_turns)(arm_of(limb), both[0], turns)
    assert all(turns[one] == pytest.approx(abs(found[one][0]), abs=1e-12) for one in found)
    called(more_turns)(arm_of(limb), both[1], turns)
    assert all(turns[one] == pytest.approx(np.abs(found[one]).max(), abs=1e-12) for one in found)


def angle_of(before, after):
    """Angle of the rotation between frames of one link, shape (3, 3) with axes as rows [rad]."""
    cosine, skew = 0.5 * (np.trace(before @ after.T) - 1.0), before.T @ after
    skew = 0.5 * (skew - skew.T)
    return np.arctan2(np.linalg.norm([skew[2, 1], skew[0, 2], skew[1, 0]]), cosine)


def seen_from(frames, row):
    """Origins and axes of all links seen from link `row`."""
    axes = frames[row, 1:]
    return (frames[:, 0] - frames[row, 0]) @ axes.T, frames[:, 1:] @ axes.T


@each_wrist
def test_links_and_anchors_move_no_farther_seen_from_each_link(limb):
    """Anchors are the origin of link 2, the elbow and, as forearm end and wrist, that of link 4.

    Of arms with a spherical shoulder they are those of links 3, 4, 4 and 5.
    """
    anchors = ((0, 2), (1, 3), (2, 4), (3, 4))
    if limb.family_code == SPHERICAL_SHOULDER:
        anchors = ((0, 3), (1, 4), (2, 4), (3, 5))
    rng, loose, arm, turns = np.random.default_rng(0), [], arm_of(limb), Turns.row()
    shift, spin = np.empty((5, 4)), np.empty((5, 7))
    for _ in range(150):
        q = random_posture(limb, rng, int(rng.integers(3)))
        change = rng.normal(size=6) * 10.0 ** rng.uniform(-2.0, -0.3) * (rng.random(6) < 0.6)
        called(line_turns)(arm, change, turns)
        called(link_motion)(arm, turns, shift, spin)
        middle = frames_at(arm, q)
        for s in (-1.0, -0.5, 0.5, 1.0):
            here = frames_at(arm, q + s * change)
            for row in range(5):
                (origins, axes), (moved, turned) = seen_from(middle, row), seen_from(here, row)
                for link in range(row + 1, 6):
                    angle = angle_of(axes[link], turned[link])
                    assert angle <= spin[row, link] + 1e-9
                    if row == 0 and angle > 1e-3:
                        loose.append(spin[row, link] / angle)
                for anchor, link in anchors:
                    if row < link:
                        way = np.linalg.norm(moved[link] - origins[link])
                        assert way <= shift[row, anchor] + 1e-9
    assert np.median(loose) < 2.5


@each_wrist
def test_links_move_no_farther_followed_from_the_grasp(limb):
    """Turns of links 2 to 5 seen from the flange, and the travel of the elbow."""
    rng, arm, turns = np.random.default_rng(0), arm_of(limb), Turns.row()
    for _ in range(150):
        q = rng.uniform(-np.pi, np.pi, 6)
        change = rng.normal(size=6) * 10.0 ** rng.uniform(-2.0, -0.3) * (rng.random(6) < 0.6)
        called(line_turns)(arm, change, turns)
        bound = called(grasp_motion)(arm, turns)
        before, after = (
            np.linalg.inv(f[6]) @ f for f in (link_frames(limb, q), link_frames(limb, q + change))
        )
        for link, most in ((5, bound.wrist_2), (4, bound.wrist_1), (3, bound.forearm),
                           (2, bound.upper_arm)):  # fmt: skip
            angle = angle_of(before[link, :3, :3].T, after[link, :3, :3].T)
            assert angle <= most + 1e-9
        elbow = 4 if limb.family_code == SPHERICAL_SHOULDER else 3
        for link, most in ((elbow, bound.elbow), (4, bound.forearm_end)):
            assert np.linalg.norm(after[link, :3, 3] - before[link, :3, 3]) <= most + 1e-9
