"""What is proved of the motion of arms that hold joint 1 or 2, against many postures nearby."""

import numpy as np
import pytest
from branches import angles_on, arm_of, flange_axis, flanges_nearby, solutions
from compiled import called
from held_paths import EVERY_BRANCH, FLANGE, FLOOR, GRIP, MOUNT, ORIGIN, TOOL, mounted, random_ends
from held_paths import path_between as path_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from wrist_arms import OTHERS as LIMBS

from mlivr_gym.kinematics.arm import SPHERICAL_WRIST
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, base_poses, travel_seen, turn_seen
from mlivr_gym.kinematics.certificate import Proof, certify
from mlivr_gym.kinematics.families import (
    branch_terms,
    forward_kinematics,
    held_turns,
    stays_above,
)
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.kinematics.spherical_wrist import jacobian
from mlivr_gym.kinematics.turns import FlangeMotion, Turns, line_turns, lower_turns, more_turns

each_limb = pytest.mark.parametrize("name", LIMBS)
NAMES = ("q1", "q2", "q3", "q4", "q5", "q6", "q23")
PLACES = 81


def flange(limb, q):
    return forward_kinematics(q, limb.lengths, SPHERICAL_WRIST)[6]


def path_between(limb, seed, kind=STRAIGHT):
    """A base path near enough for the arm, which is longer or shorter than a UR5e."""
    ends = random_ends(seed)
    for place in ends[::2]:
        place += [-0.3, 0.0, 0.05]
        # The shoulder of some is the base.
        place += [0.36, 0.0, 0.0] if limb.lengths[0] == 0.0 else [0.0, 0.0, 0.0]
    return path_of(ends, kind, GRIP)


def flanges_in_mount(path, s):
    """The flange that is held, in the limb base frame, at places of a base path."""
    positions, rotations = base_poses(path, s)
    mounts, origins = rotations @ MOUNT, positions + rotations @ ORIGIN
    return np.einsum("kji,kj->ki", mounts, GRIP - origins), mounts.transpose(0, 2, 1) @ TOOL


def followed(arm, places, turned, branch):
    """Joint angles at flange poses in the limb base frame, continuous; None out of reach."""
    found = [angles_on(arm, p, r, branch) for p, r in zip(places, turned, strict=True)]
    return None if any(q is None for q in found) else np.unwrap(np.array(found), axis=0)


def scalars(limb, changes):
    """What `Turns` bounds, of changes of joint angles, shape (k, 6)."""
    return dict(
        zip(NAMES, [*changes.T, np.cos(limb.lengths[9]) * changes[:, 1] + changes[:, 2]],
            strict=True)
    )  # fmt: skip


def square_of(limb, q):
    """(det J / (a2 L))^2 [m^2]."""
    return (np.linalg.det(jacobian(q, limb.lengths)) / arm_of(limb)["links"]) ** 2


def branch_of(arm, limb, q):
    frame = flange(limb, q)
    _, angles = solutions(arm, frame[:3, 3], frame[:3, :3])
    return int(np.nanargmin(np.abs(np.exp(1j * angles) - np.exp(1j * q)).max(axis=1)))


def random_posture(limb, rng, k):
    """Joint angles, often near a stretched or folded elbow."""
    q = rng.uniform(-np.pi, np.pi, 6)
    if k % 3:
        _, _, _, a2, b2, a3, d4, *_ = limb.lengths
        bend = np.arctan2(a3, d4) - np.arctan2(b2, a2)
        q[2] = bend + np.pi * (k % 3 - 1) + rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.6)
    return q


def proved(arm, limb, q, change):
    """The largest floor that the bounds prove round joint angles; None if they prove nothing."""
    terms, here = np.zeros((4, 4)), square_of(limb, q)
    called(branch_terms)(arm, flange_axis(flange(limb, q)), terms)
    choice = branch_of(arm, limb, q) >> 1
    if not called(stays_above)(arm, terms, choice, change, 0.0):
        return None
    low, high = 0.0, here
    for _ in range(40):
        middle = 0.5 * (low + high)
        if called(stays_above)(arm, terms, choice, change, middle):
            low = middle
        else:
            high = middle
    return low


@each_limb
def test_no_pose_within_the_bounds_is_below_what_they_prove(name):
    """Postures near a stretched or folded elbow among them; the loss proved is about thrice true.

    The planted fault: what half the change proves is broken by some pose.
    """
    limb, rng, losses, faults = LIMBS[name], np.random.default_rng(0), [], 0
    arm = arm_of(limb)
    for k in range(150):
        q = random_posture(limb, rng, k)
        size = 10.0 ** rng.uniform(-3.0, -1.0)
        change = [(size, 0.0), (0.0, size), (size, size * rng.uniform(0.3, 2.0))][rng.integers(3)]
        floor = proved(arm, limb, q, change)
        if floor is None:
            continue
        branch, here = branch_of(arm, limb, q), square_of(limb, q)
        poses = flanges_nearby(limb, flange(limb, q), change, rng)
        found = [angles_on(arm, *one, branch) for one in poses]
        least = min(0.0 if one is None else square_of(limb, one) for one in found)
        losses.append((here - floor) / (here - least))
        half = proved(arm, limb, q, (0.25 * change[0], 0.25 * change[1]))
        faults += half is not None and least < half
    assert len(losses) > 50
    assert min(losses) >= 1.0
    assert np.median(losses) < 3.5
    assert faults > 20


def determinants(limb, path, branch, samples=200):
    """|det J| of one branch at points of the path; 0 where it does not exist."""
    found = np.zeros(samples)
    places = zip(*flanges_in_mount(path, np.linspace(0, 1, samples)), strict=True)
    for k, here in enumerate(places):
        q = angles_on(arm_of(limb), *here, branch)
        if q is not None:
            found[k] = abs(np.linalg.det(jacobian(q, limb.lengths)))
    return found


@each_limb
@pytest.mark.parametrize("kind", [STRAIGHT, ARC])
def test_certified_choices_keep_the_floor_at_every_point(name, kind):
    limb, floor, seen = LIMBS[name], 0.2 * FLOOR, [0, 0]
    for seed in range(30):
        path = path_between(limb, seed, kind)
        mask = called(certify)(mounted(limb), FLANGE, path, floor, EVERY_BRANCH, Proof.row())
        for c in range(4):
            least, of_class = determinants(limb, path, 2 * c).min(), 0x0303 << (2 * c)
            if mask & of_class:
                assert mask & of_class == of_class
                assert least >= floor * (1 - 1e-9)
            else:
                # The proof may only fail close to the floor: conservatism is bounded.
                assert least < floor * 1.02
            seen[bool(mask & of_class)] += 1
    assert seen[0] > 5
    assert seen[1] >= 4


@each_limb
@given(
    st.integers(0, 10**6),
    st.sampled_from([STRAIGHT, ARC]),
    st.floats(0.1, 0.9),
    st.floats(-5.0, -0.5),
    st.integers(0, 7),
)
@settings(max_examples=100, deadline=None)
def test_joints_of_a_limb_that_holds_turn_no_farther(name, seed, kind, s, exponent, branch):
    limb, half = LIMBS[name], min(10.0**exponent, s, 1.0 - s)
    arm, path = arm_of(limb), path_between(limb, seed, kind)
    q = followed(arm, *flanges_in_mount(path, s + half * np.linspace(-1, 1, PLACES)), branch)
    assume(q is not None)
    (position,), (rotation,) = base_poses(path, np.array([s]))
    wrist, base = GRIP - limb.d6 * TOOL[:, 2], pose(position, rotation)
    moved = FlangeMotion(
        called(travel_seen)(path, base, s, half, tuple(wrist.tolist())),
        called(turn_seen)(path, base, half, tuple(TOOL[:, 2].tolist())),
        float(path["angle"]) * half,
    )
    middle, turns = q[PLACES // 2].copy(), Turns.row()
    if not called(held_turns)(arm, middle, moved, turns):
        return
    steps = scalars(limb, np.diff(q, axis=0))
    for one in NAMES:
        way = np.abs(steps[one])
        assert max(way[: PLACES // 2].sum(), way[PLACES // 2 :].sum()) <= turns[one] + 1e-9, one
    way = {one: float(turns[one]) for one in NAMES}
    called(lower_turns)(arm, q[0] - middle, q[-1] - middle, turns)
    for one, off in scalars(limb, q - middle).items():
        assert np.abs(off).max() <= turns[one] + 1e-9, one
        assert turns[one] <= way[one]


@each_limb
def test_joints_turn_no_farther_wherever_wrist_and_axis_go_and_nearly_as_far(name):
    limb, rng, loose = LIMBS[name], np.random.default_rng(0), {one: [] for one in NAMES}
    arm = arm_of(limb)
    for k in range(150):
        q = random_posture(limb, rng, k)
        size = 10.0 ** rng.uniform(-3.0, -1.5)
        change, most = [(size, 0.0), (0.0, size)][rng.integers(2)], Turns.row()
        if not called(held_turns)(arm, q, FlangeMotion(*change, change[1]), most):
            continue
        branch = branch_of(arm, limb, q)
        poses = flanges_nearby(limb, flange(limb, q), change, rng)
        found = np.array([angles_on(arm, *one, branch) for one in poses], dtype=np.float64)
        # Rounding of a pose, magnified where the arm is nearly singular.
        noise = 1e-12 + 1e-15 * np.linalg.norm(np.linalg.inv(jacobian(q, limb.lengths)))
        for one, off in scalars(limb, np.angle(np.exp(1j * (found - q)))).items():
            turned = np.abs(off).max()
            assert turned <= most[one] + noise, one
            if turned > 1e-9:
                loose[one].append(most[one] / turned)
    assert min(map(len, loose.values())) > 25
    assert max(np.median(ratios) for ratios in loose.values()) < 5.0


@each_limb
@given(st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_on_lines_joints_turn_as_far_as_the_longer_one(name, seed):
    limb, both, turns = LIMBS[name], np.random.default_rng(seed).normal(size=(2, 6)), Turns.row()
    found = scalars(limb, both)
    called(line_turns)(arm_of(limb), both[0], turns)
    assert all(turns[one] == pytest.approx(abs(found[one][0])) for one in NAMES)
    called(more_turns)(arm_of(limb), both[1], turns)
    assert all(turns[one] == pytest.approx(np.abs(found[one]).max()) for one in NAMES)
