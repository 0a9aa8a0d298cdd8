"""What is certified keeps the floor at every point of a path."""

import numpy as np
import pytest
from arms import (
    NEAR,
    angles_nearby,
    branch_of,
    flanges_in_mount,
    jacobian,
    path_near,
    random_posture,
)
from branches import angles_on, arm_of, flange_axis
from compiled import called
from held_paths import EVERY_BRANCH, FLANGE, FLOOR, mounted, path_between, random_ends
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import volume

from mlivr_gym.kinematics.arm import SPHERICAL_SHOULDER, UR
from mlivr_gym.kinematics.base_path import ARC, CLOSEST_PIVOT, STRAIGHT
from mlivr_gym.kinematics.certificate import Proof, certify
from mlivr_gym.kinematics.families import branch_terms, stays_above
from mlivr_gym.robot.link_frames import link_frames

each_limb = pytest.mark.parametrize("limb", NEAR.values(), ids=NEAR)
HERE = mounted()


def certified(path, mask=EVERY_BRANCH, here=HERE, floor=FLOOR):
    return called(certify)(here, FLANGE, path, floor, mask, Proof.row())


def determinants(limb, path, branch, samples=40):
    """|det J| of one branch at points of the path; 0 where it does not exist."""
    places = zip(*flanges_in_mount(path, np.linspace(0, 1, samples)), strict=True)
    found = [angles_on(arm_of(limb), *here, branch) for here in places]
    return np.array([0.0 if q is None else volume(jacobian(limb, q)) for q in found])


@each_limb
def test_certified_choices_keep_the_floor_at_every_point(limb):
    floor, seen = FLOOR * (1.0 if limb.family_code == UR else 0.2), [0, 0]
    for seed in range(20):
        path = path_near(limb, seed, (STRAIGHT, ARC)[seed % 2])
        branches = certified(path, here=mounted(limb), floor=floor)
        for c in range(4):
            least, of_class = determinants(limb, path, 2 * c).min(), 0x0303 << (2 * c)
            if branches & of_class:
                assert branches & of_class == of_class
                assert least >= floor * (1 - 1e-9)
            else:
                # The proof may only fail close to the floor: conservatism is bounded.
                assert least < floor * 1.02
            seen[bool(branches & of_class)] += 1
    assert seen[0] > 5
    assert seen[1] >= 4


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
    """Square of `det J` over the lengths of both links [m^2]; 0 where there are no angles."""
    if q is None:
        return 0.0
    return (np.linalg.det(jacobian(limb, q)) / arm_of(limb)["links"]) ** 2


def proved(limb, q, change):
    """The largest floor that the bounds prove round joint angles; None if they prove nothing."""
    arm, terms, choice = arm_of(limb), np.zeros((4, 4)), branch_of(limb, q) >> 1
    called(branch_terms)(arm, flange_axis(link_frames(limb, q)[6]), terms)
    if not called(stays_above)(arm, terms, choice, change, 0.0):
        return None
    low, high = 0.0, square_of(limb, q)
    for _ in range(40):
        middle = 0.5 * (low + high)
        if called(stays_above)(arm, terms, choice, change, middle):
            low = middle
        else:
            high = middle
    return low


def least_nearby(limb, q, change, rng):
    """The least square found on the branch of `q` where wrist and axis go as far as they may."""
    return min(square_of(limb, angles) for angles in angles_nearby(limb, q, change, rng))


@each_limb
def test_no_pose_within_the_bounds_is_below_what_they_prove(limb):
    """Postures near a stretched or folded elbow among them; the loss proved is about thrice true.

    The planted fault: what half the change proves is broken by some pose.
    """
    rng, losses, faults = np.random.default_rng(0), [], 0
    for k in range(240 if limb.family_code == SPHERICAL_SHOULDER else 120):
        q = random_posture(limb, rng, k)
        size = 10.0 ** rng.uniform(-3.0, -1.0)
        change = [(size, 0.0), (0.0, size), (size, size * rng.uniform(0.3, 2.0))][rng.integers(3)]
        floor = proved(limb, q, change)
        if floor is None:
            continue
        here, least = square_of(limb, q), least_nearby(limb, q, change, rng)
        losses.append((here - floor) / (here - least))
        half = proved(limb, q, (0.25 * change[0], 0.25 * change[1]))
        faults += half is not None and least < half
    assert len(losses) > 50
    assert min(losses) >= 1.0
    # Those of a spherical shoulder are proved in two steps, the first of them to the flange.
    assert np.median(losses) < {UR: 2.5, SPHERICAL_SHOULDER: 6.0}.get(limb.family_code, 3.5)
    assert faults > 20
