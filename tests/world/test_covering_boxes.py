"""Boxes cover point clouds and capsules, and exceed them by no more than is stated."""

import coal
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from mlivr_gym import Box
from mlivr_gym.world.covering_boxes import capsule_box, point_cloud_boxes

SEEDS = st.integers(0, 2**32 - 1)


def drawn_inside(boxes, count, rng):
    """Random points of boxes."""
    chosen = [boxes[k] for k in rng.integers(len(boxes), size=count)]
    local = [np.array(box.half) * rng.uniform(-1.0, 1.0, 3) for box in chosen]
    return np.array([
        np.array(box.centre) + np.array(box.rotation) @ point
        for box, point in zip(chosen, local, strict=True)
    ])  # fmt: skip


@given(SEEDS, st.integers(1, 400), st.sampled_from([0.02, 0.05, 0.3]))
def test_each_point_lies_in_a_box_and_no_box_is_far_from_the_points(seed, count, resolution):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (count, 3)) * rng.uniform(0.05, 0.5, 3) + rng.normal(size=3)
    boxes = point_cloud_boxes(points, resolution)
    centres, halves = (np.array([getattr(box, k) for box in boxes]) for k in ("centre", "half"))
    inside = (np.abs(points[:, None] - centres) <= halves + 1e-9).all(axis=2)
    assert inside.any(axis=1).all()
    away, _ = cKDTree(points).query(drawn_inside(boxes, 200, rng))
    assert away.max() <= np.sqrt(3.0) * resolution + 1e-9
    assert len({box.id for box in boxes}) == len(boxes)
    # Each cube with a point lies in one box alone.
    cubes = len(np.unique(np.floor(points / resolution), axis=0))
    np.testing.assert_allclose(np.prod(2.0 * halves, axis=1).sum(), cubes * resolution**3)


@pytest.mark.parametrize("cubes", [128, 257, 65_536])
def test_a_long_row_of_cubes_is_one_box_for_each_gap(cubes):
    """Both ends of the row are there, so that the numbers of the cubes reach the last one."""
    gaps = np.array([cubes // 3, cubes - 2])
    cells = np.delete(np.arange(cubes), gaps)
    points = np.column_stack([np.zeros((cubes - 2, 2)), 0.01 * (cells + 0.5) - 300.0])
    for turn in range(3):
        boxes = point_cloud_boxes(np.roll(points, turn, axis=1), 0.01)
        bounds = np.array([box.bounds for box in boxes])[:, :, (2 + turn) % 3]
        ends = [[0, gaps[0]], [gaps[0] + 1, gaps[1]], [cubes - 1, cubes]]
        np.testing.assert_allclose(bounds, 0.01 * np.array(ends) - 300.0, atol=1e-9)


@given(SEEDS, st.floats(0.01, 0.4), st.booleans())
def test_a_box_covers_its_capsule_and_little_more(seed, radius, is_ball):
    """The distances from another shape are those of another library."""
    rng = np.random.default_rng(seed)
    start = rng.normal(size=3)
    end = start if is_ball else start + rng.normal(size=3)
    box = capsule_box("strut", start, end, radius)
    length = np.linalg.norm(end - start)
    frame = coal.Transform3s(np.array(box.rotation), np.array(box.centre))
    solid = coal.Box(*(2.0 * np.array(box.half)))
    # A capsule of coal lies along z.
    turned = np.array(box.rotation)[:, [1, 2, 0]]
    capsule = coal.Capsule(radius, length)
    ball = coal.Sphere(0.05)
    for centre in start + 2.0 * rng.normal(size=(20, 3)):
        at = coal.Transform3s(np.eye(3), centre)
        to_box, to_capsule = (
            coal.distance(shape, where, ball, at, coal.DistanceRequest(), coal.DistanceResult())
            for shape, where in (
                (solid, frame), (capsule, coal.Transform3s(turned, np.array(box.centre))),
            )
        )  # fmt: skip
        if to_box > 0.0:
            assert to_capsule - (np.sqrt(3.0) - 1.0) * radius - 1e-6 <= to_box <= to_capsule + 1e-6


@given(SEEDS, st.integers(1, 20))
def test_boxes_made_at_once_are_those_made_one_by_one(seed, count):
    rng = np.random.default_rng(seed)
    low = rng.normal(size=(count, 3))
    high = low + rng.uniform(1e-3, 1.0, (count, 3))
    each = Box.each_between("box", "obstacle", low, high)
    ends = enumerate(zip(low.tolist(), high.tolist(), strict=True))
    assert each == tuple(Box.between(f"box{k}", "obstacle", *one) for k, one in ends)
    assert len(set(each)) == count


def test_no_points_are_no_boxes():
    assert point_cloud_boxes(np.zeros((0, 3))) == ()
