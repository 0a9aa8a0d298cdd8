"""How far joints turn, against joint angles at many places."""

import numpy as np
import pytest
from branches import angles_on, arm_of, flanges_nearby, solutions
from compiled import called
from held_paths import GRIP, LIMB, MOUNT, ORIGIN, TOOL, path_between, random_ends
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, base_poses, travel_seen, turn_seen
from mlivr_gym.kinematics.families import held_turns
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.kinematics.turns import FlangeMotion, Turns, line_turns, lower_turns, more_turns
from mlivr_gym.kinematics.ur import forward_kinematics

ARM = arm_of(LIMB)
SUMS = {
    "q1": [0], "q2": [1], "q23": [1, 2], "q234": [1, 2, 3], "q3": [2], "q34": [2, 3], "q4": [3],
    "q5": [4], "q6": [5],
}  # fmt: skip
PLACES = 81


def flanges_in_mount(path, s):
    """The flange that is held, in the limb base frame, at places of a base path."""
    positions, rotations = base_poses(path, s)
    mounts, origins = rotations @ MOUNT, positions + rotations @ ORIGIN
    return np.einsum("kji,kj->ki", mounts, GRIP - origins), mounts.transpose(0, 2, 1) @ TOOL


def followed(places, turned, branch):
    """Joint angles at flange poses in the limb base frame, continuous; None out of reach."""
    found = [angles_on(ARM, p, r, branch) for p, r in zip(places, turned, strict=True)]
    return None if any(q is None for q in found) else np.unwrap(np.array(found), axis=0)


def bounded(q, flange):
    """Bounds before and after the angles at the ends are used; None where there are none."""
    middle, turns = q[len(q) // 2].copy(), Turns.row()
    if not called(held_turns)(ARM, middle, flange, turns):
        return None
    way = {name: float(turns[name]) for name in SUMS}
    called(lower_turns)(ARM, q[0] - middle, q[-1] - middle, turns)
    return way, {name: float(turns[name]) for name in SUMS}


def farthest(q):
    """How far joints and sums of joints are at most from where they were in the middle."""
    off = q - q[len(q) // 2]
    return {name: float(np.abs(off[:, joints].sum(axis=1)).max()) for name, joints in SUMS.items()}


def travelled(q):
    """How far they go on the way to the farther end."""
    half = len(q) // 2
    steps = np.diff(q, axis=0)
    out = {}
    for name, joints in SUMS.items():
        ways = np.abs(steps[:, joints].sum(axis=1))
        out[name] = float(max(ways[:half].sum(), ways[half:].sum()))
    return out


@given(
    st.integers(0, 10**6),
    st.sampled_from([STRAIGHT, ARC]),
    st.floats(0.1, 0.9),
    st.floats(-5.0, -0.5),
    st.integers(0, 7),
)
@settings(max_examples=300, deadline=None)
def test_joints_of_a_limb_that_holds_turn_no_farther(seed, kind, s, exponent, branch):
    half = min(10.0**exponent, s, 1.0 - s)
    path, places = (
        path_between(random_ends(seed), kind, GRIP),
        s + half * np.linspace(-1, 1, PLACES),
    )
    flanges = flanges_in_mount(path, places)
    q = followed(*flanges, branch)
    assume(q is not None)
    (position,), (rotation,) = base_poses(path, np.array([s]))
    wrist, base = GRIP - LIMB.d6 * TOOL[:, 2], pose(position, rotation)
    axis = tuple(TOOL[:, 2].tolist())
    flange = FlangeMotion(
        called(travel_seen)(path, base, s, half, tuple(wrist.tolist())),
        called(turn_seen)(path, base, half, axis),
        float(path["angle"]) * half,
    )
    wrists = flanges[0] - LIMB.d6 * flanges[1][:, :, 2]
    way = np.linalg.norm(np.diff(wrists, axis=0), axis=1)
    assert max(way[: PLACES // 2].sum(), way[PLACES // 2 :].sum()) <= flange.travel + 1e-12
    cosine = flanges[1][:, :, 2] @ flanges[1][PLACES // 2, :, 2]
    assert np.arccos(np.clip(cosine, -1, 1)).max() <= flange.axis + 1e-7
    found = bounded(q, flange)
    if found is None:
        return
    way, most = found
    for name, turned in farthest(q).items():
        assert turned <= most[name] + 1e-9, name
        assert travelled(q)[name] <= way[name] + 1e-9, name
        assert most[name] <= way[name]


@pytest.mark.parametrize("kind", [STRAIGHT, ARC])
def test_bounds_of_short_intervals_are_not_far_from_the_truth(kind):
    """Mostly within three times; a bound without end would be of no use."""
    ratios = []
    for seed in range(60):
        path = path_between(random_ends(seed), kind, GRIP)
        places = 0.5 + 1e-3 * np.linspace(-1, 1, PLACES)
        q = followed(*flanges_in_mount(path, places), 0)
        if q is None:
            continue
        (position,), (rotation,) = base_poses(path, np.array([0.5]))
        wrist, base = GRIP - LIMB.d6 * TOOL[:, 2], pose(position, rotation)
        flange = FlangeMotion(
            called(travel_seen)(path, base, 0.5, 1e-3, tuple(wrist.tolist())),
            called(turn_seen)(path, base, 1e-3, tuple(TOOL[:, 2].tolist())),
            float(path["angle"]) * 1e-3,
        )
        found = bounded(q, flange)
        if found is not None:
            ratios += [found[1][name] / far for name, far in farthest(q).items() if far > 1e-4]
    assert len(ratios) > 100
    assert np.median(ratios) < 3.0


def test_joints_turn_no_farther_wherever_wrist_and_axis_go_and_nearly_as_far():
    """To poses all round; also where the elbow is nearly stretched, where little moves it most."""
    rng, loose = np.random.default_rng(0), {name: [] for name in SUMS}
    for k in range(150):
        q = rng.uniform(-np.pi, np.pi, 6)
        if k % 2:
            q[2] = rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.6)
        size = 10.0 ** rng.uniform(-3.0, -1.5)
        change, most = [(size, 0.0), (0.0, size)][rng.integers(2)], Turns.row()
        if not called(held_turns)(ARM, q, FlangeMotion(*change, change[1]), most):
            continue
        frame = forward_kinematics(q, LIMB.lengths)[6]
        _, angles = solutions(ARM, frame[:3, 3], frame[:3, :3])
        branch = int(np.nanargmin(np.abs(np.exp(1j * angles) - np.exp(1j * q)).max(axis=1)))
        poses = flanges_nearby(LIMB, frame, change, rng)
        found = np.array([angles_on(ARM, *pose, branch) for pose in poses], dtype=np.float64)
        off = np.angle(np.exp(1j * (found - q)))
        for name, joints in SUMS.items():
            turned = np.abs(off[:, joints].sum(axis=1)).max()
            assert turned <= most[name] + 1e-12, name
            if turned > 1e-9:
                loose[name].append(most[name] / turned)
    assert min(map(len, loose.values())) > 40
    assert max(np.median(ratios) for ratios in loose.values()) < 3.0


@given(st.integers(0, 10**6), st.floats(0.0, 0.1), st.integers(0, 7))
@settings(max_examples=100, deadline=None)
def test_joints_of_a_limb_that_departs_turn_no_farther(seed, lift, branch):
    rng = np.random.default_rng(seed)
    start = np.concatenate(list(flanges_in_mount(path_between(random_ends(seed)), np.zeros(1))[0]))
    turned = flanges_in_mount(path_between(random_ends(seed)), np.zeros(1))[1][0]
    middle = start + rng.normal(size=3) * 0.05
    places = middle - np.linspace(-lift, lift, PLACES)[:, None] * turned[:, 2]
    q = followed(places, np.tile(turned, (PLACES, 1, 1)), branch)
    assume(q is not None)
    found = bounded(q, FlangeMotion(lift, 0.0, 0.0))
    if found is not None:
        assert all(turned <= found[1][name] + 1e-9 for name, turned in farthest(q).items())


@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6).map(np.array))
@settings(deadline=None)
def test_on_a_line_joints_turn_as_far_as_its_end(change):
    turns = Turns.row()
    called(line_turns)(ARM, change, turns)
    for name, joints in SUMS.items():
        assert turns[name] == pytest.approx(abs(change[joints].sum()), abs=1e-12)


@given(st.integers(0, 10**6))
@settings(max_examples=50, deadline=None)
def test_of_two_lines_joints_turn_as_far_as_on_the_longer_one(seed):
    both, turns = np.random.default_rng(seed).normal(size=(2, 6)), Turns.row()
    called(line_turns)(ARM, both[0], turns)
    called(more_turns)(ARM, both[1], turns)
    for name, joints in SUMS.items():
        assert turns[name] == pytest.approx(np.abs(both[:, joints].sum(axis=1)).max(), abs=1e-15)
