"""Boxes that stand round the robot, for the planner's checks and for the MuJoCo scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import ShapeError, shown
from mlivr_gym.files import read_json
from mlivr_gym.values import (
    LONGEST,
    MOST_POINTS,
    SMALLEST,
    Triple,
    entries,
    numbers,
    rotation,
    text,
    triple,
    unique,
)

KINDS = ("panel", "rack", "closeout", "bulkhead", "track", "handrail", "stanchion", "obstacle")
"""What a box can be."""

BOX, POINT = "box/", "point/"
"""What the names of boxes and of graspable points begin with in the MuJoCo scene."""

UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Rows of the unit matrix."""


def scene_name(kind: str, name: str) -> str:
    """The name in the MuJoCo scene of something that a user has named.

    Shapes and sites of the robot are called `"body"` or `"limb..."`, so that no name that a user
    gives can be taken for one.

    Args:
        kind: `BOX` or `POINT`.
        name: Its id.
    """
    return kind + name


@dataclass(frozen=True)
class Box:
    """A solid box.

    Attributes:
        id: Name.
        kind: One of `KINDS`.
        centre: Middle in the world [m].
        half: Half edges along the box's axes [m].
        rotation: Rows of the rotation from the box's axes to the world's.
        face: Cabin face that it belongs to, for pictures.
    """

    id: str
    kind: str
    centre: Triple
    half: Triple
    rotation: tuple[Triple, Triple, Triple] = UNIT
    face: str = ""

    def __post_init__(self) -> None:
        """Check every figure."""
        text(self.id, "the id of a box", ShapeError)
        if self.kind not in KINDS:
            kinds = ", ".join(KINDS)
            raise ShapeError(
                f"box {self.id!r}: unknown kind {shown(self.kind)}; valid kinds are {kinds}"
            )
        where = f"box {self.id!r}:"
        for name in ("centre", "half"):
            values = numbers(getattr(self, name), (3,), f"{where} {name}", ShapeError, LONGEST)
            object.__setattr__(self, name, triple(values))
        if min(self.half) < SMALLEST:
            raise ShapeError(
                f"{where} half edges {list(self.half)} must be above 0 (at least {SMALLEST:g} m)"
            )
        object.__setattr__(
            self, "rotation", Box.rows(rotation(self.rotation, f"{where} rotation", ShapeError))
        )

    @staticmethod
    def rows(rotation: Array) -> tuple[Triple, Triple, Triple]:
        """Rows of a rotation matrix, shape (3, 3), as tuples."""
        x, y, z = (triple(row) for row in rotation)
        return (x, y, z)

    @classmethod
    def between(
        cls, id: str, kind: str, low: Sequence[float], high: Sequence[float], face: str = ""
    ) -> Box:
        """A box along the world's axes from its lower to its upper corner [m]."""
        lower = numbers(low, (3,), f"box {shown(id)}: min", ShapeError, LONGEST)
        upper = numbers(high, (3,), f"box {shown(id)}: max", ShapeError, LONGEST)
        if not (lower < upper).all():
            raise ShapeError(
                f"box {shown(id)}: min {lower.tolist()} must be below max {upper.tolist()}"
            )
        return cls(
            id, kind, triple(0.5 * (lower + upper)), triple(0.5 * (upper - lower)), UNIT, face
        )

    @classmethod
    def from_dict(cls, data: Any, kind: str = "obstacle") -> Box:
        """A box from plain data.

        Fields: `id`, and `min` and `max` or `centre` and `half`; `kind`, `rotation`, `face` if
        wanted.

        Raises:
            ShapeError: If a field is missing, unknown or faulty.
        """
        if not isinstance(data, dict) or "id" not in data:
            raise ShapeError(f"a box is an object with an 'id', not {shown(data)}")
        name = text(data["id"], "the id of a box", ShapeError)
        corners, middle = {"min", "max"} <= set(data), {"centre", "half"} <= set(data)
        known = {"id", "kind", "face"} | (
            {"min", "max"} if corners else {"centre", "half", "rotation"}
        )
        unknown = sorted(set(data) - known)
        if corners == middle or unknown:
            fault = f"unknown field {shown(unknown[0])}" if unknown else "its place is missing"
            raise ShapeError(
                f"box {name!r}: {fault}; give 'min' and 'max', or 'centre', 'half' and, "
                "if turned, 'rotation'"
            )
        kind, face = str(data.get("kind", kind)), str(data.get("face", ""))
        if corners:
            return cls.between(name, kind, data["min"], data["max"], face)
        return cls(name, kind, data["centre"], data["half"], data.get("rotation", UNIT), face)

    def to_dict(self) -> dict[str, Any]:
        """The box as plain data, the inverse of `from_dict`."""
        return {
            "id": self.id, "kind": self.kind, "centre": list(self.centre), "half": list(self.half),
            "rotation": [list(row) for row in self.rotation], "face": self.face,
        }  # fmt: skip

    @cached_property
    def bounds(self) -> Array:
        """Lower and upper corner in the world of the smallest upright box round it [m], (2, 3)."""
        centre, half = np.array(self.centre), np.abs(np.array(self.rotation)) @ np.array(self.half)
        return np.stack([centre - half, centre + half])


def boxes_from(data: Any, kind: str) -> tuple[Box, ...]:
    """Boxes from a list of plain data.

    Raises:
        ShapeError: If an entry is faulty or an id appears twice.
    """
    boxes = tuple(Box.from_dict(entry, kind) for entry in entries(data, "boxes", ShapeError))
    unique([box.id for box in boxes], "box", ShapeError)
    return boxes


def load_obstacles(path: str | Path) -> tuple[tuple[Box, ...], tuple[str, ...]]:
    """Boxes and ids of occupied points from a JSON file.

    It holds `{"boxes": [...], "occupied": [...]}`; see `Box.from_dict`.

    Raises:
        ShapeError: If the file cannot be read or an entry is faulty; it names file and entry.
    """
    data = read_json(path, "obstacles", ShapeError)
    try:
        if set(data) - {"boxes", "occupied"}:
            raise ShapeError("must be an object with 'boxes' and 'occupied' and nothing else")
        occupied = entries(data.get("occupied", []), "'occupied'", ShapeError, MOST_POINTS)
        names = tuple(text(point, "a point of 'occupied'", ShapeError) for point in occupied)
        return boxes_from(data.get("boxes", []), "obstacle"), names
    except ShapeError as error:
        raise ShapeError(f"obstacles {str(path)!r}: {error}") from None
