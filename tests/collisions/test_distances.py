"""Distances and comparisons of shapes with Coal, and the path of the base with SciPy."""

import itertools

import coal
import numpy as np
import pytest
from coal_ruler import apart, behind, capsule, solid
from compiled import called
from hypothesis import given, settings
from hypothesis import settings as examples
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from mlivr_gym import Box
from mlivr_gym.collisions.against_boxes import (
    FLUSH,
    GraspSurface,
    compare_with_grid,
    lies_behind,
    set_grasp_surface,
)
from mlivr_gym.collisions.base_path import BasePath, base_path, base_poses, lift_path
from mlivr_gym.collisions.box_grid import CELL_EDGE, MOST_CELLS, MOST_ENTRIES, box_grid
from mlivr_gym.collisions.distances import (
    BOX,
    CLEAR,
    OBSTACLE,
    SEGMENT,
    SELF,
    UNDECIDED,
    compare_capsule_with_box,
    compare_capsules,
    keeps_distance,
    segment_box_distance,
    segments_distance,
)
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.kinematics.poses import pose


def vectors(low=-1.0, high=1.0):
    return st.lists(st.floats(low, high), min_size=3, max_size=3).map(np.array)


@given(vectors(), vectors(), vectors(0.05, 0.6))
@examples(max_examples=200, deadline=None)
def test_segment_to_box_agrees_with_coal(start, end, half):
    if np.linalg.norm(end - start) < 1e-3:
        return
    ours = segment_box_distance(tuple(start), tuple(end - start), tuple(half))
    theirs = apart(
        capsule(1e-3, start, end), (coal.Box(*(2.0 * half)), coal.Transform3s.Identity())
    )
    assert ours == pytest.approx(max(theirs + 1e-3, 0.0), abs=2e-4)


@given(vectors(), vectors(), vectors(), vectors())
@examples(max_examples=200, deadline=None)
def test_segment_to_segment_agrees_with_coal(a, b, c, d):
    if min(np.linalg.norm(b - a), np.linalg.norm(d - c)) < 1e-3:
        return
    ours = segments_distance(tuple(a), tuple(b - a), tuple(c), tuple(d - c))
    theirs = apart(capsule(1e-3, a, b), capsule(1e-3, c, d)) + 2e-3
    assert ours == pytest.approx(max(theirs, 0.0), abs=2e-4)


@given(
    st.booleans(),
    st.tuples(vectors(), vectors()),
    st.tuples(vectors(), vectors()),
    st.tuples(st.floats(0.01, 0.8), st.floats(0.01, 0.8)),
)
@examples(max_examples=200, deadline=None)
def test_an_axis_is_compared_with_a_length_that_changes_along_it(box, axis, other, lengths):
    """The result agrees with samples, unless rounding or the number of places leaves it open."""
    (start, end), (first, second), (at_start, at_end) = axis, other, lengths
    shape = np.abs(first) + 0.05 if box else first
    answer = called(keeps_distance)(
        BOX if box else SEGMENT,
        tuple(shape),
        tuple(second - first),
        tuple(start),
        tuple(end - start),
        at_start,
        at_end,
    )
    t = np.linspace(0.0, 1.0, 2001)
    points = start + t[:, None] * (end - start)
    if box:
        distance = np.linalg.norm(np.maximum(np.abs(points) - shape, 0.0), axis=1)
    else:
        along = second - first
        share = np.clip((points - first) @ along / max(along @ along, 1e-14), 0.0, 1.0)
        distance = np.linalg.norm(points - first - share[:, None] * along, axis=1)
    spare = (distance - at_start - t * (at_end - at_start)).min()
    if answer:
        assert spare >= -1e-9
    elif spare > 0.0:
        assert spare < 0.01


@given(
    st.booleans(),
    st.tuples(vectors(), vectors()),
    st.tuples(vectors(), vectors()),
    st.floats(0.01, 0.5),
    st.tuples(st.floats(0.0, 0.5), st.sampled_from([0.0, 0.05, 0.5])),
    st.floats(0.0, 0.1),
)
@examples(max_examples=300, deadline=None)
def test_capsules_are_clear_as_far_as_samples_of_their_motion_tell(
    box, axis, other, inner, moves, more
):
    """Either end of the first capsule may move farther; Coal measures the distances."""
    (start, end), (first, second) = axis, other
    if min(np.linalg.norm(end - start), np.linalg.norm(second - first)) < 1e-3:
        return
    shape, given = np.abs(first) + 0.05, (tuple(start), tuple(end - start))
    if box:
        answer = called(compare_capsule_with_box)(*given, tuple(shape), inner, moves)
        body = coal.Box(*(2.0 * shape)), coal.Transform3s.Identity()
        more = 0.0
    else:
        axes = (tuple(start), tuple(end)), (tuple(first), tuple(second))
        answer = called(compare_capsules)(*axes, inner, more, moves)
        body = capsule(1e-6, first, second)
    gap = max(apart(capsule(1e-6, start, end), body), 0.0)
    places = start + np.linspace(0.0, 1.0, 41)[:, None] * (end - start)
    ball = coal.Sphere(1e-6)
    away = [apart((ball, coal.Transform3s(np.eye(3), place)), body) for place in places]
    spare = min(np.maximum(away, 0.0) - inner - more - np.linspace(*moves, 41))
    if answer == CLEAR:
        assert spare >= -1e-3
    elif spare > 0.05:
        assert gap < inner + more + max(moves)
    if abs(gap - inner) > 1e-3:
        assert (answer == SELF) == (gap < inner)
    if gap > inner + more + max(moves) + 1e-3:
        assert answer == CLEAR
    assert answer in (CLEAR, UNDECIDED, SELF)


SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def random_boxes(rng, count, upright=False, spread=0.6):
    """Return boxes in random poses about the origin."""
    turns = [np.eye(3) if upright else Rotation.random(None, rng).as_matrix() for _ in range(count)]
    return [
        Box(f"b{k}", "obstacle", tuple(rng.uniform(-spread, spread, 3)),
            tuple(rng.uniform(0.02, 0.5 * spread, 3)),
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


FAR = [Box(f"far{side}", "obstacle", (side * 990.0,) * 3, (10.0,) * 3) for side in (-1, 1)]
"""With these, 2 km apart, the cells of a grid are large."""


@pytest.mark.parametrize(
    ("upright", "at_grasp", "spread", "far"),
    [
        *itertools.product([False, True], [False, True], [0.6], [[]]),
        (True, False, 3.0, []), (True, False, 3.0, FAR),
    ],
)  # fmt: skip
def test_a_capsule_meets_boxes_exactly_as_far_as_coal_says(upright, at_grasp, spread, far):
    """Boxes behind a grasp are omitted; results are checked just below and above each limit."""
    rng, skipped = np.random.default_rng(1), 0
    for k in range(40):
        boxes = random_boxes(rng, 12 if spread > 1.0 else 6, upright, spread) + far
        point, normal = surface(rng, boxes)
        grid, grasp = box_grid(boxes), at(point, normal)
        start = 1.6 * rng.uniform(-spread, spread, 3) + (1005.0 if far and k % 4 == 0 else 0.0)
        end = start + rng.uniform(0.05, spread) * Rotation.random(None, rng).as_matrix()[:, 0]
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


def random_ends(seed):
    """Base position and rotation at the start, then at the end."""
    rng = np.random.default_rng(seed)
    ends = []
    for _ in range(2):
        rotation = Rotation.from_rotvec(rng.normal(size=3) * 0.35).as_matrix()
        ends += [rng.uniform([-0.35, -0.35, -0.15], [0.35, 0.35, 0.25]), rotation]
    return ends


def path_between(ends):
    return base_path(pose(*ends[:2]), pose(*ends[2:]))


def test_a_base_path_is_slerp_on_a_line():
    ends, s = random_ends(3), np.linspace(0, 1, 11)
    path = path_between(ends)
    positions, rotations = base_poses(path, s)
    np.testing.assert_allclose(positions, ends[0] + s[:, None] * (ends[2] - ends[0]), atol=1e-12)
    slerp = Slerp([0, 1], Rotation.from_matrix(np.array([ends[1], ends[3]])))
    np.testing.assert_allclose(rotations, slerp(s).as_matrix(), atol=1e-12)
    turned = (Rotation.from_matrix(ends[1]).inv() * Rotation.from_matrix(ends[3])).magnitude()
    assert path["angle"] == pytest.approx(turned, abs=1e-9)


@given(st.integers(0, 10**6), st.floats(-1e-9, 1e-9))
@settings(max_examples=60, deadline=None)
def test_the_way_back_is_the_way_there(seed, off):
    """Half turns too, of which both senses are equally short: noise must not choose."""
    rng, ends = np.random.default_rng(seed), random_ends(seed)
    if seed % 2:
        axis = rng.normal(size=3)
        half = Rotation.from_rotvec((np.pi + off) * axis / np.linalg.norm(axis))
        ends[3] = (Rotation.from_matrix(ends[1]) * half).as_matrix()
    s = np.linspace(0.0, 1.0, 9)
    there = base_poses(path_between(ends), s)
    back = base_poses(path_between(ends[2:] + ends[:2]), 1.0 - s)
    for a, b in zip(there, back, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-7)


@pytest.mark.parametrize("seed", range(2))
def test_a_departure_moves_the_base_into_the_surface(seed):
    """A limb that departs by some way along the normal sees its base go back by it."""
    (place, axes), rng, s = random_ends(seed)[:2], np.random.default_rng(seed), np.linspace(0, 1, 5)
    normal, rail, _ = Rotation.random(None, rng).as_matrix()
    path, grasp = BasePath.row(), grasp_rows(rng.normal(size=(1, 3)), normal, rail, 0.1)[0]
    called(lift_path)(path, pose(place, axes), grasp, 0.07)
    positions, rotations = base_poses(path, s)
    np.testing.assert_allclose(positions, place - 0.07 * s[:, None] * normal, atol=1e-12)
    np.testing.assert_allclose(rotations, np.broadcast_to(axes, (5, 3, 3)), atol=1e-12)
