"""Masks of limbs in one number against lists of masks."""

import numpy as np
import pytest
from compiled import called
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.compiled.limb_masks import (
    all_keep_one,
    beside,
    clear_bits,
    every_branch,
    has_bit,
    held_beside,
    mask_of,
    packed,
    set_before,
    set_bit,
    unpacked,
)

MASK = st.sampled_from([0, 1, 0x8000, 0xFFFF]) | st.integers(0, 0xFFFF)


@st.composite
def masks_and_limb(draw):
    limbs = draw(st.integers(2, 4))
    return draw(st.lists(MASK, min_size=limbs, max_size=limbs)), draw(st.integers(0, limbs - 1))


@given(masks_and_limb())
def test_a_number_holds_the_masks_of_all_limbs(drawn):
    masks, limb = drawn
    number = packed(np.array([masks]))
    assert unpacked(number, len(masks)).tolist() == [masks]
    assert int(called(mask_of)(number[0], limb)) == masks[limb]
    assert int(number[0]) & int(called(every_branch)(limb)) == masks[limb] << 16 * limb


@given(masks_and_limb())
def test_the_masks_of_the_others_follow_in_turn(drawn):
    masks, limb = drawn
    limbs, number = len(masks), packed(np.array([masks]))[0]
    others = [masks[(limb + 1 + k) % limbs] for k in range(limbs - 1)]
    held = np.uint64(called(held_beside)(number, limb, limbs))
    assert int(held) == sum(mask << 16 * k for k, mask in enumerate(others))
    assert called(all_keep_one)(held, limbs) == all(others)
    moved = np.uint64(masks[limb])
    assert int(called(beside)(held, moved, limb, limbs)) == int(number)


@pytest.mark.parametrize("limbs", [3, 4])
def test_after_a_turn_the_others_are_the_same(limbs):
    masks = np.random.default_rng(0).integers(0, 1 << 16, limbs)
    first = called(held_beside)(packed(masks[None])[0], 1, limbs)
    turned = called(held_beside)(packed(np.roll(masks, 1)[None])[0], 2 % limbs, limbs)
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
