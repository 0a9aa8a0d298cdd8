"""Scratch of kernels that is reused, since to have so much memory cleared takes milliseconds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from mlivr_gym.compiled.kernels import MOST_THREADS
from mlivr_gym.compiled.records import Record


class ScratchPool:
    """Rows of scratch of one kind, a row for each thread, which calls borrow in turn."""

    def __init__(self, kind: type[Record]) -> None:
        """Start with none."""
        self._kind = kind
        self._idle: list[Any] = []

    @contextmanager
    def borrowed(self) -> Iterator[Callable[[int], Any]]:
        """Lend rows to one call of `in_parallel`, as its `scratch_rows`.

        After an error they are not used again, since another thread may still write into them.
        """
        try:  # not by asking first: another thread may take the last
            rows = self._idle.pop()
        except IndexError:
            rows = self._kind.rows(MOST_THREADS)
        yield lambda used: rows[:used]
        self._idle.append(rows)
