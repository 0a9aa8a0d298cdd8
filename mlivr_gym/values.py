"""Bounds of the values in files and arguments, and the check that values are finite numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError, shortened

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


def read_numbers(
    value: object, shape: tuple[int, ...], where: str, error: type[MlivrError], most: float = np.inf
) -> Array:
    """Return a value as an array, if it holds finite numbers of the given shape.

    It is an array, a number, or nested sequences of numbers of a magnitude of at most `most`:
    `MAX_LENGTH` or `MAX_ROBOT_LENGTH` for lengths [m], infinity for others. Raises an error of the
    given type, whose message begins with `where`, what the value is.
    """
    kind = "a finite number" if shape == () else f"finite numbers of shape {shape}"
    try:
        array = np.array(value)
        # Integers of more than 64 bits give an array of objects.
        found = array.astype(np.float64) if array.dtype.kind in "iufO" else None
    except (TypeError, ValueError, OverflowError):
        found = None  # rows of different lengths, not numbers, larger than every float
    if found is None or found.shape != shape:
        shape_found = f"has shape {found.shape}, " if found is not None and found.ndim else "is "
        raise error(f"{where} {shape_found}{shortened(value)}; it must be {kind}")
    wrong = ~(np.abs(found) <= most) | ~np.isfinite(found)
    if wrong.any():
        first = np.unravel_index(int(wrong.argmax()), shape)
        where += "".join(f"[{int(index)}]" for index in first)
        if not np.isfinite(found[first]):
            raise error(f"{where} is {shortened(array.item(first))}; it must be a finite number")
        hint = "lengths are in metres: is this in millimetres?"
        raise error(f"{where} is {found[first]:g}, larger than {most:g} m; {hint}")
    return found


def check_unique(ids: Sequence[str], kind: str, error: type[MlivrError]) -> None:
    """Check that no id appears twice.

    Raises
    ------
    MlivrError
        An error of the given type, which names the first id that does.
    """
    seen: set[str] = set()
    for name in ids:
        if name in seen:
            raise error(f"{kind} {name!r} appears more than once")
        seen.add(name)


def as_triple(array: Array) -> Triple:
    """Return the three numbers of an array of shape (3,)."""
    x, y, z = array.tolist()
    return (x, y, z)
