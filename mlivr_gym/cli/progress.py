"""How far a command is, told on standard error.

On a terminal one line is drawn anew; elsewhere, as in a log, a line is written now and then. What
takes less than two seconds says nothing.
"""

from __future__ import annotations

import sys
import threading
import time

from mlivr_gym.compiled.warming import is_showing

SHOW_AFTER = 2.0
"""What takes less says nothing [s]."""

LOG_INTERVAL = 60.0
"""How long a log hears nothing at most [s]; at first the time doubles from line to line."""

REDRAW_INTERVAL = 0.2
"""How often a line on a terminal is drawn anew at most [s]."""

WIDTH = 24
"""Characters of a bar."""

PER_CENT = 100
"""Total of what is told by shares."""


class Progress:
    """What a command is doing, for how long, and how far it is.

    While it is entered a thread looks at the clock, so that also what never calls `show` is told:

        with Progress("making the stance graph"):
            graph = stance_graph()
    """

    def __init__(self, what: str, total: int | None = None, quiet: bool = False) -> None:
        """Begin.

        Parameters
        ----------
        what
            What is done or counted.
        total
            How many there are, if that is known.
        quiet
            Whether nothing is to be told.
        """
        self._quiet = quiet
        self._line, self._told, self._ended = False, 0.0, threading.Event()
        self._lock = threading.Lock()
        self.begin(what, total)

    def begin(self, what: str, total: int | None = None) -> None:
        """Begin something else."""
        self.what, self._total, self._done, self._remark = what, total, 0, ""
        self._began = time.perf_counter()
        self._next = SHOW_AFTER

    def show_share(self, done: float) -> None:
        """Tell which share of a total of `PER_CENT` is done."""
        self.show(int(PER_CENT * done))

    def show(self, done: int, remark: str = "") -> None:
        """Tell how many are done, and something about them."""
        self._done, self._remark = done, remark
        self._tell()

    def __enter__(self) -> Progress:
        """Look at the clock from now on."""
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Clear the line."""
        self._ended.set()
        self._thread.join()
        with self._lock:
            if self._line:
                print("\r\033[K", end="", file=sys.stderr, flush=True)

    def _watch(self) -> None:
        while not self._ended.wait(0.5):
            self._tell()

    def _tell(self) -> None:
        """Draw the line, or write one, if it is time."""
        now = time.perf_counter()
        spent = now - self._began
        if self._quiet or spent < SHOW_AFTER:
            return
        with self._lock:
            if sys.stderr.isatty():
                if now - self._told >= REDRAW_INTERVAL and not is_showing():
                    self._told, self._line = now, True
                    print(f"\r\033[K{self._text(spent)}", end="", file=sys.stderr, flush=True)
            elif spent >= self._next:
                self._next = spent + min(spent, LOG_INTERVAL)
                print(self._text(spent), file=sys.stderr, flush=True)

    def _text(self, spent: float) -> str:
        """The line, with the time that remains if that can be told."""
        told, remaining = f"{self._done} {self.what}" if self._done else self.what, ""
        if self._total is not None:
            bar = "#" * int(WIDTH * self._done / max(self._total, 1))
            told = f"{self.what} [{bar:.<{WIDTH}}] {self._done}/{self._total}"
            if self._done:
                remaining = f", {spent * (self._total - self._done) / self._done:.0f} s remain"
        return f"{told}, {spent:.0f} s{remaining}" + (f"; {self._remark}" if self._remark else "")
