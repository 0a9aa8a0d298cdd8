"""The end of the command by Ctrl-C while it starts; `cli.exits` handles it later.

The imports of the command take a second, in which Python would print the lines of all imports
under way. So this module is the first that the package imports, and imports next to nothing.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from types import FrameType

INTERRUPTED = 130
"""Exit code of a command that was interrupted."""

MESSAGE = "mlivr-gym: interrupted"
"""What such a command prints if it has no more to say."""

CLEAR_LINE = "\r\033[K"
"""What removes a progress line from a terminal."""


def end_at_once(signum: int = signal.SIGINT, frame: FrameType | None = None) -> None:
    """End the process with one line, the handler of Ctrl-C of a command that starts or has ended.

    It writes around `sys.stderr`, which may be in use at that moment.
    """
    with suppress(OSError):
        start = CLEAR_LINE if os.isatty(2) else ""
        os.write(2, f"{start}{MESSAGE}\n".encode())
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


if is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    with suppress(ValueError):  # not the main thread
        signal.signal(signal.SIGINT, end_at_once)
