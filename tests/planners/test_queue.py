"""The queue of the compiled searches against the heap of Python's library."""

import heapq

import numpy as np
import pytest
from compiled import called
from hypothesis import given, settings
from hypothesis import strategies as st

from mlivr_gym.planners.queue import first, grown, has_room, pop, push, queue

FEW = st.sampled_from([-np.inf, -1.5, -0.0, 0.0, 1.0, 1.0 + 1e-15, 2.0, np.inf])
"""Few values, so that most entries tie."""
NUMBER = FEW | st.floats(allow_nan=False)
ACTION = st.none() | st.tuples(NUMBER, NUMBER)
"""Take the first entry, or add one with an estimate and a cost."""


def waiting(entries):
    return int(entries.filled["size"])


def check(actions, room):
    """Do the same with both queues; larger `g` first among equal `f`, then the earlier entry."""
    entries, plain, made = queue(room), [], 0
    for action in (*actions, *[None] * len(actions)):
        assert waiting(entries) == len(plain)
        if plain:
            assert called(first)(entries) == plain[0][2]
        if action is not None:
            f, g = action
            if not called(has_room)(entries, 1):
                assert made == len(entries.f)
                entries = grown(entries)
            called(push)(entries, f, g, -g, 7 * made, -1 - made, made % 5)
            heapq.heappush(plain, (f, -g, made))
            made += 1
        elif plain:
            item = heapq.heappop(plain)[2]
            assert called(first)(entries) == item
            called(pop)(entries)
    assert waiting(entries) == len(plain) == 0
    assert int(entries.filled["used"]) == made
    given_ = [action for action in actions if action is not None]
    np.testing.assert_array_equal(entries.f[:made], [f for f, _ in given_])
    np.testing.assert_array_equal(entries.g[:made], [g for _, g in given_])
    np.testing.assert_array_equal(entries.cost[:made], [-g for _, g in given_])
    np.testing.assert_array_equal(entries.node[:made], 7 * np.arange(made))
    np.testing.assert_array_equal(entries.link[:made], -1 - np.arange(made))
    np.testing.assert_array_equal(entries.bits[:made], np.arange(made) % 5)


@given(st.lists(ACTION, max_size=80), st.integers(1, 40))
@settings(max_examples=300, deadline=None)
def test_entries_are_taken_in_the_order_of_pythons_heap(actions, room):
    check(actions, room)


@given(st.lists(st.none() | st.tuples(FEW, FEW), max_size=80))
@settings(max_examples=300, deadline=None)
def test_ties_prefer_what_is_further_along_then_the_earlier(actions):
    check(actions, 1)


def test_many_entries_with_many_ties():
    rng = np.random.default_rng(0)
    entries = [(float(f), float(g)) for f, g in rng.integers(0, 4, (300, 2))]
    check(entries, 300)
    some = rng.random(1000) < 0.6
    mixed = [(float(f), float(g)) for f, g in rng.integers(0, 20, (1000, 2))]
    check([entry if add else None for entry, add in zip(mixed, some, strict=True)], 2)


@pytest.mark.parametrize("room", [1, 2, 3, 100])
def test_there_is_room_for_as_many_entries_as_were_asked_for(room):
    """Entries are not used again: taking one makes no room."""
    entries = queue(room)
    for k in range(room):
        assert called(has_room)(entries, room - k)
        assert not called(has_room)(entries, room - k + 1)
        called(push)(entries, 0.0, 0.0, 0.0, k, -1, 0)
        called(pop)(entries)
    assert not called(has_room)(entries, 1)
    assert called(has_room)(grown(entries), room)
