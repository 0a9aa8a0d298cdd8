"""Exit codes of the command, and how it handles an interruption by Ctrl-C.

Python handles signals between its own instructions only, while a compiled search may run for a
minute. Hence `handle_interrupts` has a second thread that waits for the signal and ends the
process if the main thread does not respond in time.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from mlivr_gym._interrupts import CLEAR_LINE, end_at_once
from mlivr_gym.errors import MlivrError

SUCCESS, FAILED, REFUSED, NO_PLAN = 0, 1, 2, 3

EXIT_CODES = """exit codes:
  0    success
  1    the run failed: a plan failed in simulation, a relation of Table I does not hold, a
       table could not be stored, or `doctor` found that a requirement is missing
  2    wrong usage or invalid input
  3    no plan: none exists, the start cannot be held, or the limit was reached
  130  interrupted
"""

GRACE = 1.0
"""Time that Python may take to respond to an interruption before the process is ended [s]."""

LONG_GRACE = 60.0
"""The same for commands that write a checkpoint when they are interrupted [s]."""


def print_interrupted(reason: str = "") -> None:
    """Print that the command was interrupted, in place of a progress line on a terminal."""
    start = CLEAR_LINE if sys.stderr.isatty() else ""
    print(f"{start}mlivr-gym: {reason or 'interrupted'}", file=sys.stderr, flush=True)


@contextmanager
def handle_interrupts(grace: float = GRACE) -> Iterator[None]:
    """Let Ctrl-C end the process even while compiled code runs.

    If Python responds to the signal within `grace` seconds, the block ends with a
    `KeyboardInterrupt`, even if a library turned it into another error; otherwise the process
    ends. So it does where Python would print the interruption and go on, as in a callback. Nothing
    changes outside the main thread, on Windows, or if the signal is already handled or ignored by
    other code.
    """
    is_main = threading.current_thread() is threading.main_thread() and sys.platform != "win32"
    if not is_main or signal.getsignal(signal.SIGINT) not in (
        signal.default_int_handler, end_at_once,
    ):  # fmt: skip
        yield
        return
    handled, interrupted = threading.Event(), False

    def interrupt(signum: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True
        handled.set()
        raise KeyboardInterrupt

    def unraisable(found: Any) -> None:
        if issubclass(found.exc_type, KeyboardInterrupt):
            end_at_once()
        hook(found)

    hook = sys.unraisablehook
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    before, sys.unraisablehook = signal.signal(signal.SIGINT, interrupt), unraisable
    wakeup = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    watch = threading.Thread(target=_watch, args=(reader, handled, grace), daemon=True)
    watch.start()
    try:
        yield
    except Exception as error:
        if interrupted and not isinstance(error, MlivrError):
            raise KeyboardInterrupt from error
        raise
    finally:
        signal.set_wakeup_fd(wakeup)
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = hook
        os.close(writer)  # ends the thread, which then reads the end of the pipe
        watch.join()
        os.close(reader)


def _watch(reader: int, handled: threading.Event, grace: float) -> None:
    """End the process if a signal that arrives on the pipe is not handled in time."""
    while signals := os.read(reader, 64):
        if signal.SIGINT in signals and not handled.wait(grace):
            end_at_once()
        handled.clear()
