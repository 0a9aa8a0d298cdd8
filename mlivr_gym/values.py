"""Checks of single values that come from a file or a caller: numbers, lengths, names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError, shown

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

ROTATION_TOLERANCE = 1e-5
"""Largest deviation of a rotation matrix times its transpose from the unit matrix."""

MOST_POINTS = 100_000
"""Most graspable points of a map; the JEM has 331."""

MOST_PARTS = 10_000
"""Most boxes, rails or racks in one list; a module has about a hundred."""

LONGEST_TEXT = 200
"""Most characters of a name."""


def text(value: object, where: str, error: type[MlivrError]) -> str:
    """Return `value` if it can be a name: printable text, not empty.

    Raises:
        MlivrError: of the type `error`, naming the value. Half of a surrogate pair, for example,
            could not be written.
    """
    if (
        not isinstance(value, str)
        or not value
        or not value.isprintable()
        or len(value) > LONGEST_TEXT
    ):
        kind = f"a text of 1 to {LONGEST_TEXT} printable characters"
        raise error(f"{where} is {shown(value)}; it must be {kind}")
    return value


def number(value: object, where: str, error: type[MlivrError], most: float = np.inf) -> float:
    """Return `value` as a float if it is a finite number from `-most` to `most`; see `numbers`."""
    return float(numbers(value, (), where, error, most))


def numbers(
    value: object, shape: tuple[int, ...], where: str, error: type[MlivrError], most: float = np.inf
) -> Array:
    """Return `value` as an array if it holds finite numbers from `-most` to `most`.

    Args:
        value: Numbers in sequences or an array.
        shape: The shape it must have.
        where: What it is, for the message.
        error: Type of the error.
        most: `LONGEST` or `LONGEST_ROBOT` for lengths [m], infinity for others.

    Raises:
        MlivrError: of the type `error`, naming the value.
    """
    kind = "a number, and finite" if shape == () else f"numbers of shape {shape}, all finite"
    try:
        array = np.array(value)
        # Whole numbers of more than 64 bits make an array of objects.
        found = array.astype(np.float64) if array.dtype.kind in "iufO" else np.array(np.nan)
    except (TypeError, ValueError, OverflowError):
        # Rows of different lengths, no numbers, larger than every float.
        found = np.array(np.nan)
    if found.ndim and found.shape != shape:
        raise error(f"{where} has shape {found.shape}, {shown(value)}; it must be {kind}")
    if found.shape != shape or not np.isfinite(found).all():
        raise error(f"{where} is {shown(value)}; it must be {kind}")
    if (np.abs(found) > most).any():
        hint = "lengths are in metres: is this in millimetres?"
        raise error(f"{where} is {shown(value)}, larger than {most:g} m; {hint}")
    return found


def rotation(value: object, where: str, error: type[MlivrError]) -> Array:
    """Return `value` as an array of shape (3, 3) if it is a right-handed rotation matrix.

    Raises:
        MlivrError: of the type `error`, naming what it is.
    """
    found = numbers(value, (3, 3), where, error)
    turned = np.clip(found, -2.0, 2.0)  # squares of huge numbers would overflow
    if (
        np.abs(turned.T @ turned - np.eye(3)).max() > ROTATION_TOLERANCE
        or np.linalg.det(turned) < 0.0
    ):
        raise error(f"{where} must be a right-handed rotation matrix")
    return found


def whole(value: Any, where: str, error: type[MlivrError], least: int, most: int) -> int:
    """Return `value` as an int if it is a whole number from `least` to `most`.

    Raises:
        MlivrError: of the type `error`, naming the value.
    """
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, np.integer))
        or not least <= value <= most
    ):
        raise error(f"{where} is {shown(value)}; it must be a whole number from {least} to {most}")
    return int(value)


def entries(
    value: object, where: str, error: type[MlivrError], most: int = MOST_PARTS
) -> list[Any]:
    """Return `value` as a list if it is one of at most `most` entries.

    Raises:
        MlivrError: of the type `error`.
    """
    if not isinstance(value, (list, tuple, np.ndarray)):
        raise error(f"{where} must be a list, not {shown(value)}")
    if len(value) > most:
        raise error(f"{where} has {len(value)} entries; at most {most} are taken")
    return list(value)


def unique(ids: Sequence[str], kind: str, error: type[MlivrError]) -> None:
    """Refuse ids of which one appears twice.

    Raises:
        MlivrError: of the type `error`, naming it.
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
