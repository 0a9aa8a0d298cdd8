"""A time limit on each test."""

import faulthandler
import os
import signal
from contextlib import contextmanager

MOST = float(os.environ.get("TEST_TIME_LIMIT", "900"))
"""Seconds that a test and what it sets up may take; the first of a run compiles machine code."""

AGES = 1e6
"""Seconds of a limit that is given in a test, and that no machine reaches, however busy it is."""


class TestTooLongError(AssertionError):
    """A test has taken longer than it may."""

    __test__ = False


@contextmanager
def time_limit(seconds):
    """End what runs inside with an error; code that does not return, with the whole process.

    Signals reach Python code alone. What hangs in machine code is ended half the time later, with
    a traceback of all threads.
    """
    if not hasattr(signal, "SIGALRM"):  # Windows
        yield
        return

    def end(number, frame):
        raise TestTooLongError(f"the test takes longer than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    faulthandler.dump_traceback_later(1.5 * seconds + 1.0, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
