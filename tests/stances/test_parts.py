"""Parts of a table: in the order of their blocks, and not more than are needed."""

from concurrent.futures import ThreadPoolExecutor
from threading import Event
from time import sleep

import numpy as np
import pytest

from mlivr_gym.stances.parts import Parts

BLOCKS = [(k, 10 * k) for k in range(40)]


@pytest.mark.parametrize("threads", [1, 2])
def test_parts_come_in_the_order_of_their_blocks_and_shares_grow(threads):
    def work(number, value, added):
        sleep(0.01 * (number % 2))
        return [np.array([value + added])]

    shares = []
    found = Parts(None).of_blocks(work, BLOCKS, (1,), threads, shares.append)
    assert [part[0].item() for part in found] == [value + 1 for _, value in BLOCKS]
    assert shares == [(k + 1) / 40 for k in range(40)]


def test_threads_that_are_not_wanted_any_more_stop(monkeypatch):
    """All but the first wait until the pool is left."""
    left, shutdown = Event(), ThreadPoolExecutor.shutdown

    def work(number, _):
        done.append(number)
        if number > 0:
            left.wait()
        return []

    def leave(pool, *args, **options):
        left.set()
        shutdown(pool, *args, **options)

    def stop(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(ThreadPoolExecutor, "shutdown", leave)
    done = []
    with pytest.raises(KeyboardInterrupt):
        Parts(None).of_blocks(work, BLOCKS, (), 2, stop)
    assert len(done) <= 3
