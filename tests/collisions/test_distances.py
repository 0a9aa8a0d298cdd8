"""Distances and their comparison with lengths, against Coal and dense samples."""

import coal
import numpy as np
import pytest
from coal_ruler import apart, capsule
from compiled import called
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from mlivr_gym.collisions.distances import (
    BOX,
    CLEAR,
    SEGMENT,
    SELF,
    UNDECIDED,
    compare_capsule_with_box,
    compare_capsules,
    keeps_distance,
    segment_box_distance,
    segments_distance,
)


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
