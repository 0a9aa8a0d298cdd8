"""Entries of a map file, each checked: points, segments with their points, and handrails."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MapError, SettingError, shown
from mlivr_gym.values import LONGEST, MOST_POINTS, number, numbers, rotation, text
from mlivr_gym.world.rails import Handrail, Segment

FACES = ("deck", "forward", "aft", "overhead", "starboard", "port")
"""Names of the cabin's six faces."""

UNIT_TOLERANCE = 1e-6
"""Largest deviation of a unit vector's length, and of its right angles, from 1 and 0."""

Row = tuple[str, str, Array, Array, float]
"""Id, face, position and rotation in the map's frame, width of the rail across [m]."""


def check_point(point: str, face: str, position: Array, turn: Array) -> None:
    """Refuse a point whose id, face, position or rotation is faulty."""
    text(point, "the id of a point", MapError)
    if face not in FACES:
        raise MapError(
            f"point {point!r}: unknown face {shown(face)}; valid faces are {', '.join(FACES)}"
        )
    numbers(position, (3,), f"point {point!r}: position", MapError, LONGEST)
    rotation(turn, f"point {point!r}: rotation", MapError)


def _frame(where: str, rail: Array, normal: Array) -> Array:
    length = float(np.linalg.norm(normal))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise MapError(f"{where}: normal {normal.tolist()} has length {length:.6g}; it must be 1")
    if not np.linalg.norm(rail) > 1e-9:
        raise MapError(f"{where}: the rail has no direction")
    rail = rail / np.linalg.norm(rail)
    if abs(float(rail @ normal)) > UNIT_TOLERANCE:
        raise MapError(f"{where}: the rail must be at right angles to normal {normal.tolist()}")
    return np.column_stack([rail, np.cross(normal, rail), normal])


def discretise(segment: Segment, spacing: float, room: int) -> list[Row]:
    """Points at multiples of `spacing` [m] from the segment's middle, about `room` at most."""
    start, end = np.array(segment.start), np.array(segment.end)
    length = float(np.linalg.norm(end - start))
    frame = _frame(f"segment {segment.id!r}", end - start, np.array(segment.normal))
    if length > spacing * room:
        raise MapError(
            f"segment {segment.id!r} of {length:g} m has too many points {spacing:g} m apart: "
            f"a map has at most {MOST_POINTS}; take a larger spacing"
        )
    half = int(np.floor(0.5 * length / spacing + 1e-9))
    middle = 0.5 * (start + end)
    return [
        (
            f"{segment.id}:{k + half}",
            segment.face,
            middle + k * spacing * frame[:, 0],
            frame,
            segment.width,
        )
        for k in range(-half, half + 1)
    ]


def clear_of_handrails(
    rows: list[Row], handrails: tuple[Handrail, ...], clearance: float
) -> list[Row]:
    """Points whose rail keeps `clearance` [m] from the footprint of each handrail on the face."""
    if not rows:
        return []
    faces, positions = np.array([row[1] for row in rows]), np.array([row[2] for row in rows])
    frames, width = np.array([row[3] for row in rows]), np.array([row[4] for row in rows])
    reach = clearance + 0.5 * width[:, None] * np.abs(frames[:, :, 1])
    across = np.abs(frames[:, :, 2]) >= 0.5
    free = np.ones(len(rows), dtype=np.bool_)
    for rail in handrails:
        inside = (np.array(rail.min) - reach <= positions) & (
            positions <= np.array(rail.max) + reach
        )
        free &= ~((faces == rail.face) & (inside | across).all(axis=1))
    return [row for row, kept in zip(rows, free, strict=True) if kept]


def given_number(argument: float | None, data: dict[str, Any], key: str, default: float) -> float:
    """The argument, or what the data says in its place."""
    if argument is not None:
        return number(argument, key, SettingError)
    return number(data.get(key, default), key, MapError)


def vector_of(entry: dict[str, Any], key: str, where: str) -> Array:
    """A vector of an entry, shape (3,)."""
    if key not in entry:
        raise MapError(f"{where}: {key!r} is missing")
    return numbers(entry[key], (3,), f"{where}: {key}", MapError, LONGEST)


def _triple_of(entry: dict[str, Any], key: str, where: str) -> tuple[float, float, float]:
    x, y, z = vector_of(entry, key, where).tolist()
    return (x, y, z)


def _header(entry: Any, kind: str, i: int) -> tuple[str, str, str]:
    if not isinstance(entry, dict):
        raise MapError(f"{kind} number {i} must be an object")
    name = text(entry.get("id"), f"{kind} number {i}: 'id'", MapError)
    where = f"{kind} {name!r}"
    face = entry.get("face")
    if face not in FACES:
        raise MapError(f"{where}: unknown face {shown(face)}; valid faces are {', '.join(FACES)}")
    return name, face, where


def point_of(entry: Any, i: int) -> Row:
    """A point from an entry of `points`."""
    point, face, where = _header(entry, "point", i)
    rotation = _frame(where, vector_of(entry, "rail", where), vector_of(entry, "normal", where))
    return point, face, vector_of(entry, "position", where), rotation, 0.0


def segment_of(entry: Any, i: int) -> Segment:
    """A rail from an entry of `segments`."""
    segment, face, where = _header(entry, "segment", i)
    return Segment(
        id=segment,
        face=face,
        start=_triple_of(entry, "start", where),
        end=_triple_of(entry, "end", where),
        normal=_triple_of(entry, "normal", where),
        width=number(entry.get("width", 0.0256), f"{where}: width", MapError, LONGEST),
        thickness=number(entry.get("thickness", 0.013), f"{where}: thickness", MapError, LONGEST),
    )


def handrail_of(entry: Any, i: int) -> Handrail:
    """A handrail from an entry of `handrails`."""
    rail, face, where = _header(entry, "handrail", i)
    bar, axis = "bar_min" in entry and "bar_max" in entry, entry.get("axis", "x")
    if axis not in ("x", "y", "z"):
        raise MapError(f"{where}: unknown axis {shown(axis)}; valid axes are x, y, z")
    return Handrail(
        id=rail,
        face=face,
        min=_triple_of(entry, "min", where),
        max=_triple_of(entry, "max", where),
        axis=axis,
        bar_min=_triple_of(entry, "bar_min", where) if bar else None,
        bar_max=_triple_of(entry, "bar_max", where) if bar else None,
    )
