"""Poses along a path, against SciPy."""

import numpy as np
import pytest
from branches import triple
from compiled import called
from held_paths import path_between, random_ends
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from mlivr_gym.kinematics.base_path import (
    ARC,
    STRAIGHT,
    BasePath,
    base_poses,
    lift_path,
    resting,
    travel_seen,
    velocity_on_path,
)
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.kinematics.poses import pose

PIVOT = np.array([0.55, 0.0, -0.65])


def test_base_path_is_slerp_on_a_line_or_on_an_arc():
    ends, s = random_ends(3), np.linspace(0, 1, 11)
    positions, rotations = base_poses(path_between(ends, STRAIGHT), s)
    np.testing.assert_allclose(positions, ends[0] + s[:, None] * (ends[2] - ends[0]), atol=1e-12)
    slerp = Slerp([0, 1], Rotation.from_matrix(np.array([ends[1], ends[3]])))
    np.testing.assert_allclose(rotations, slerp(s).as_matrix(), atol=1e-12)
    positions, rotations = base_poses(path_between(ends, ARC, PIVOT), s)
    lengths = np.linalg.norm(positions - PIVOT, axis=1)
    np.testing.assert_allclose(np.diff(lengths, 2), 0.0, atol=1e-12)
    np.testing.assert_allclose(positions[[0, -1]], [ends[0], ends[2]], atol=1e-12)
    np.testing.assert_allclose(rotations, slerp(s).as_matrix(), atol=1e-12)


@pytest.mark.parametrize("kind", [STRAIGHT, ARC])
@pytest.mark.parametrize("seed", range(10))
def test_the_speed_of_a_path_bounds_that_of_the_base(kind, seed):
    """By differences; on a line it is the speed, and the angle is that by which the base turns."""
    ends, s = random_ends(seed), np.linspace(0, 1, 1001)
    path = path_between(ends, kind, PIVOT)
    positions, _ = base_poses(path, s)
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=1) * 1000
    assert speeds.max() <= path["speed"] * (1.0 + 1e-9)
    assert kind == ARC or speeds == pytest.approx(path["speed"], rel=1e-9)
    turned = (Rotation.from_matrix(ends[1]).inv() * Rotation.from_matrix(ends[3])).magnitude()
    assert path["angle"] == pytest.approx(turned, abs=1e-9)


@given(st.integers(0, 10**6), st.sampled_from([STRAIGHT, ARC]), st.floats(-1e-9, 1e-9))
@settings(max_examples=60, deadline=None)
def test_the_way_back_is_the_way_there(seed, kind, off):
    """Half turns too, of which both senses are equally short: noise must not choose."""
    rng, ends = np.random.default_rng(seed), random_ends(seed)
    if seed % 2:
        axis = rng.normal(size=3)
        half = Rotation.from_rotvec((np.pi + off) * axis / np.linalg.norm(axis))
        ends[3] = (Rotation.from_matrix(ends[1]) * half).as_matrix()
    s = np.linspace(0.0, 1.0, 9)
    there = base_poses(path_between(ends, kind, PIVOT), s)
    back = base_poses(path_between(ends[2:] + ends[:2], kind, PIVOT), 1.0 - s)
    for a, b in zip(there, back, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-7)


@pytest.mark.parametrize("kind", [STRAIGHT, ARC])
@pytest.mark.parametrize("seed", range(5))
def test_the_velocity_of_the_base_is_that_by_differences(kind, seed):
    path, step = path_between(random_ends(seed), kind, PIVOT), 1e-6
    for s in np.linspace(0.1, 0.9, 5):
        before, after = base_poses(path, np.array([s - step, s + step]))[0]
        found = called(velocity_on_path)(path, s)
        np.testing.assert_allclose(found, (after - before) / (2.0 * step), atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_a_departure_moves_the_base_into_the_surface(seed):
    """A limb that departs by some way along the normal sees its base go back by it."""
    (place, axes), rng, s = random_ends(seed)[:2], np.random.default_rng(seed), np.linspace(0, 1, 5)
    normal, rail, _ = Rotation.random(rng=rng).as_matrix()
    path, grasp = BasePath.row(), grasp_rows(rng.normal(size=(1, 3)), normal, rail, 0.1)[0]
    called(lift_path)(path, pose(place, axes), grasp, 0.07)
    positions, rotations = base_poses(path, s)
    np.testing.assert_allclose(positions, place - 0.07 * s[:, None] * normal, atol=1e-12)
    np.testing.assert_allclose(rotations, np.broadcast_to(axes, (5, 3, 3)), atol=1e-12)
    assert path["speed"] == 0.07
    called(resting)(path, pose(place, axes))
    positions, rotations = base_poses(path, s)
    np.testing.assert_allclose(positions, np.broadcast_to(place, (5, 3)), atol=1e-12)
    np.testing.assert_allclose(rotations, np.broadcast_to(axes, (5, 3, 3)), atol=1e-12)
    assert path["speed"] == path["angle"] == 0.0
    assert triple(path["last"]["position"]) == triple(path["first"]["position"])


@given(st.integers(0, 10**6), st.sampled_from([STRAIGHT, ARC]), st.sampled_from([0.5, 0.2, 0.05]))
@settings(max_examples=100, deadline=None)
def test_a_point_at_rest_travels_no_farther_seen_from_the_base_than_its_bound(seed, kind, half):
    """Bases that do not turn too: on an arc nothing but its bend is left to bound."""
    rng, ends = np.random.default_rng(seed), random_ends(seed)
    if seed % 2:
        ends[3] = ends[1]
    path, point = path_between(ends, kind, PIVOT), rng.uniform(-1.0, 1.0, 3)
    s = rng.uniform(half, 1.0 - half)
    positions, rotations = base_poses(path, s + half * np.linspace(-1.0, 1.0, 101))
    seen = np.einsum("kji,kj->ki", rotations, point - positions)
    gone = np.linalg.norm(seen - seen[50], axis=1).max()
    bound = called(travel_seen)(path, pose(positions[50], rotations[50]), s, half, tuple(point))
    assert gone <= bound + 1e-12


@given(st.integers(0, 10**6), st.floats(0.3, 3.0))
@settings(max_examples=60, deadline=None)
def test_the_bend_of_an_arc_is_bounded_and_not_by_far(seed, sweep):
    """The base does not turn, so a point at rest bends as the base does, by second differences."""
    rng, ends, h = np.random.default_rng(seed), random_ends(seed), 1e-4
    about = Rotation.from_rotvec(sweep * Rotation.random(rng=rng).as_matrix()[0]).as_matrix()
    ends[2] = PIVOT + rng.uniform(0.2, 5.0) * about @ (ends[0] - PIVOT)
    ends[3], half = ends[1], 0.01
    path, bends = path_between(ends, ARC, PIVOT), []
    for s in np.linspace(0.1, 0.9, 9):
        places, rotations = base_poses(path, s + np.array([-h, 0.0, h]))
        bends.append(np.linalg.norm(places[0] - 2.0 * places[1] + places[2]) / h**2)
        speed = np.linalg.norm(called(velocity_on_path)(path, s))
        way = called(travel_seen)(path, pose(places[1], rotations[1]), s, half, (0.0, 0.0, 0.0))
        bound = 2.0 * (way / half - speed) / half
        assert bends[-1] <= bound + 1e-4
    assert bound <= 3.0 * max(bends)
