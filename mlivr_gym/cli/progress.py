"""Progress of a command, shown on standard error.

On a terminal one line is redrawn; elsewhere, as in a log, a new line is written from time to time.
Work that takes less than two seconds shows nothing.
"""

from __future__ import annotations

import sys
import threading
import time

from mlivr_gym.compiled.compiling import compilation, displays

SHOW_AFTER = 2.0
"""Time after which progress is first shown [s]."""

LOG_INTERVAL = 60.0
"""Maximum time between two lines of a log [s]; until then the interval doubles."""

REDRAW_INTERVAL = 0.2
"""Minimum time between two updates of the line on a terminal [s]."""

WIDTH = 24
"""Width of a progress bar in characters."""


class Progress:
    """Display of what a command is doing, for how long, and how much of it is done.

    Inside its `with` block a thread updates the time, so that work without calls of `show` is
    displayed, too:

        with Progress("building the stance graph"):
            graph = stance_graph()
    """

    def __init__(self, what: str, total: int | None = None, quiet: bool = False) -> None:
        """Start the clock of a phase: `what` names the work or what is counted, up to `total`."""
        self._quiet = quiet
        self._has_line, self._drawn_at, self._ended = False, 0.0, threading.Event()
        self._lock = threading.Lock()
        self.begin(what, total)

    def begin(self, what: str, total: int | None = None) -> None:
        """Start the clock of another phase of work."""
        self.what, self._total, self._done, self._remark = what, total, 0, ""
        self._began = time.perf_counter()
        self._next = SHOW_AFTER

    def show(self, done: int, remark: str = "") -> None:
        """Display how many are done, with a remark."""
        self._done, self._remark = done, remark
        self._update()

    def __enter__(self) -> Progress:
        """Start the thread that updates the time."""
        displays.append(self)
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Clear the line."""
        self._ended.set()
        self._thread.join()
        displays.remove(self)
        with self._lock:
            if self._has_line:
                print("\r\033[K", end="", file=sys.stderr, flush=True)

    def _watch(self) -> None:
        while not self._ended.wait(0.5):
            self._update()

    def _update(self) -> None:
        """Redraw the line of a terminal, or write a line to a log, if enough time has passed."""
        now = time.perf_counter()
        spent = now - self._began
        if self._quiet or spent < SHOW_AFTER:
            return
        with self._lock:
            if sys.stderr.isatty():
                if now - self._drawn_at >= REDRAW_INTERVAL:
                    self._drawn_at, self._has_line = now, True
                    print(f"\r\033[K{self._text(spent)}", end="", file=sys.stderr, flush=True)
            elif spent >= self._next:
                self._next = spent + min(spent, LOG_INTERVAL)
                print(self._text(spent), file=sys.stderr, flush=True)

    def _text(self, spent: float) -> str:
        """Return the line, with an estimate of the remaining time if the total is known."""
        text, remaining = f"{self._done} {self.what}" if self._done else self.what, ""
        if self._total is not None:
            bar = "#" * int(WIDTH * self._done / max(self._total, 1))
            text = f"{self.what} [{bar:.<{WIDTH}}] {self._done}/{self._total}"
            if self._done:
                remaining = f", {spent * (self._total - self._done) / self._done:.0f} s remain"
        remarks = "".join(f"; {one}" for one in (self._remark, compilation.text) if one)
        return f"{text}, {spent:.0f} s{remaining}{remarks}"
