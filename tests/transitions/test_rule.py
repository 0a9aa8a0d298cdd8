"""The rule of a step against its words, branch by branch."""

from hypothesis import example, given
from hypothesis import strategies as st

from mlivr_gym.transitions.rule import can_release, kept_on_edge, mask_of_grasp

ANSWER = st.integers(0, (1 << 45) - 1)
"""Answers of `release` and edge entries carry more above the sixteen bits of branches."""


def branches(mask):
    return {bit for bit in range(16) if mask >> bit & 1}


@given(ANSWER, ANSWER)
@example(1 << 20, 1 << 20)
def test_a_limb_may_move_if_it_may_be_on_a_branch_on_which_it_can_be_released(mask, answer):
    assert bool(can_release(mask, answer)) == bool(branches(mask) & branches(answer))


@given(ANSWER, ANSWER)
@example(1 << 20, 1 << 20)
def test_a_limb_that_holds_keeps_the_branches_that_it_may_be_on_and_the_edge_serves(mask, entry):
    kept = int(kept_on_edge(mask, entry))
    assert branches(kept) == branches(mask) & branches(entry)
    assert kept <= 0xFFFF


@given(ANSWER)
@example(1 << 20)
def test_a_limb_that_grasps_may_be_on_all_branches_on_which_it_can_be_released(answer):
    mask = int(mask_of_grasp(answer))
    assert branches(mask) == branches(answer)
    assert mask <= 0xFFFF
