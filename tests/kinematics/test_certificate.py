"""What is certified keeps the floor at every point of a path."""

import numpy as np
import pytest
from branches import angles_on, flange_axis, flanges_nearby, solutions
from compiled import called
from held_paths import (
    EVERY_BRANCH,
    FLANGE,
    FLOOR,
    GRIP,
    LIMB,
    MOUNT,
    ORIGIN,
    TOOL,
    mounted,
    path_between,
    random_ends,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from mlivr_gym import Limb
from mlivr_gym.kinematics.base_path import ARC, CLOSEST_PIVOT, STRAIGHT, base_poses
from mlivr_gym.kinematics.certificate import Proof, certify
from mlivr_gym.kinematics.families import stays_above
from mlivr_gym.kinematics.ur import branch_terms, forward_kinematics, jacobian

HERE = mounted()


def certified(path, mask=EVERY_BRANCH):
    return called(certify)(HERE, FLANGE, path, FLOOR, mask, Proof.row())


def determinants(path, branch, samples=200):
    """|det J| of one branch at points of the path; 0 where it does not exist."""
    positions, rotations = base_poses(path, np.linspace(0, 1, samples))
    mounts = rotations @ MOUNT
    origins = positions + rotations @ ORIGIN
    flanges = np.einsum("kji,kj->ki", mounts, GRIP - origins), mounts.transpose(0, 2, 1) @ TOOL
    jacobians = np.zeros((samples, 6, 6))
    for k, flange in enumerate(zip(*flanges, strict=True)):
        q = angles_on(HERE["arm"], *flange, branch)
        if q is not None:
            jacobians[k] = jacobian(q, LIMB.lengths)
    return np.abs(np.linalg.det(jacobians))


@pytest.mark.parametrize("kind", [STRAIGHT, ARC])
@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_certified_choices_keep_the_floor_at_every_point(kind, seed):
    path = path_between(random_ends(seed), kind, (0.55, 0.0, -0.65))
    branches = certified(path)
    for c in range(4):
        least, of_class = determinants(path, 2 * c).min(), 0x0303 << (2 * c)
        if branches & of_class:
            assert branches & of_class == of_class
            assert least >= FLOOR * (1 - 1e-9)
        else:
            # The proof may only fail close to the floor: conservatism is bounded.
            assert least < FLOOR * 1.02


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_certificates_are_the_same_in_both_directions(seed):
    ends = random_ends(seed)
    there = certified(path_between(ends, STRAIGHT))
    back = certified(path_between([*ends[2:], *ends[:2]], STRAIGHT))
    assert there == back


@given(st.integers(0, 10**6), st.integers(0, EVERY_BRANCH))
@settings(max_examples=25, deadline=None)
def test_branches_are_certified_each_as_if_alone(seed, mask):
    path = path_between(random_ends(seed), STRAIGHT)
    assert certified(path, mask) == certified(path) & mask


def test_an_arc_through_its_pivot_is_not_certified():
    ends = random_ends(next(s for s in range(99) if certified(path_between(random_ends(s), 0))))
    assert certified(path_between(ends, ARC, ends[0] + [0.0, 0.0, 0.9 * CLOSEST_PIVOT])) == 0


def square_of(limb, q):
    """(det J / (a2 a3))^2 [m^2]."""
    return (np.linalg.det(jacobian(q, limb.lengths)) / (limb.a2 * limb.a3)) ** 2


def proved(arm, limb, q, change):
    """The largest floor that the bounds prove round joint angles; None if they prove nothing."""
    terms, here = np.zeros((4, 4)), square_of(limb, q)
    called(branch_terms)(arm, flange_axis(forward_kinematics(q, limb.lengths)[6]), terms)
    choice = int(np.abs(terms[:, 3] - here).argmin())
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


def least_nearby(arm, limb, q, change, rng):
    """The least square found on the branch of `q` where wrist and axis go as far as they may."""
    frame = forward_kinematics(q, limb.lengths)[6]
    _, angles = solutions(arm, frame[:3, 3], frame[:3, :3])
    branch = int(np.nanargmin(np.abs(np.exp(1j * angles) - np.exp(1j * q)).max(axis=1)))
    found = [angles_on(arm, *pose, branch) for pose in flanges_nearby(limb, frame, change, rng)]
    return min(0.0 if q is None else square_of(limb, q) for q in found)


@pytest.mark.parametrize("limb", [LIMB, Limb(d4=-0.1333, d5=-0.0997)], ids=["ur5e", "mirrored"])
def test_no_pose_within_the_bounds_is_below_what_they_prove(limb):
    """Postures near a stretched or folded elbow among them; the loss proved is about twice true."""
    rng, arm, losses = np.random.default_rng(0), mounted(limb)["arm"], []
    for k in range(150):
        q = rng.uniform(-np.pi, np.pi, 6)
        if k % 3:
            q[2] = np.pi * (k % 3 - 1) + rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.6)
        size = 10.0 ** rng.uniform(-3.0, -1.0)
        change = [(size, 0.0), (0.0, size), (size, size * rng.uniform(0.3, 2.0))][rng.integers(3)]
        floor = proved(arm, limb, q, change)
        if floor is not None:
            here, least = square_of(limb, q), least_nearby(arm, limb, q, change, rng)
            losses.append((here - floor) / (here - least))
    assert len(losses) > 50
    assert min(losses) >= 1.0
    assert np.median(losses) < 2.5
