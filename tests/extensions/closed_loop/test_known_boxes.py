"""Rays that pass through boxes, against samples along the rays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mlivr_gym import Box
from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.closed_loop.known_boxes import (
    EXPLAINED_DEVIATIONS,
    INSIDE,
    PASSES,
    KnownBoxes,
    passes_through,
    surface_distances,
)

GRID = np.array([-2.0, -2.0, -2.0]), 0.05, (80, 80, 80)


@given(st.integers(0, 2**32 - 1))
def test_a_ray_passes_through_if_samples_of_it_lie_deep_in_the_box(seed):
    rng = np.random.default_rng(seed)
    half, noise = rng.uniform(INSIDE + 0.001, 0.6, 3), 0.003
    turn = Rotation.random(random_state=seed % 2**31).as_matrix()
    box = Box(
        "box", "obstacle", tuple(rng.uniform(-0.5, 0.5, 3)), tuple(half), tuple(map(tuple, turn))
    )
    origins, hits = rng.uniform(-1.5, 1.5, (2, 40, 3))
    length = np.linalg.norm(hits - origins, axis=1)
    share = np.linspace(0.0, 1.0, 2001)[:, None, None]
    local = (origins + share * (hits - origins) - box.centre) @ turn
    depth = (half - np.abs(local)).min(axis=2)
    deep, deeper = (depth > INSIDE).any(axis=0), (depth > INSIDE + 0.002).any(axis=0)
    short = (1.0 - share[:, 0]) * length < EXPLAINED_DEVIATIONS * noise
    ends = ((depth > INSIDE) & short).any(axis=0)
    found = passes_through(box, hits, origins, noise)
    assert not found[~deep & ~_near(depth)].any()
    assert found[deeper & ~ends].all()
    assert not found[((depth > INSIDE + 0.002) & short).any(axis=0)].any()


@given(st.integers(0, 2**32 - 1))
def test_a_ray_passes_through_a_plate_from_face_to_face(seed):
    """Samples of the ray lie on both sides, and where it crosses the middle, far from the rim."""
    rng, noise = np.random.default_rng(seed), 0.003
    half = np.array([*rng.uniform(0.05, 0.6, 2), rng.uniform(0.002, INSIDE)])
    order = rng.permutation(3)
    turn = Rotation.random(random_state=seed % 2**31).as_matrix()
    centre = rng.uniform(-0.3, 0.3, 3)
    box = Box("plate", "obstacle", tuple(centre), tuple(half[order]), tuple(map(tuple, turn)))
    begin, end = rng.uniform(-1.0, 1.0, (2, 60, 3)) * [0.8, 0.8, 0.4]
    there = (turn @ np.moveaxis([begin, end], 2, 0)[order].reshape(3, -1)).T.reshape(2, 60, 3)
    found = passes_through(box, there[1] + centre, there[0] + centre, noise)
    crosses = begin[:, 2] * end[:, 2] < 0.0
    share = begin[:, 2] / (begin[:, 2] - end[:, 2])
    rim = (half - np.abs(begin + share[:, None] * (end - begin)))[:, :2].min(axis=1)
    beyond = np.abs(end[:, 2]) - half[2]
    assert found[crosses & (rim > INSIDE + 1e-6) & (beyond > INSIDE + 1e-6)].all()
    assert not found[~crosses | (rim < INSIDE - 1e-6) | (beyond < INSIDE - 1e-6)].any()
    thin = Box("rod", "obstacle", tuple(centre), (0.4, 0.02, 0.02), tuple(map(tuple, turn)))
    assert not passes_through(thin, there[1] + centre, there[0] + centre, noise).any()


def _near(depth):
    return depth.max(axis=0) > INSIDE - 0.002


def test_enough_rays_make_a_movable_box_gone_and_what_is_in_its_place_unexplained():
    wall = Box.between("wall", "rack", (1.0, -1.0, -1.0), (1.2, 1.0, 1.0))
    bag = Box.between("bag", "obstacle", (-0.2, -0.2, -0.2), (0.2, 0.2, 0.2))
    known = KnownBoxes([wall], 0.003, GRID, [bag])
    behind = np.repeat([[1.0, 0.0, 0.0]], PASSES, axis=0)
    before = np.repeat([[-1.0, 0.0, 0.0]], PASSES, axis=0)
    inside = np.array([[0.1, 0.0, 0.0]])
    assert not len(known.unexplained(inside)[0])
    assert known.see_through(np.repeat(inside, 100, axis=0), before[:1].repeat(100, axis=0)) == []
    assert known.see_through(behind[1:], before[1:]) == []
    assert known.see_through(behind[:1], before[:1]) == ["bag"]
    assert known.boxes == (wall,)
    assert len(known.unexplained(inside)[0]) == 1
    assert known.see_through(2.0 * behind, before) == []  # the map does not change
    with pytest.raises(SettingError, match="origins has 1 rows"):
        known.see_through(behind, before[:1])


def test_only_boxes_that_no_ray_has_hit_are_doubted():
    wall = Box.between("wall", "rack", (1.0, -1.0, -1.0), (1.2, 1.0, 1.0))
    seen = Box.between("seen", "obstacle", (-0.2, 0.5, -0.2), (0.2, 0.9, 0.2))
    unseen = Box.between("unseen", "obstacle", (0.8, -0.5, -0.2), (1.1, -0.1, 0.2))
    known = KnownBoxes([wall], 0.003, GRID, [seen, unseen])
    hits = np.repeat([[-0.2, 0.7, 0.0], [1.0, -0.3, 0.0]], PASSES, axis=0)  # one in `unseen`
    assert known.doubt() == []  # nobody has looked
    assert known.see_through(hits, hits - [0.05, 0.0, 0.0]) == []
    assert known.doubt() == ["unseen"]
    assert known.boxes == (wall, seen)
    assert known.doubt() == []


@given(st.integers(0, 2**32 - 1))
def test_distances_from_the_surface_are_those_of_the_closest_sample_on_it(seed):
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.1, 0.4, 3)
    box = Box("box", "obstacle", (0.1, 0.2, 0.3), tuple(half))
    axis, sign = rng.integers(3, size=20_000), rng.choice([-1.0, 1.0], 20_000)
    surface = rng.uniform(-half, half, (20_000, 3))
    surface[np.arange(20_000), axis] = sign * half[axis]
    positions = rng.uniform(-0.6, 0.6, (5, 3))
    nearest = np.linalg.norm(positions[:, None] - surface, axis=2).min(axis=1)
    found = surface_distances(box, positions + np.array(box.centre))
    assert (found <= nearest + 1e-12).all()
    assert (nearest - found < 0.03).all()


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.01])
def test_a_hit_belongs_to_a_box_up_to_five_deviations_from_it(noise):
    """And a tenth of a millimetre for rounding; its distance from the face is exact."""
    rng, turn = np.random.default_rng(5), Rotation.random(random_state=5).as_matrix()
    half, centre = np.array([0.3, 0.2, 0.4]), np.array([0.1, -0.1, 0.2])
    box = Box("box", "rack", tuple(centre), tuple(half), tuple(map(tuple, turn)))
    known, most = KnownBoxes([box], noise, GRID), 5.0 * noise + 1e-4
    axis, sign = rng.integers(3, size=200), rng.choice([-1.0, 1.0], 200)
    on = rng.uniform(-half, half, (200, 3))
    for share, count in ((0.99, 0), (1.01, 200)):
        on[np.arange(200), axis] = sign * (half[axis] + share * most)
        assert len(known.unexplained(centre + on @ turn.T)[0]) == count
