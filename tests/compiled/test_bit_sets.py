"""Sets as bits against sets of Python."""

from compiled import called
from hypothesis import given, settings
from hypothesis import strategies as st

from mlivr_gym.compiled import bit_sets
from mlivr_gym.compiled.bit_sets import EMPTY, EVERY, LAST

ITEMS = st.integers(0, LAST + 20)


def ours(name, *numbers):
    return called(getattr(bit_sets, name))(*numbers)


@given(ITEMS, ITEMS)
@settings(deadline=None)
def test_items_are_told_apart_as_far_as_there_are_bits(k, other):
    same = min(k, LAST) == min(other, LAST)
    assert ours("has", ours("only", k), other) == same
    assert ours("has", EVERY, k)
    assert not ours("has", EMPTY, k)
    # What shares a bit with an item before `k` is below it too.
    below = other < k or k > LAST
    assert ours("has", ours("below", k), other) == below
