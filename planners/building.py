"""Results that are computed once for many queries, in threads that outlast a query.

A query with a time limit waits for a result until its deadline. The thread goes on, and a later
query uses the result.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

from mlivr_gym.planners.clock import OutOfTime

T = TypeVar("T")


class _BackgroundWork(threading.Thread):
    """Some work in a daemon thread, which ends with the process."""

    def __init__(self, work: Callable[[], Any]) -> None:
        """Start the work."""
        super().__init__(daemon=True)
        self.work: Callable[[], Any] | None = work
        self.result: Any = None
        self.error: BaseException | None = None
        self.start()

    def run(self) -> None:
        """Do the work; the result or an error is stored for the thread that waits for it."""
        assert self.work is not None
        try:
            self.result = self.work()
        except BaseException as error:  # raised in the thread that waits for the result
            self.error = error
        self.work = None  # it may hold a graph, and the result may never be asked for


_running: dict[Hashable, _BackgroundWork] = {}
"""Threads that were started and whose result was not collected yet, by the key of the work."""


def result_by_deadline(key: Hashable, work: Callable[[], T], deadline: float) -> T:
    """Return the result of some work; raise `OutOfTime` if it is not done before a deadline.

    The work is identified by a key, and is done in this thread if the deadline, on the clock of
    `time.perf_counter` [s], is infinite, otherwise in a thread of its own. Raises what the work
    raises.
    """
    thread = _running.get(key)
    if thread is None and deadline == math.inf:
        return work()
    if thread is None:
        thread = _running[key] = _BackgroundWork(work)
    thread.join(None if deadline == math.inf else max(0.0, deadline - time.perf_counter()))
    if thread.is_alive():
        raise OutOfTime
    _running.pop(key, None)
    if thread.error is not None:
        raise thread.error
    found: T = thread.result
    return found
