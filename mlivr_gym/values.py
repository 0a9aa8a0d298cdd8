"""Bounds of what may come from a file or a caller, and the check of numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError, shortened

Triple = tuple[float, float, float]
"""Three numbers, such as a point."""

LONGEST = 1000.0
"""Largest coordinate or size in a map [m].

The whole of the ISS spans 109 m; a module given in millimetres is larger.
"""

LONGEST_ROBOT = 100.0
"""Largest length of a robot [m].

The longest arm flown is 17.6 m; an arm given in millimetres is longer.
"""

SMALLEST = 1e-9
"""Least size of a shape [m]: what rounding leaves of a coordinate of 1000 m is not much less."""

MOST_POINTS = 100_000
"""Most graspable points of a map; the JEM has 331."""

MOST_PARTS = 10_000
"""Most boxes, rails or racks in one list; a module has about a hundred."""

LONGEST_TEXT = 200
"""Most characters of a name."""


def numbers(
    value: object, shape: tuple[int, ...], where: str, error: type[MlivrError], most: float = np.inf
) -> Array:
    """Return `value` as an array if it holds finite numbers from `-most` to `most`.

    Parameters
    ----------
    value
        Numbers in sequences or an array.
    shape
        The shape it must have.
    where
        What it is, for the message.
    error
        Type of the error.
    most
        `LONGEST` or `LONGEST_ROBOT` for lengths [m], infinity for others.

    Raises
    ------
    MlivrError
        of the type `error`, naming the value.
    """
    kind = "a number, and finite" if shape == () else f"numbers of shape {shape}, all finite"
    try:
        array = np.array(value)
        # Whole numbers of more than 64 bits make an array of objects.
        found = array.astype(np.float64) if array.dtype.kind in "iufO" else None
    except (TypeError, ValueError, OverflowError):
        found = None  # rows of different lengths, no numbers, larger than every float
    if found is None or found.shape != shape:
        shape_found = f"has shape {found.shape}, " if found is not None and found.ndim else "is "
        raise error(f"{where} {shape_found}{shortened(value)}; it must be {kind}")
    wrong = ~(np.abs(found) <= most) | ~np.isfinite(found)
    if wrong.any():
        first = np.unravel_index(int(wrong.argmax()), shape)
        where += "".join(f"[{int(index)}]" for index in first)
        if not np.isfinite(found[first]):
            raise error(
                f"{where} is {shortened(array.item(first))}; it must be a number, and finite"
            )
        hint = "lengths are in metres: is this in millimetres?"
        raise error(f"{where} is {found[first]:g}, larger than {most:g} m; {hint}")
    return found


def unique(ids: Sequence[str], kind: str, error: type[MlivrError]) -> None:
    """Refuse ids of which one appears twice.

    Raises
    ------
    MlivrError
        of the type `error`, naming it.
    """
    seen: set[str] = set()
    for name in ids:
        if name in seen:
            raise error(f"{kind} {name!r} appears more than once")
        seen.add(name)


def triple(array: Array) -> Triple:
    """Three numbers from an array of shape (3,)."""
    x, y, z = array.tolist()
    return (x, y, z)
