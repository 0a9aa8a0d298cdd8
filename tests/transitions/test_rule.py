"""The rule of a step against its words, branch by branch."""

from hypothesis import example, given
from hypothesis import strategies as st

from mlivr_gym.transitions.rule import can_release, kept_on_edge

BRANCH_SET = st.integers(0, 0xFFFF)
"""Sets of branches and flips."""


def branches(branch_set):
    return {bit for bit in range(16) if branch_set >> bit & 1}


@given(BRANCH_SET, BRANCH_SET)
@example(1, 2)
@example(1 << 15, 1 << 15)
def test_a_limb_may_move_if_it_may_be_on_a_branch_on_which_it_can_be_released(
    branch_set, releasable
):
    assert can_release(branch_set, releasable) is bool(branches(branch_set) & branches(releasable))


@given(BRANCH_SET, BRANCH_SET)
@example(1, 2)
@example(1 << 15, 1 << 15)
def test_a_limb_that_holds_keeps_the_branches_that_it_may_be_on_and_the_edge_serves(
    branch_set, edge
):
    kept = kept_on_edge(branch_set, edge)
    assert branches(kept) == branches(branch_set) & branches(edge)
    assert kept <= 0xFFFF
