"""How the command ends: its exit codes, and what an interruption does.

A compiled search runs for a minute without a look at signals, which Python handles only in
between. So `handle_interrupts` lets a thread wait for the signal too, which ends the process where
the main one does not answer.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from mlivr_gym.errors import MlivrError

SUCCESS, FAILED, REFUSED, NO_PLAN, INTERRUPTED = 0, 1, 2, 3, 130

EXIT_CODES = """exit codes:
  0    success
  1    a run that failed: a walk in the simulation, a relation of Table I
  2    wrong usage, or input that cannot be used
  3    no plan: there is none, the start cannot be held, or the limit was reached
  130  interrupted
"""

GRACE = 1.0
"""How long Python may take to come to an interruption [s] before the process is ended."""

LONG_GRACE = 60.0
"""The same where a checkpoint is to be written [s]."""


def print_interrupted(reason: str = "") -> None:
    """Print that the command was interrupted, in one line behind a progress bar."""
    start = "\r\033[K" if sys.stderr.isatty() else ""
    print(f"{start}mlivr-gym: {reason or 'interrupted'}", file=sys.stderr, flush=True)


@contextmanager
def handle_interrupts(grace: float = GRACE) -> Iterator[None]:
    """Let Ctrl-C end the process also while compiled code runs.

    Where Python comes to handle the signal, the block ends with a `KeyboardInterrupt`, also if a
    library made another error of it; else the process ends. Nothing changes outside the main
    thread, where somebody else handles or ignores the signal, and on Windows.

    Parameters
    ----------
    grace
        How long Python may take to come to it [s].
    """
    ours = threading.current_thread() is threading.main_thread() and sys.platform != "win32"
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    answered, interrupted = threading.Event(), False

    def answer(signum: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True
        answered.set()
        raise KeyboardInterrupt

    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    before = signal.signal(signal.SIGINT, answer)
    wakeup = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    watch = threading.Thread(target=_watch, args=(reader, answered, grace), daemon=True)
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
        os.close(writer)  # the thread reads the end of the pipe
        watch.join()
        os.close(reader)


def _watch(reader: int, answered: threading.Event, grace: float) -> None:
    """End the process if a signal that arrives on the pipe is not answered in time."""
    while signals := os.read(reader, 64):
        if signal.SIGINT in signals and not answered.wait(grace):
            with suppress(OSError):
                print_interrupted()
            os._exit(INTERRUPTED)
        answered.clear()
