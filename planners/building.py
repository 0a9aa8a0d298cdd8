"""Tables that are built once for a robot on a map, in threads that outlast a query.

A query with a time limit waits for a table until its deadline. The thread goes on, and a later
query uses the result.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Hashable


class _BackgroundWork(threading.Thread):
    """Some work in a daemon thread, which ends with the process."""

    def __init__(self, work: Callable[[], object]) -> None:
        """Start the work."""
        super().__init__(daemon=True)
        self.work = work
        self.error: BaseException | None = None
        self.start()

    def run(self) -> None:
        """Do the work; an error is stored for the thread that waits for the result."""
        try:
            self.work()
        except BaseException as error:  # raised in the thread that waits for the result
            self.error = error


_running: dict[Hashable, _BackgroundWork] = {}
"""Threads that were started and whose result was not collected yet, by the key of the work."""


def complete_by_deadline(key: Hashable, work: Callable[[], object], deadline: float) -> bool:
    """Return whether some work, which stores its own result, is done before a deadline.

    The work is identified by a key, and is done in this thread if the deadline, on the clock of
    `time.perf_counter` [s], is infinite, otherwise in a thread of its own. Raises what the work
    raises.
    """
    thread = _running.get(key)
    if thread is None and deadline == math.inf:
        work()
        return True
    if thread is None:
        thread = _running[key] = _BackgroundWork(work)
    thread.join(None if deadline == math.inf else max(0.0, deadline - time.perf_counter()))
    if thread.is_alive():
        return False
    _running.pop(key, None)
    if thread.error is not None:
        raise thread.error
    return True
