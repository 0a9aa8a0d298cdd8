"""Quick tests that come before exact distances, against their definitions in NumPy."""

import numpy as np
from compiled import called

from mlivr_gym import robot_spec
from mlivr_gym.collisions.against_boxes import inside, overlap
from mlivr_gym.collisions.against_robot import axes_apart, limbs_apart
from mlivr_gym.collisions.box_grid import Bounds
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.placing import Placed

SHAPES = LimbShapes(robot_spec("mlivr2"))


def gap(first, second):
    """Widest gap across an axis between two sets of points, shape (k, 3); negative if none."""
    apart = first.min(axis=0) - second.max(axis=0), second.min(axis=0) - first.max(axis=0)
    return float(np.max(apart))


def test_segments_are_apart_where_an_axis_has_a_gap_between_them():
    rng, found = np.random.default_rng(0), []
    for _ in range(300):
        first, second = rng.uniform(-1.0, 1.0, (2, 2, 3))
        answer = called(axes_apart)(tuple(map(tuple, first)), tuple(map(tuple, second)), 0.2)
        assert answer == (gap(first, second) > 0.2)
        found.append(answer)
    assert 50 < sum(found) < 250


def test_limbs_are_apart_where_an_axis_has_a_gap_between_all_their_shapes():
    """What lies in the rows of shapes that the limb does not have plays no part."""
    rng, count, found = np.random.default_rng(1), len(SHAPES), []
    for _ in range(200):
        rows, corners = [Placed.row() for _ in range(2)], []
        for row, middle in zip(rows, (np.zeros(3), rng.uniform(-1.0, 1.0, 3)), strict=True):
            shapes = row["in_body"]
            shapes["ends"], shapes["motion"] = 9.0, 9.0
            shapes["ends"][:count] = middle + rng.uniform(-0.2, 0.2, (count, 2, 3))
            shapes["motion"][:count] = rng.uniform(0.0, 0.05, (count, 2))
            reach = (SHAPES.radii[:, None] + shapes["motion"][:count])[..., None]
            ends = shapes["ends"][:count]
            corners.append(np.concatenate([ends - reach, ends + reach]).reshape(-1, 3))
        first, second = (row["in_body"] for row in rows)
        answer = called(limbs_apart)(SHAPES.limb, first, SHAPES.limb, second, 0.02)
        assert answer == (gap(*corners) > 0.02)
        found.append(answer)
    assert 20 < sum(found) < 180


def test_upright_boxes_meet_or_contain_each_other_as_their_corners_say():
    rng, bounds, met, held = np.random.default_rng(2), Bounds.row(), 0, 0
    for _ in range(300):
        low, high = rng.uniform(-1.0, 0.0, (2, 3)), rng.uniform(0.0, 1.0, (2, 3))
        shift = rng.uniform(-1.0, 1.0, 3) * rng.integers(0, 2)
        low[0], high[0] = 0.5 * low[0] + shift, 0.5 * high[0] + shift
        bounds["low"], bounds["high"] = low[1], high[1]
        box = tuple(low[0]), tuple(high[0])
        meets = (low[0] <= high[1]).all() and (high[0] >= low[1]).all()
        within = (low[0] > low[1]).all() and (high[0] < high[1]).all()
        assert called(overlap)(*box, bounds) == meets
        assert called(inside)(*box, bounds) == within
        met, held = met + meets, held + within
    assert 50 < met < 290
    assert 20 < held < 250
