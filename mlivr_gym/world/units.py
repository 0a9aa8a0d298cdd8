"""Units of map files, and maps in other units than metres that do not say so."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MapError, shortened
from mlivr_gym.schema import Choice, FieldPath, Fields, ListOf, Numbers, OrNone, Struct
from mlivr_gym.world.boxes import BOX_DATA, CORNERS, Boxes
from mlivr_gym.world.rails import Segment

METRES = {"m": 1.0, "mm": 0.001, "cm": 0.01, "in": 0.0254, "ft": 0.3048}
"""Metres per unit of length of a map file."""

UNIT_OF_LENGTH = Choice(tuple(METRES))
"""Unit of all lengths of a map file."""

FAR = 100.0
"""Coordinate, or length of a rail, above which a map may be in another unit [m].

The ISS, 109 m long, reaches half as far from its middle.
"""

SPARSE = 2.4
"""Distance of a point from its nearest neighbour above which a map may be in another unit [m].

It is the span of the robots with UR5e limbs.
"""

LARGE = 50.0
"""Extent of the points of a map, along an axis, above which its unit is asked for [m]."""

OTHERS = ", ".join(repr(unit) for unit in METRES if unit != "m")
QUESTION = f"which looks like another unit: give the unit, one of {OTHERS}, or 'm' for metres"
"""End of the message about a map that does not say its unit."""


def metres_per_unit(data: Any, place: FieldPath) -> float:
    """Return the length of the unit of plain data of a map [m]; 1 if they do not name it."""
    if not isinstance(data, dict) or "unit" not in data:
        return 1.0
    return METRES[UNIT_OF_LENGTH.read(data["unit"], place.field("unit"))]


def with_unit(data: Any, unit: str | None, place: FieldPath) -> Any:
    """Return plain data of a map in a unit that a caller gives, by default in their own.

    Raises an error of the type of `place` if they name another one.
    """
    if unit is None or not isinstance(data, dict):
        return data
    if data.get("unit", unit) != unit:
        raise place.field("unit").fault(f"is {data['unit']!r} in the file, but {unit!r} is given")
    return data | {"unit": unit}


@contextmanager
def told_in_metres(data: Any) -> Iterator[None]:
    """Let errors about lengths say that they are in metres, if the data have another unit."""
    try:
        yield
    except MapError as fault:
        unit = data.get("unit", "m") if isinstance(data, dict) else "m"
        if unit == "m" or not re.search(r"\d m\b", str(fault)):
            raise
        raise MapError(
            f"{fault}; these are metres: in {unit}, the unit of the map, the numbers are "
            f"{1.0 / METRES[unit]:g} times as large"
        ) from None


def in_metres(kind: Any, data: Any, metres: float) -> Any:
    """Return plain data with the lengths [m] that `kind` will read, given in a unit of `metres`.

    What is no length stays as it is, for `kind` to refuse.
    """
    match kind, data:
        case (Struct(), dict()):
            return in_metres(kind.fields, data, metres)
        case (Fields(), dict()):
            parts = {**kind.required, **kind.optional}
            return {name: in_metres(parts.get(name), v, metres) for name, v in data.items()}
        case (ListOf(), list() | tuple()):
            return [in_metres(kind.kind, entry, metres) for entry in data]
        case (Boxes(), list() | tuple()):
            parts = {**CORNERS.required, **BOX_DATA.validators}
            return [in_metres(Fields(parts), entry, metres) for entry in data]
        case (OrNone(), _):
            return in_metres(kind.kind, data, metres)
        case (Numbers(unit="m"), _):
            return _scaled(data, metres)
    return data


def _scaled(value: Any, factor: float, deep: int = 3) -> Any:
    """Return a number, or those of lists up to `deep` in one another, times a factor.

    Anything else is left.
    """
    if deep and isinstance(value, list | tuple):
        return [_scaled(entry, factor, deep - 1) for entry in value]
    if isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
        return value * factor
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return float(value) * factor if is_number and abs(value) < 1e300 else value


def check_rails(segments: Sequence[Segment], place: FieldPath) -> None:
    """Refuse rails that are longer than any structure in space, of a map that names no unit."""
    for k, segment in enumerate(segments):
        length = float(np.linalg.norm(np.subtract(segment.end, segment.start)))
        if length > FAR:
            raise place.field("segments").entry(k).fault(f"is {length:g} m long, {QUESTION}")


def check_points(positions: Array, name: str) -> None:
    """Refuse points that are far from the origin and from each other, of a map that names no unit.

    Raises a `MapError` if a coordinate is above `FAR`, and the median of the distances of the
    points, shape (m, 3) [m], from their nearest neighbours is above `SPARSE`. A map with a name
    that is otherwise larger than `LARGE` is used, with a warning.
    """
    farthest = float(np.abs(positions).max(initial=0.0))
    if farthest > FAR:
        from scipy.spatial import cKDTree

        apart = np.median(cKDTree(positions).query(positions, 2)[0][:, 1])
        if apart > SPARSE:
            alone = len(positions) == 1
            how = "there is one point" if alone else f"points lie {apart:g} m apart in the median"
            raise MapError(f"{how}, and a coordinate is {farthest:g} m, {QUESTION}")
    extent = float(np.ptp(positions, axis=0).max())
    if extent > LARGE:
        logging.getLogger(__name__).warning(
            "map %s is %g m long; if its lengths are not in metres, give its unit, one of %s",
            shortened(name), extent, OTHERS,
        )  # fmt: skip
