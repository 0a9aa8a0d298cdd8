"""Processes that share work: what they report, and that they stop when they are not needed."""

import time

import pytest
from shared_work import quick, slow

from mlivr_gym.stances.workers import Workers


@pytest.mark.parametrize("count", [1, 2])
def test_what_is_found_comes_in_order_and_shares_grow(count):
    shares = []
    with Workers(count, 2, shares.append) as workers:
        assert workers.run(quick, [(10,)] * count) == [10, 11][:count]
        assert workers.run(quick, [(20,)] * count) == [20, 21][:count]
    assert shares == sorted(shares)
    assert 0.5 <= shares[-1] <= 1.0


def test_processes_that_are_not_wanted_any_more_stop():
    def stop(_):
        raise KeyboardInterrupt

    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt), Workers(2, 1, stop) as workers:
        workers.run(slow, [()] * 2)
    assert time.monotonic() - began < 15.0
