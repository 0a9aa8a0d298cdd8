"""Progress on a terminal; nothing is shown elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable


def counter(what: str) -> Callable[[int], None]:
    """A callback that shows a count, and clears it when called with -1."""

    def show(count: int) -> None:
        if sys.stderr.isatty():
            line = "\r\033[K" if count < 0 else f"\r{count} {what}"
            print(line, end="", file=sys.stderr, flush=True)

    return show


def timed_bar(what: str) -> Callable[[int, int, str], None]:
    """A bar with the time spent and the time remaining [s].

    Call it with what is done, all there is, and a remark.
    """
    began = time.perf_counter()

    def show(done: int, total: int, remark: str = "") -> None:
        if sys.stderr.isatty():
            filled, spent = int(24 * done / max(total, 1)), time.perf_counter() - began
            remaining = spent * (total - done) / max(done, 1)
            bar = "#" * filled + "." * (24 - filled)
            line = f"{what} [{bar}] {done}/{total} {spent:.0f}<{remaining:.0f} s {remark}"
            print(f"\r\033[K{line}", end="\n" if done >= total else "", file=sys.stderr, flush=True)

    return show


class Bar:
    """A bar that is cleared at the end."""

    def __init__(self, what: str, total: int) -> None:
        """Count to `total`."""
        self._what, self._total = what, total
        self.show(0)

    def show(self, done: int) -> None:
        """Show how many are done."""
        if sys.stderr.isatty():
            filled = round(30 * done / self._total)
            line = f"[{'#' * filled}{'.' * (30 - filled)}] {done}/{self._total} {self._what}"
            print(f"\r\033[K{line}", end="", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Clear it."""
        if sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr, flush=True)
