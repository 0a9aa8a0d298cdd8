"""Boxes around the robot, for the collision checks and for the MuJoCo scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import Reader
from mlivr_gym.arrays import Array
from mlivr_gym.errors import ShapeError, shortened
from mlivr_gym.files import load
from mlivr_gym.schema import (
    NAME,
    Choice,
    FieldPath,
    Fields,
    ListOf,
    Numbers,
    Rotation,
    Struct,
    Text,
    Tuples,
)
from mlivr_gym.values import MAX_LENGTH, MAX_POINTS, MIN_SIZE, Triple, as_triple, check_unique

KINDS = ("panel", "rack", "closeout", "bulkhead", "track", "handrail", "stanchion", "obstacle")
"""Kinds of boxes, which decide colours and names in messages.

A `"panel"` is a wall, a `"closeout"` a plate across a corner between two walls, a `"bulkhead"` the
wall at an end, a `"track"` a rail with points, and a `"stanchion"` a post of a `"handrail"`.
"""

BOX, POINT = "box/", "point/"
"""Prefixes of the names of boxes and of graspable points in the MuJoCo scene."""

UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Rows of the unit matrix."""


def scene_name(kind: str, name: str) -> str:
    """Return the name of a box or a point in the MuJoCo scene, from `BOX` or `POINT` and its id.

    The prefix keeps ids of users apart from the names of the robot, `"body"` and `"limb..."`.
    """
    return kind + name


@dataclass(frozen=True)
class Box:
    """A solid box.

    Examples
    --------
    >>> Box.between("bag", "obstacle", (3.0, -0.5, -1.0), (4.0, 0.5, 0.0)).centre
    (3.5, 0.0, -0.5)
    """

    id: str
    """Name."""
    kind: str
    """One of `KINDS`."""
    centre: Triple
    """Middle in the world [m]."""
    half: Triple
    """Half edges along the box's axes [m]."""
    rotation: tuple[Triple, Triple, Triple] = UNIT
    """Rows of the rotation from the box's axes to the world's."""
    face: str = ""
    """Cabin face that it belongs to, for pictures."""

    def __post_init__(self) -> None:
        """Check every figure."""
        BOX_DATA.check(self, FieldPath(f"box {shortened(self.id)}", ShapeError))

    @staticmethod
    def rows(rotation: Array) -> tuple[Triple, Triple, Triple]:
        """Return the rows of a rotation matrix, shape (3, 3), as tuples."""
        x, y, z = (as_triple(row) for row in rotation)
        return (x, y, z)

    @classmethod
    def between(
        cls, id: str, kind: str, low: Sequence[float], high: Sequence[float], face: str = ""
    ) -> Box:
        """Return an axis-aligned box from its lower to its upper corner [m]."""
        place = FieldPath(f"box {shortened(id)}", ShapeError)
        lower = np.array(CORNER.read(low, place.field("min")))
        upper = np.array(CORNER.read(high, place.field("max")))
        if not (lower < upper).all():
            raise place.fault(f"has its min {lower.tolist()} not below its max {upper.tolist()}")
        return cls(
            id, kind, as_triple(0.5 * (lower + upper)), as_triple(0.5 * (upper - lower)), UNIT, face
        )

    @classmethod
    def each_between(
        cls, name: str, kind: str, low: Array, high: Array, first: int = 0
    ) -> tuple[Box, ...]:
        """Return axis-aligned boxes from their corners, shape (k, 3) [m].

        Their ids are the name followed by a number, from `first` on, so a name that ends in a digit
        may give ids of another. The figures are checked all at once, which is much faster.
        """
        if not len(low):
            return ()
        place, least = FieldPath(f"boxes {shortened(name)}", ShapeError), 2.0 * MIN_SIZE
        Numbers((None, 3), -MAX_LENGTH, MAX_LENGTH, "m").read(low, place.field("min"))
        Numbers((None, 3), -MAX_LENGTH, MAX_LENGTH, "m").read(high, place.field("max"))
        Numbers((None, 3), least, np.inf, "m").read(high - low, place.field("size"))
        cls.between(
            f"{name}{first}", kind, low[0].tolist(), high[0].tolist()
        )  # checks name and kind
        centres, halves = (0.5 * (low + high)).T.tolist(), (0.5 * (high - low)).T.tolist()
        both = zip(zip(*centres, strict=True), zip(*halves, strict=True), strict=True)
        return tuple(
            cls._checked(f"{name}{k}", kind, centre, half, UNIT, "")
            for k, (centre, half) in enumerate(both, first)
        )

    @classmethod
    def each_placed(
        cls, boxes: Sequence[Box], name: str, rotation: Array, translation: Array
    ) -> tuple[Box, ...]:
        """Return boxes moved by a rotation, shape (3, 3), and a translation, shape (3,) [m].

        Their ids begin with the name. The figures are checked all at once.
        """
        if not boxes:
            return ()
        place = FieldPath(f"boxes {shortened(name)}", ShapeError)
        centres = np.array([box.centre for box in boxes]) @ rotation.T + translation
        Numbers((None, 3), -MAX_LENGTH, MAX_LENGTH, "m").read(centres, place.field("centre"))
        turned = (rotation @ np.array([box.rotation for box in boxes])).tolist()
        ids = [NAME.read(f"{name}{box.id}", place.field("id")) for box in boxes]
        return tuple(
            cls._checked(id, box.kind, (x, y, z), box.half, tuple(map(tuple, rows)), box.face)
            for id, box, (x, y, z), rows in zip(ids, boxes, centres.tolist(), turned, strict=True)
        )

    @classmethod
    def _checked(
        cls, id: str, kind: str, centre: Triple, half: Triple, rotation: Any, face: str
    ) -> Box:
        """Return a box of figures that are checked already."""
        box = object.__new__(cls)
        fields = vars(box)  # setting each one is faster than an update with all
        fields["id"], fields["kind"], fields["centre"] = id, kind, centre
        fields["half"], fields["rotation"], fields["face"] = half, rotation, face
        return box

    @classmethod
    def from_dict(cls, data: Any, kind: str = "obstacle") -> Box:
        """Build a box from plain data.

        Fields: `id`, and `min` and `max` or `centre` and `half`; `kind`, `rotation`, `face` if
        wanted.

        Raises a `ShapeError` if a field is missing, unknown or faulty.
        """
        return Boxes(kind).box(data, FieldPath("", ShapeError))

    def to_dict(self) -> dict[str, Any]:
        """Return the box as plain data, the inverse of `from_dict`."""
        return {
            "id": self.id, "kind": self.kind, "centre": list(self.centre), "half": list(self.half),
            "rotation": [list(row) for row in self.rotation], "face": self.face,
        }  # fmt: skip

    @cached_property
    def bounds(self) -> Array:
        """Corners of the axis-aligned bounding box in the world [m], shape (2, 3)."""
        centre, half = np.array(self.centre), np.abs(np.array(self.rotation)) @ np.array(self.half)
        return np.stack([centre - half, centre + half])


CORNER = Tuples((3,), most=MAX_LENGTH, unit="m")
"""A point of the world."""

BOX_DATA = Struct(
    Box,
    {
        "id": NAME,
        "kind": Choice(KINDS),
        "centre": CORNER,
        "half": Tuples((3,), MIN_SIZE, MAX_LENGTH, "m"),
        "rotation": Rotation(),
        "face": Text(least=0),
    },
)
"""Fields of a `Box`."""


CORNERS = Fields(
    {"id": NAME, "min": CORNER, "max": CORNER},
    {name: BOX_DATA.validators[name] for name in ("kind", "face")},
)
"""Fields of a box along the axes of the map, from its corners."""


@dataclass(frozen=True)
class Boxes:
    """A list of boxes as plain data, each with an id of its own."""

    kind: str = "obstacle"
    """What they are where the data do not say."""

    def read(self, value: object, place: FieldPath) -> tuple[Box, ...]:
        """Return the boxes."""
        boxes = ListOf(Reader(self.box)).read(value, place)
        check_unique([box.id for box in boxes], f"{place.path}: box", place.error)
        return boxes

    def box(self, value: object, place: FieldPath) -> Box:
        """Return one box from `min` and `max`, or `centre`, `half` and, if rotated, `rotation`."""
        if not isinstance(value, dict):
            return BOX_DATA.read(value, place)
        if {"centre", "half", "rotation"} & value.keys():
            return BOX_DATA.read({"kind": self.kind} | value, place)
        if not {"min", "max"} & value.keys():
            raise place.fault("needs 'min' and 'max', or 'centre' and 'half'")
        data = {"kind": self.kind, "face": ""} | CORNERS.read(value, place)
        low, high = data["min"], data["max"]
        return place.build(Box.between, data["id"], data["kind"], low, high, data["face"])


OBSTACLES = Fields({}, {"boxes": Boxes(), "occupied": ListOf(NAME, most=MAX_POINTS)})
"""A file of obstacles."""


def load_obstacles(path: str | Path) -> tuple[tuple[Box, ...], tuple[str, ...]]:
    """Read boxes and ids of occupied points from a JSON file.

    It holds `{"boxes": [...], "occupied": [...]}`; see `Box.from_dict`.

    Raises a `ShapeError` that names file and entry if the file cannot be read or an entry is
    faulty.
    """
    data = load(
        path, "obstacles", ShapeError, lambda data: OBSTACLES.read(data, FieldPath("", ShapeError))
    )
    return data.get("boxes", ()), data.get("occupied", ())
