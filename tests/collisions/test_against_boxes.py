"""Capsules against rotated boxes, some of which lie behind a grasp, compared with Coal."""

import itertools

import numpy as np
import pytest
from coal_ruler import apart, behind, capsule, solid
from compiled import called
from scipy.spatial.transform import Rotation

from mlivr_gym import Box
from mlivr_gym.collisions.against_boxes import (
    FLUSH,
    GraspSurface,
    compare_with_grid,
    lies_behind,
    set_grasp_surface,
)
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.distances import CLEAR, OBSTACLE, UNDECIDED

SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def random_boxes(rng, count, upright=False):
    """Return boxes in random poses about the origin."""
    turns = [np.eye(3) if upright else Rotation.random(None, rng).as_matrix() for _ in range(count)]
    return [
        Box(f"b{k}", "obstacle", tuple(rng.uniform(-0.6, 0.6, 3)), tuple(rng.uniform(0.02, 0.3, 3)),
            Box.rows(turn))
        for k, turn in enumerate(turns)
    ]  # fmt: skip


def surface(rng, boxes):
    """Return a point and a normal; some of the boxes lie behind that surface and some do not."""
    normal = Rotation.random(None, rng).as_matrix()[:, 2]
    return tuple(rng.uniform(-0.3, 0.3) * normal), tuple(normal)


def at(point, normal):
    """Return the grasp at that surface."""
    row = GraspSurface.row()
    called(set_grasp_surface)(row, point, normal)
    return row


@pytest.mark.parametrize("upright", [False, True])
def test_a_box_lies_behind_a_surface_if_no_corner_stands_out_of_it(upright):
    """Corners just below and just above the `FLUSH` limit are tested."""
    rng = np.random.default_rng(0)
    for box in random_boxes(rng, 60, upright):
        normal = Rotation.random(None, rng).as_matrix()[:, 2]
        corners = np.array(box.centre) + SIGNS * box.half @ np.array(box.rotation).T
        row = box_grid([box]).boxes[0]
        for out in (FLUSH - 1e-6, FLUSH + 1e-6, rng.uniform(-1.0, 1.0)):
            point = ((corners @ normal).max() - out) * normal
            assert called(lies_behind)(row, at(tuple(point), tuple(normal))) == (out <= FLUSH)


@pytest.mark.parametrize("at_grasp", [False, True])
@pytest.mark.parametrize("upright", [False, True])
def test_a_capsule_meets_boxes_exactly_as_far_as_coal_says(upright, at_grasp):
    """Boxes behind a grasp are omitted; results are checked just below and above each limit."""
    rng, skipped = np.random.default_rng(1), 0
    for _ in range(40):
        boxes = random_boxes(rng, 6, upright)
        point, normal = surface(rng, boxes)
        grid, grasp = box_grid(boxes), at(point, normal)
        start = rng.uniform(-1.0, 1.0, 3)
        end = start + rng.uniform(0.05, 0.4) * Rotation.random(None, rng).as_matrix()[:, 0]
        counted = [box for box in boxes if not (at_grasp and behind(box, point, normal))]
        skipped += len(boxes) - len(counted)
        away = min((apart(capsule(1e-6, start, end), solid(b)) + 1e-6 for b in counted), default=9)
        if away < 1e-3:
            continue
        moved = rng.uniform(0.01, 0.1)

        def answer(inner, motion, axis=(start, end), world=(grid, grasp)):
            ends = tuple(map(tuple, axis))
            return called(compare_with_grid)(ends, inner, motion, *world, at_grasp)

        near = 1e-5
        assert answer(away - near, (0.0, 0.0)) == CLEAR
        assert answer(away + near, (0.0, 0.0)) == (OBSTACLE if counted else CLEAR)
        if away > moved + near:
            assert answer(away - moved - near, (moved, moved)) == CLEAR
            outer = answer(away - moved + near, (moved, moved))
            assert outer == (UNDECIDED if counted else CLEAR)
    assert (skipped > 20) == at_grasp
