import numpy as np
import pytest
from compiled import called

from mlivr_gym import Box
from mlivr_gym.collisions.against_boxes import GraspSurface, compare_with_grid
from mlivr_gym.collisions.box_grid import CELL_EDGE, MOST_CELLS, MOST_ENTRIES, box_grid
from mlivr_gym.collisions.distances import CLEAR, UNDECIDED, segment_box_distance


def answer(grid, start, end, radius, motion=(0.0, 0.0)):
    """Return the result of comparing a capsule whose ends may move with a grid."""
    axis = tuple(start), tuple(end)
    return called(compare_with_grid)(axis, radius, motion, grid, GraspSurface.row(), False)


def touched(grid, start, end, radius):
    """Return whether the grid reports that a capsule touches a box."""
    return answer(grid, start, end, radius) != CLEAR


def random_boxes(rng, count):
    middle, half = rng.uniform(-3, 3, (count, 3)), rng.uniform(0.05, 0.6, (count, 3))
    return [Box(f"b{k}", "obstacle", tuple(middle[k]), tuple(half[k])) for k in range(count)]


FAR = [Box(f"far{side}", "obstacle", (side * 990.0,) * 3, (10.0,) * 3) for side in (-1, 1)]


@pytest.mark.parametrize("far", [[], FAR], ids=["close", "far"])
def test_the_grid_finds_what_pairwise_distances_find(far):
    """Compare with all boxes one by one; where some are 2 km away the cells are large."""
    rng = np.random.default_rng(0)
    boxes = random_boxes(rng, 12) + far
    grid = box_grid(boxes)
    found = []
    for _ in range(300):
        start, end, radius = (
            rng.uniform(-4, 4, 3),
            rng.uniform(-4, 4, 3),
            float(rng.uniform(0.01, 0.3)),
        )
        apart = [
            segment_box_distance(tuple(start - box.centre), tuple(end - start), box.half) - radius
            for box in boxes
        ]
        assert touched(grid, start, end, radius) == (min(apart) < 0.0)
        # Where it touches at its midpoint, neither its motion nor other close boxes matter.
        moving = answer(grid, start, end, radius, tuple(rng.uniform(0.0, 0.5, 2)))
        assert (moving > UNDECIDED) == (min(apart) < 0.0)
        found.append(min(apart) < 0.0)
    assert 50 < sum(found) < 250
    assert touched(grid, (980.0, 985.0, 990.0), (985.0, 985.0, 985.0), 0.1) == bool(far)


@pytest.mark.parametrize(
    "boxes",
    [
        FAR,
        [Box("all", "obstacle", (0, 0, 0), (1000, 1000, 1000))],
        [Box(f"b{k}", "obstacle", (0, 0, 0), (60, 60, 60)) for k in range(40)],
        [Box("mote", "obstacle", (1000, 1000, 1000), (1e-9, 1e-9, 1e-9)), *FAR],
    ],
    ids=["far", "large", "many", "mote"],
)
def test_the_grid_stays_small_however_far_boxes_reach(boxes):
    grid = box_grid(boxes)
    frame = grid.frames[0]
    assert frame["edge"] > CELL_EDGE
    assert frame["cells"].prod() <= MOST_CELLS
    assert len(grid.items) <= MOST_ENTRIES
    assert len(grid.fill_bounds) == len(grid.start) - 1 == frame["cells"].prod()


@pytest.mark.parametrize("seed", range(2))
def test_no_box_reaches_into_the_empty_region(seed):
    """It has the middle of all boxes inside."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform(-3.0, 3.0, (60, 3))
    middle = middle[np.abs(middle).max(axis=1) > 0.5]
    boxes = [Box(f"b{k}", "obstacle", tuple(c), (0.2, 0.1, 0.15)) for k, c in enumerate(middle)]
    low, high = np.array([box.bounds for box in boxes]).swapaxes(0, 1)
    region = box_grid(boxes).frames[0]["empty_region"]
    at = 0.5 * (low.min(axis=0) + high.max(axis=0))
    assert ((region["low"] < at) & (at < region["high"])).all()
    assert not ((low < region["high"] - 1e-9) & (high > region["low"] + 1e-9)).all(axis=1).any()
