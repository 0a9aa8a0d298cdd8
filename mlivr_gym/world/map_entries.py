"""Map files: their fields, and the points that their entries make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MapError
from mlivr_gym.schema import (
    NAME,
    Anything,
    Choice,
    FieldPath,
    Fields,
    ListOf,
    Numbers,
    Rotation,
    Tuples,
    are_rotations,
)
from mlivr_gym.values import MAX_LENGTH, MAX_POINTS, MIN_SIZE, check_unique
from mlivr_gym.world.boxes import Box, Boxes
from mlivr_gym.world.meshes import MESH_OPTIONS, mesh_boxes
from mlivr_gym.world.rails import DIRECTION, HANDRAIL, POSITION, SEGMENT, Handrail, Segment

MARGIN = 1.5
"""How far from the box of all points the base may be [m] where a map gives no cabin.

The robots that ship hold a point at most 1.46 m from the middle of their body.
"""

METRES = {"m": 1.0, "mm": 0.001, "cm": 0.01, "in": 0.0254, "ft": 0.3048}
"""Metres per unit of length of a map file."""

UNIT_OF_LENGTH = Choice(tuple(METRES))
"""Unit of all lengths of a map file."""

FAR = 100.0
"""Largest coordinate of points and rails of a map that does not name its unit [m].

The ISS, 109 m long, reaches half as far from its middle.
"""

UNIT_TOLERANCE = 1e-6
"""Largest deviation of a unit vector's length, and of its right angles, from 1 and 0."""

SPACING = Tuples((), MIN_SIZE, MAX_LENGTH, "m")
"""Distance of points along a rail."""

CLEARANCE = Tuples((), 0.0, MAX_LENGTH, "m")
"""Distance of points from handrails."""

POINT = Fields(
    {"id": NAME, "face": NAME, "position": POSITION, "normal": DIRECTION, "rail": DIRECTION}
)
"""A point of a map file."""

MESH = Fields({"file": NAME}, MESH_OPTIONS)
"""A mesh whose surface the robot must not touch; its file is relative to that of the map."""


class AnyMap(Anything):
    """A map by its name or file, or the map itself, which `grasp_map.as_map` reads."""

    def read(self, value: object, place: FieldPath) -> object:
        """Return the value; null, which elsewhere stands for the JEM, is refused."""
        if value is None:
            raise place.refused(value, "the name of a map that ships, a file, or a map")
        return value


PART = Fields({"id": NAME, "map": AnyMap()}, {"translation": POSITION, "rotation": Rotation()})
"""A map that is placed in another one by a rigid transform."""

REMARKS = ("description", "frame", "sources", "provenance")
"""Fields of a map file for its readers."""

MODULE = Fields(
    {},
    {
        **dict.fromkeys(REMARKS, Anything()),
        "name": NAME,
        "unit": UNIT_OF_LENGTH,
        "points": ListOf(POINT, most=MAX_POINTS),
        "segments": ListOf(SEGMENT),
        "spacing": SPACING,
        "handrails": ListOf(HANDRAIL),
        "clearance": CLEARANCE,
        "cabin": Fields({"min": POSITION, "max": POSITION}),
        "boxes": Boxes("panel"),
        "mesh": MESH,
        "parts": ListOf(PART),
    },
)
"""A map file."""

POINTS = Fields(
    {
        "name": NAME,
        "ids": ListOf(NAME, 1, MAX_POINTS),
        "faces": ListOf(NAME, 1, MAX_POINTS),
        "positions": Numbers((None, 3), most=MAX_LENGTH, unit="m", rows=(1, MAX_POINTS)),
        "rotations": Numbers((None, 3, 3), rows=(1, MAX_POINTS)),
        "cabin": Numbers((2, 3), most=MAX_LENGTH, unit="m"),
        "segments": ListOf(SEGMENT),
        "handrails": ListOf(HANDRAIL),
        "boxes": Boxes("panel"),
    }
)
"""A map as `GraspMap.to_dict` writes it, and the fields of one that is made."""


def whole_fields(given: Mapping[str, Any], place: FieldPath) -> dict[str, Any]:
    """Return the fields of a `GraspMap` as `POINTS` reads them, checked against each other."""
    fields = {
        name: kind.read(given[name], place.field(name)) for name, kind in POINTS.required.items()
    }
    if not fields["ids"]:
        raise place.fault("has no graspable point")
    check_unique(fields["ids"], "point", MapError)
    check_unique([box.id for box in fields["boxes"]], "box", MapError)
    count = len(fields["ids"])
    for name in ("faces", "positions", "rotations"):
        if len(fields[name]) != count:
            raise place.field(name).fault(f"are {len(fields[name])}, of {count} points")
    faulty = np.flatnonzero(~are_rotations(fields["rotations"]))
    if len(faulty):
        first = place.field("rotations").entry(int(faulty[0]))
        raise first.fault("must be a right-handed rotation matrix")
    low, high = fields["cabin"]
    if not (low < high).all():
        raise place.field("cabin").fault(f"{fields['cabin'].tolist()} must have its min below max")
    return fields


def plain_fields(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a `GraspMap` as plain data, which `POINTS` reads."""
    return {
        "name": given["name"],
        **{name: list(given[name]) for name in ("ids", "faces")},
        **{name: given[name].tolist() for name in ("positions", "rotations", "cabin")},
        "segments": [asdict(segment) for segment in given["segments"]],
        "handrails": [
            {name: v for name, v in asdict(rail).items() if v is not None}
            for rail in given["handrails"]
        ],
        "boxes": [box.to_dict() for box in given["boxes"]],
    }


Row = tuple[str, str, Array, Array, float]
"""Id, face, position and rotation in the map's frame, width of the rail across [m]."""


def _frame(place: FieldPath, rail: Array, normal: Array) -> Array:
    length = float(np.linalg.norm(normal))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise place.field("normal").fault(
            f"is {normal.tolist()}, of length {length:.6g}; its length must be 1"
        )
    along = float(np.linalg.norm(rail))
    if not along > MIN_SIZE:
        raise place.fault(f"has a rail without a direction: {rail.tolist()}")
    if abs(float(rail @ normal)) > UNIT_TOLERANCE * along:
        raise place.fault(
            f"has a rail {rail.tolist()} that is not at right angles to normal {normal.tolist()}"
        )
    rail = rail / along
    return np.column_stack([rail, np.cross(normal, rail), normal])


def point_row(data: dict[str, Any], place: FieldPath) -> Row:
    """Return the row of a point that `POINT` has read; its rail has no width."""
    frame = _frame(place, np.array(data["rail"]), np.array(data["normal"]))
    return data["id"], data["face"], np.array(data["position"]), frame, 0.0


def discretise(segment: Segment, spacing: float, most: int, place: FieldPath) -> list[Row]:
    """Return points at multiples of `spacing` [m] from the middle of a segment, up to `most`."""
    start, end = np.array(segment.start), np.array(segment.end)
    length = float(np.linalg.norm(end - start))
    frame = _frame(place, end - start, np.array(segment.normal))
    if length > spacing * most:
        raise place.fault(
            f"is {length:g} m long and has too many points {spacing:g} m apart: "
            f"a map has at most {MAX_POINTS}; take a larger spacing"
        )
    half = int(np.floor(0.5 * length / spacing + 1e-9))
    middle, along = 0.5 * (start + end), frame[:, 0]
    points = [middle + k * spacing * along for k in range(-half, half + 1)]
    return [
        (f"{segment.id}:{k}", segment.face, point, frame, segment.width)
        for k, point in enumerate(points)
    ]


def clear_of_handrails(
    rows: list[Row], handrails: tuple[Handrail, ...], clearance: float
) -> list[Row]:
    """Return the points whose rail keeps `clearance` [m] from each handrail on the same face."""
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


def _check_unit(points: Sequence[dict[str, Any]], segments: Sequence[Segment]) -> None:
    """Refuse points and rails that are far away, of a map that names no unit."""
    ends = [end for segment in segments for end in (segment.start, segment.end)]
    farthest = float(np.abs([*ends, *(point["position"] for point in points)]).max(initial=0.0))
    if farthest > FAR:
        others = ", ".join(repr(unit) for unit in METRES if unit != "m")
        raise MapError(
            f"a coordinate is {farthest:g} m, which looks like another unit: give the unit, "
            f"one of {others}, or 'm' for metres"
        )


def _mesh(mesh: dict[str, Any] | None, folder: Path) -> tuple[Box, ...]:
    """Return the boxes that cover the mesh of a map file, if it names one."""
    if mesh is None:
        return ()
    options = {name: value for name, value in mesh.items() if name != "file"}
    return mesh_boxes(folder / mesh["file"], **options)


def map_fields(data: Any, unit: str | None, name: str, folder: Path) -> dict[str, Any]:
    """Return the fields of a `GraspMap` from plain data; files that they name lie in `folder`.

    The unit of lengths is the one given, if the data name none. With parts, they are
    `joining.joined_fields`' own fields, of which `cabin` may be missing.
    """
    root = FieldPath("", MapError)
    if isinstance(data, dict) and "ids" in data:
        if unit is not None:
            raise MapError(f"unit is {unit!r}, but the map was saved in metres; leave it out")
        return POINTS.read(data, root)
    place = root._replace(metres=metres_of(data, unit))
    read = MODULE.read(data, place) | ({} if unit is None else {"unit": unit})
    return _fields_of(read, root, name, folder)


def metres_of(data: Any, given: str | None) -> float:
    """Return the unit of plain data of a map [m], by default that of a caller, or 1.

    Raises a `MapError` if both are given and differ.
    """
    place = FieldPath("unit", MapError)
    named = data.get("unit", given) if isinstance(data, dict) else None
    if named is None:
        return 1.0
    if given not in (None, named):
        raise place.fault(f"is {named!r} in the file, but {given!r} is given")
    return METRES[UNIT_OF_LENGTH.read(named, place)]


def _fields_of(read: dict[str, Any], root: FieldPath, name: str, folder: Path) -> dict[str, Any]:
    """Return the fields of a `GraspMap` from what `MODULE` has read, see `map_fields`."""
    segments, handrails = read.get("segments", ()), read.get("handrails", ())
    if "unit" not in read:
        _check_unit(read.get("points", ()), segments)
    rows = [
        point_row(entry, root.field("points").entry(i))
        for i, entry in enumerate(read.get("points", ()))
    ]
    for i, segment in enumerate(segments):
        place = root.field("segments").entry(i)
        rows.extend(discretise(segment, read.get("spacing", 0.2), MAX_POINTS - len(rows), place))
    rows = clear_of_handrails(rows, handrails, read.get("clearance", 0.03))
    parts = read.get("parts", ())
    if not (rows or parts):
        raise MapError("the map has no graspable point; give 'points', 'segments' or 'parts'")
    positions = np.array([row[2] for row in rows]).reshape(-1, 3)
    cabin = read.get("cabin")
    if cabin is None and not parts:
        around = positions.min(axis=0) - MARGIN, positions.max(axis=0) + MARGIN
        cabin = dict(zip(("min", "max"), around, strict=True))
    return {
        **({"parts": parts} if parts else {}),
        "ids": tuple(row[0] for row in rows),
        "positions": positions,
        "rotations": np.array([row[3] for row in rows]).reshape(-1, 3, 3),
        "faces": tuple(row[1] for row in rows),
        **({} if cabin is None else {"cabin": np.array([cabin["min"], cabin["max"]])}),
        "name": read.get("name", name),
        "segments": segments,
        "handrails": handrails,
        "boxes": (
            *read.get("boxes", ()),
            *_mesh(read.get("mesh"), folder),
            *(segment.box for segment in segments),
            *(box for rail in handrails for box in rail.boxes),
        ),
    }
