"""Time limits: work is done in pieces that take little time, between which the clock is read."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager

PIECE = 0.02
"""Time that a piece of work is to take at most [s]."""


class OutOfTime(Exception):
    """A time limit is over. Searches catch it, and return what they have found."""


class Clock:
    """A deadline, on the clock of `time.perf_counter` [s], and how fast this machine works.

    How many items of a kind of work make a piece is learned from the time that pieces take. Without
    a deadline all is one piece, so results do not depend on the machine.
    """

    def __init__(self, deadline: float = math.inf) -> None:
        """Start with pieces of one item."""
        self.deadline = self._end = deadline
        self._length = deadline - time.perf_counter()
        self._sizes: dict[str, int] = {}

    @property
    def is_over(self) -> bool:
        """Whether the deadline is over."""
        return time.perf_counter() >= self.deadline

    def leave(self, seconds: float) -> None:
        """Bring the deadline forward to leave time for other work, at most half of the time."""
        self.deadline = self._end - min(seconds, 0.5 * self._length)

    def check(self) -> None:
        """Raise `OutOfTime` if the deadline is over."""
        if self.is_over:
            raise OutOfTime

    @contextmanager
    def piece(self, kind: str, most: int) -> Iterator[int]:
        """Time the block, which does as many items of a kind of work as it is told.

        Raises `OutOfTime` if the deadline is over.
        """
        if self.deadline == math.inf:
            yield most
            return
        self.check()
        size, began = self._sizes.get(kind, 1), time.perf_counter()
        yield min(size, most)
        spent = time.perf_counter() - began
        if spent > PIECE:
            self._sizes[kind] = max(min(size, most) // 2, 1)
        elif spent < PIECE / 2.0 and size <= most:
            self._sizes[kind] = 2 * size

    def pieces(self, kind: str, count: int) -> Iterator[slice]:
        """Yield the pieces of some items in order; raise `OutOfTime` at the deadline."""
        begin = 0
        while begin < count:
            with self.piece(kind, count - begin) as size:
                yield slice(begin, begin + size)
            begin += size


UNLIMITED = Clock()
"""The clock of work without a time limit."""
