"""Parts of a table: in the order of their blocks, and not more than are needed."""

from concurrent.futures import ThreadPoolExecutor
from threading import Event

import pytest

from mlivr_gym.stances.parts import Parts

BLOCKS = [(k, 10 * k) for k in range(40)]


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
