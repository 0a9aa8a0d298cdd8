"""The end of the command by Ctrl-C, whatever it is doing.

Python handles signals between its own instructions only, while a compiled search may run for a
minute, and in the second that its imports take it would print the lines of all that are under way.
So a command blocks the signal, for its threads and for the processes that it starts, and a thread
waits for it. This module is the first that the package imports, and imports next to nothing.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from contextlib import suppress
from types import FrameType
from typing import Any

INTERRUPTED = 130
"""Exit code of a command that was interrupted."""

CLEAR_LINE = "\r\033[K"
"""What removes a progress line from a terminal."""

INTERRUPT = getattr(signal, "SIGUSR1", None)
"""Signal by which the thread that waits for Ctrl-C interrupts the main one."""

_responded = threading.Event()
"""Set when the main thread was interrupted."""

_grace = 0.0
"""Time that the main thread has to respond to Ctrl-C [s]."""


def set_grace(seconds: float) -> None:
    """Give the main thread time to respond with a `KeyboardInterrupt` [s]; 0 ends it at once."""
    global _grace
    _grace = seconds


def watch() -> None:
    """Let Ctrl-C interrupt the main thread, and end the process if that does not respond in time.

    Nothing changes on Windows, or if the signal is handled or ignored by other code.
    """
    handler = signal.getsignal(signal.SIGINT)
    if INTERRUPT is not None and handler is signal.default_int_handler:
        signal.signal(INTERRUPT, _interrupt)
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        sys.unraisablehook = _unraisable
        threading.Thread(target=_wait, daemon=True).start()


def _interrupt(signum: int, frame: FrameType | None) -> None:
    _responded.set()
    raise KeyboardInterrupt


def was_interrupted() -> bool:
    """Return whether the main thread was interrupted, whatever a library made of it."""
    return _responded.is_set()


def _unraisable(found: Any) -> None:
    """End the process where Python would print the interruption and go on, as in a callback."""
    if issubclass(found.exc_type, KeyboardInterrupt):
        _end()
    sys.__unraisablehook__(found)


def _wait() -> None:
    while signal.sigwait({signal.SIGINT}):
        _responded.clear()
        if _grace:
            signal.pthread_kill(threading.main_thread().ident or 0, INTERRUPT or 0)
        if not _responded.wait(_grace):
            _end()


def _end() -> None:
    """Say that the command was interrupted, and end the process."""
    with suppress(OSError):  # around `sys.stderr`, which may be in use at that moment
        start = CLEAR_LINE if os.isatty(2) else ""
        os.write(2, f"{start}mlivr-gym: interrupted\n".encode())
    os._exit(INTERRUPTED)


def silence() -> None:
    """Print nothing more, once the interruption was told.

    Threads and libraries that were interrupted may print when Python ends.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def is_command() -> bool:
    """Return whether this process is `mlivr-gym` or `python -m mlivr_gym`, and none of its workers.

    The processes of a pool have the arguments of the command, too, but were not started with them.
    """
    program = sys.orig_argv[-len(sys.argv) :][:1]
    return bool(program) and os.path.basename(program[0]).split(".")[0] in (
        "mlivr-gym", "mlivr_gym",
    )  # fmt: skip


if is_command():
    watch()
