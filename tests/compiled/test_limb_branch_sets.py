"""Branch sets of limbs in one number against lists of branch sets."""

import numpy as np
import pytest
from compiled import called
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.compiled.limb_branch_sets import (
    after_move,
    branch_set_of,
    clear_bits,
    each_keeps_one,
    every_branch,
    has_bit,
    packed,
    set_before,
    set_bit,
    supports_of,
    unpacked,
)

BRANCH_SET = st.sampled_from([0, 1, 0x8000, 0xFFFF]) | st.integers(0, 0xFFFF)


@st.composite
def branch_sets_and_limb(draw):
    limbs = draw(st.integers(2, 4))
    return draw(st.lists(BRANCH_SET, min_size=limbs, max_size=limbs)), draw(
        st.integers(0, limbs - 1)
    )


@given(branch_sets_and_limb())
def test_a_number_holds_the_branch_sets_of_all_limbs(drawn):
    branch_sets, limb = drawn
    number = packed(np.array([branch_sets]))
    assert unpacked(number, len(branch_sets)).tolist() == [branch_sets]
    assert int(called(branch_set_of)(number[0], limb)) == branch_sets[limb]
    assert int(number[0]) & int(called(every_branch)(limb)) == branch_sets[limb] << 16 * limb


@given(branch_sets_and_limb())
def test_the_branch_sets_of_the_others_follow_in_order(drawn):
    branch_sets, limb = drawn
    limbs, number = len(branch_sets), packed(np.array([branch_sets]))[0]
    others = [branch_sets[(limb + 1 + k) % limbs] for k in range(limbs - 1)]
    held = np.uint64(called(supports_of)(number, limb, limbs))
    assert int(held) == sum(branch_set << 16 * k for k, branch_set in enumerate(others))
    assert called(each_keeps_one)(held, limbs) == all(others)
    moved = np.uint64(branch_sets[limb])
    assert int(called(after_move)(held, moved, limb, limbs)) == int(number)


@pytest.mark.parametrize("limbs", [3, 4])
def test_after_a_relabelling_the_others_are_the_same(limbs):
    branch_sets = np.random.default_rng(0).integers(0, 1 << 16, limbs)
    first = called(supports_of)(packed(branch_sets[None])[0], 1, limbs)
    turned = called(supports_of)(packed(np.roll(branch_sets, 1)[None])[0], 2 % limbs, limbs)
    assert int(first) == int(turned)


@given(st.sets(st.integers(0, 199)), st.sets(st.integers(0, 199)))
def test_bits_of_a_row_are_those_that_were_set(chosen, gone):
    """And those that were cleared are no longer."""
    row = np.zeros(4, dtype=np.uint64)
    for k in chosen:
        called(set_bit)(row, k)
    assert {k for k in range(200) if called(has_bit)(row, k)} == chosen
    assert sum(int(word) << 64 * i for i, word in enumerate(row)) == sum(1 << k for k in chosen)
    for k in range(200):
        assert called(set_before)(row, k) == len({c for c in chosen if k - k % 64 <= c < k})
    clear_bits(row, np.array(sorted(gone), dtype=np.int64))
    assert {k for k in range(200) if called(has_bit)(row, k)} == chosen - gone
