"""Scratch that calls borrow: never the same for two at once."""

from mlivr_gym.compiled.records import Record
from mlivr_gym.compiled.scratch import ScratchPool


class Numbers(Record):
    """Scratch of a test."""

    count: int


def test_two_calls_at_once_have_scratch_of_their_own_and_later_ones_the_same_again():
    pool = ScratchPool(Numbers)
    with pool.borrowed() as one, pool.borrowed() as other:
        one(1)["count"], other(1)["count"] = 1, 2
        assert (one(1)["count"], other(1)["count"]) == (1, 2)
    with pool.borrowed() as again:
        assert again(1)["count"] in (1, 2)
