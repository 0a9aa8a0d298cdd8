"""Bounds of the values in files and arguments."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError

Triple = tuple[float, float, float]
"""Three numbers, for example the coordinates of a point."""

MAX_LENGTH = 1000.0
"""Largest coordinate or size in a map [m].

The whole of the ISS spans 109 m; a module whose lengths are given in millimetres is larger.
"""

MAX_ROBOT_LENGTH = 100.0
"""Largest length of a robot [m].

The longest robot arm in space has 17.6 m; an arm whose lengths are given in millimetres is longer.
"""

MIN_SIZE = 1e-9
"""Smallest size of a shape [m], above the rounding error of a coordinate of 1000 m."""

MAX_POINTS = 100_000
"""Maximum number of graspable points of a map; the JEM has 331."""

MAX_PARTS = 10_000
"""Maximum number of boxes, rails or racks in one list; a module has about a hundred."""

MAX_TEXT_LENGTH = 200
"""Maximum number of characters of a name."""

MAX_REMARK_LENGTH = 4000
"""Maximum number of characters of a remark, or of the path of a file."""


def check_unique(ids: Sequence[str], kind: str, error: type[MlivrError]) -> None:
    """Check that no id appears twice.

    Raises an error of the given type, which names the first id that does.
    """
    seen: set[str] = set()
    for name in ids:
        if name in seen:
            raise error(f"{kind} {name!r} appears more than once")
        seen.add(name)


class EqualByData(ABC):
    """Equality of records that hold arrays: they are equal if their plain data are."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the record as plain data."""

    def __eq__(self, other: object) -> bool:
        """Return whether the other one is of the same type and has equal data."""
        return isinstance(other, type(self)) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        """Return a hash; equal records are shown by the same text."""
        return hash(repr(self))


def as_triple(array: Array) -> Triple:
    """Return the three numbers of an array of shape (3,)."""
    x, y, z = array.tolist()
    return (x, y, z)
