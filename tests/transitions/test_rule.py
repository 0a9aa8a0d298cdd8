"""The rule of a step against its words, branch by branch."""

from hypothesis import example, given
from hypothesis import strategies as st

from mlivr_gym.transitions.rule import can_release, kept_on_edge

MASK = st.integers(0, 0xFFFF)
"""Sets of branches and flips."""


def branches(mask):
    return {bit for bit in range(16) if mask >> bit & 1}


@given(MASK, MASK)
@example(1, 2)
@example(1 << 15, 1 << 15)
def test_a_limb_may_move_if_it_may_be_on_a_branch_on_which_it_can_be_released(mask, releasable):
    assert can_release(mask, releasable) is bool(branches(mask) & branches(releasable))


@given(MASK, MASK)
@example(1, 2)
@example(1 << 15, 1 << 15)
def test_a_limb_that_holds_keeps_the_branches_that_it_may_be_on_and_the_edge_serves(mask, edge):
    kept = kept_on_edge(mask, edge)
    assert branches(kept) == branches(mask) & branches(edge)
    assert kept <= 0xFFFF
