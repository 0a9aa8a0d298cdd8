"""Sets as bits against sets of Python."""

import pytest
from compiled import called
from hypothesis import given, settings
from hypothesis import strategies as st

from mlivr_gym.compiled import bit_sets
from mlivr_gym.compiled.bit_sets import (
    ALL,
    BRANCHES,
    CLASSES,
    EMPTY,
    EVERY,
    LAST,
    NONE,
    bits_of,
)

ITEMS = st.integers(0, LAST + 20)
MASKS = st.integers(0, 0xFFFF)
BRANCH = st.integers(0, BRANCHES - 1)


def ours(name, *numbers):
    return called(getattr(bit_sets, name))(*numbers)


def members(branch_set):
    """Branch and flip of each bit of a set."""
    return {(bit % 8, bit // 8) for bit in range(16) if branch_set & 2**bit}


def of_class(choice):
    """Branches with the shoulder and wrist of a class, either elbow, both flips."""
    shoulder, wrist = divmod(choice, 2)
    return {(4 * shoulder + 2 * wrist + elbow, flip) for elbow in (0, 1) for flip in (0, 1)}


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


@given(MASKS, BRANCH)
@settings(deadline=None)
def test_sets_of_branches_and_flips(branch_set, branch):
    found = members(branch_set)
    assert [(bit % 8, bit // 8) for bit in bits_of(branch_set)] == sorted(
        found, key=lambda b: b[::-1]
    )
    both = {(branch, 0), (branch, 1)}
    assert members(ours("both_flips", branch)) == both
    assert ours("has_branch", branch_set, branch) == bool(found & both)
    assert members(ours("without_branch", branch_set, branch)) == found - both
    branches = {branch for branch, _ in found}
    assert members(ours("any_flip", branch_set)) == {(b, flip) for b in branches for flip in (0, 1)}


@pytest.mark.parametrize("choice", range(CLASSES))
def test_classes_of_branches(choice):
    branches = {branch for branch in range(BRANCHES) if ours("class_of", branch) == choice}
    assert members(ours("whole_class", choice)) == of_class(choice)
    assert branches == {branch for branch, _ in of_class(choice)}


def test_what_is_named_is_what_it_says():
    assert members(ALL) == {(branch, flip) for branch in range(8) for flip in (0, 1)}
    assert (EMPTY, NONE) == (0, -1)
