"""Hits that known boxes explain, and cubes of the others."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym import Box
from mlivr_gym.extensions.closed_loop.hits import (
    CUBE,
    LEAST_GROWTH,
    MARGINS,
    HitCubes,
    unexplained,
)

BOUNDS = np.array([[-1.5, -1.5, -1.5], [1.5, 1.5, 1.5]])


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.01])
def test_a_hit_belongs_to_a_box_up_to_five_deviations_from_it(noise):
    """And a tenth of a millimetre for rounding; its distance from the face is exact."""
    rng, turn = np.random.default_rng(5), Rotation.random(random_state=5).as_matrix()
    half, centre = np.array([0.3, 0.2, 0.4]), np.array([0.1, -0.1, 0.2])
    box = Box("box", "rack", tuple(centre), tuple(half), tuple(map(tuple, turn)))
    far, most = Box("far", "rack", (9.0, 0.0, 0.0), (0.1, 0.1, 0.1)), 5.0 * noise + 1e-4
    axis, sign = rng.integers(3, size=200), rng.choice([-1.0, 1.0], 200)
    on = rng.uniform(-half, half, (200, 3))
    for share, count in ((0.99, 0), (1.01, 200)):
        on[np.arange(200), axis] = sign * (half[axis] + share * most)
        assert len(unexplained(centre + on @ turn.T, [far, box], noise)) == count


def test_hits_without_boxes_are_all_unexplained():
    hits = np.random.default_rng(0).uniform(size=(50, 3))
    np.testing.assert_array_equal(unexplained(hits, [], 0.0), hits)


def test_cubes_are_those_of_the_hits_counted_one_by_one():
    rng, cubes, all_hits = np.random.default_rng(3), HitCubes(BOUNDS), []
    for _ in range(4):
        hits = rng.uniform(-0.3, 0.3, (500, 3))
        cubes.add(np.vstack([hits, [[5.0, 0.0, 0.0]]]))  # the last one is outside the grid
        all_hits += hits.tolist()
    by_cell = {}
    for hit in np.array(all_hits):
        by_cell.setdefault(tuple(np.floor((hit - BOUNDS[0]) / CUBE).astype(int)), []).append(hit)
    assert len(cubes.cells) == len(by_cell)
    for cell, count, extent in zip(cubes.cells, cubes.count, cubes.extent, strict=True):
        own = np.array(by_cell[tuple(cell)])
        assert count == len(own)
        np.testing.assert_array_equal(extent, [-own.min(axis=0), own.max(axis=0)])


def test_boxes_contain_the_hits_and_no_place_in_a_cube_without_any():
    rng, cubes = np.random.default_rng(2), HitCubes(BOUNDS)
    hits = rng.uniform((-0.2, -0.2, 0.0), (0.2, 0.2, 0.04), (3000, 3))
    hits = hits[np.linalg.norm(hits[:, :2], axis=1) > 0.1]  # a plate with a hole
    cubes.add(hits)
    chosen = np.flatnonzero(cubes.is_solid)
    whole, merged, inside = cubes.whole(chosen), cubes.merged(chosen), np.zeros(len(hits), bool)
    for box in merged:
        low, high = box.bounds
        inside |= ((hits >= low) & (hits <= high)).all(axis=1)
        cells = np.floor((np.array([low + MARGINS[0], high - MARGINS[0]]) - BOUNDS[0]) / CUBE)
        for cell in np.ndindex(*(cells[1] - cells[0] + 1).astype(int)):
            assert (cubes.cells[chosen] == cells[0] + cell).all(axis=1).any()
    assert inside.all()
    assert len(merged) < len(whole) == len(chosen)
    for box, cell in zip(whole, cubes.cells[chosen], strict=True):
        middle = BOUNDS[0] + CUBE * (cell + 0.5)
        np.testing.assert_allclose(box.centre, middle)
        np.testing.assert_allclose(box.half, 0.5 * CUBE + MARGINS[0])
    assert cubes.merged(chosen[:0]) == ()


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("margin", MARGINS)
def test_a_cube_is_news_if_it_has_grown_by_the_margin_or_half_a_centimetre(side, margin):
    for share in (0.98, 1.02):
        cubes, middle = HitCubes(BOUNDS), np.full((2, 3), 0.5 * CUBE)
        cubes.margin = margin
        cubes.add(middle[:1])
        assert not cubes.is_new.any()  # one hit may be noise
        cubes.add(middle[:1])
        assert cubes.is_new.all()
        cubes.told[:] = cubes.extent
        assert not cubes.is_new.any()
        cubes.add(middle[:1] + side * share * max(margin, LEAST_GROWTH) * np.array([0.0, 1.0, 0.0]))
        assert cubes.is_new.tolist() == [share > 1.0]
