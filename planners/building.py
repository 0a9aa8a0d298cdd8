"""Work that is done once for a robot on a map, and outlasts the query that asked for it.

A query with a time limit waits for such work no longer than it may. The work goes on in a thread,
and the next query finds what it has come to.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Hashable


class _Work(threading.Thread):
    """Some work in a thread, which ends with the process."""

    def __init__(self, work: Callable[[], object]) -> None:
        """Begin."""
        super().__init__(daemon=True)
        self.work = work
        self.error: BaseException | None = None
        self.start()

    def run(self) -> None:
        """Do it; an error is kept for those who wait."""
        try:
            self.work()
        except BaseException as error:  # it is raised where the result is waited for
            self.error = error


_begun: dict[Hashable, _Work] = {}
"""Work that was begun and not yet found done, by what it is for."""


def finished(what: Hashable, work: Callable[[], object], until: float) -> bool:
    """Whether some work, which keeps its result itself, is done before a time.

    Parameters
    ----------
    what
        What tells it from other work: the same is not begun twice.
    work
        Called once; where the time is unlimited here, else in a thread.
    until
        When to stop waiting, as `time.perf_counter` counts [s]; infinite for never.

    Raises
    ------
    BaseException
        What the work raises.
    """
    if until == math.inf and what not in _begun:
        work()
        return True
    if what not in _begun:
        _begun[what] = _Work(work)
    thread = _begun[what]
    thread.join(None if until == math.inf else max(0.0, until - time.perf_counter()))
    if thread.is_alive():
        return False
    _begun.pop(what, None)
    if thread.error is not None:
        raise thread.error
    return True
