"""Shapes of surroundings and robot, defined once for the planner's checks and for the MuJoCo scene.

Surroundings are boxes. A limb is a set of capsules fixed to its links; the robot's body is a box.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.errors import ShapeError

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

LINKS = ("base", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "gripper")
"""Links of a limb in order from the body; the gripper is fixed to the last."""

KINDS = ("panel", "rack", "closeout", "bulkhead", "track", "handrail", "stanchion", "obstacle")
"""What a box can be."""

UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Box:
    """A solid box.

    Attributes:
        id: Name.
        kind: One of `KINDS`.
        centre: Middle [m].
        half: Half edges [m].
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
        if self.kind not in KINDS:
            raise ShapeError(f"box {self.id!r}: unknown kind {self.kind!r}; valid kinds are {', '.join(KINDS)}")
        for name, shape in (("centre", (3,)), ("half", (3,)), ("rotation", (3, 3))):
            array = _numbers(getattr(self, name), shape, f"box {self.id!r}: {name}")
            values = array.tolist()
            object.__setattr__(self, name, tuple(map(tuple, values)) if name == "rotation" else tuple(values))
        if min(self.half) <= 0.0:
            raise ShapeError(f"box {self.id!r}: half edges {list(self.half)} must be above 0")
        turned = np.array(self.rotation)
        if np.abs(turned.T @ turned - np.eye(3)).max() > 1e-5 or np.linalg.det(turned) < 0.0:
            raise ShapeError(f"box {self.id!r}: rotation must be a right-handed rotation matrix")

    @staticmethod
    def rows(rotation: Array) -> tuple[Triple, Triple, Triple]:
        """Rows of a rotation matrix, shape (3, 3), as tuples."""
        x, y, z = (_triple(row) for row in rotation)
        return (x, y, z)

    @classmethod
    def between(cls, id: str, kind: str, low: Sequence[float], high: Sequence[float], face: str = "") -> Box:
        """A box along the axes from its lower to its upper corner [m]."""
        lower = _numbers(low, (3,), f"box {id!r}: min")
        upper = _numbers(high, (3,), f"box {id!r}: max")
        if not (lower < upper).all():
            raise ShapeError(f"box {id!r}: min {lower.tolist()} must be below max {upper.tolist()}")
        return cls(id, kind, _triple(0.5 * (lower + upper)), _triple(0.5 * (upper - lower)), UNIT, face)

    @classmethod
    def from_dict(cls, data: Any, kind: str = "obstacle") -> Box:
        """A box from plain data: `id`, and `min` and `max` or `centre` and `half`; `kind`, `rotation`, `face` if wanted.

        Raises:
            ShapeError: If a field is missing, unknown or faulty.
        """
        if not isinstance(data, dict) or not isinstance(data.get("id"), str) or not data["id"]:
            raise ShapeError(f"a box is an object with an 'id', not {data!r}")
        name = data["id"]
        corners, middle = {"min", "max"} <= set(data), {"centre", "half"} <= set(data)
        known = {"id", "kind", "face"} | ({"min", "max"} if corners else {"centre", "half", "rotation"})
        unknown = sorted(set(data) - known)
        if corners == middle or unknown:
            fault = f"unknown field {unknown[0]!r}" if unknown else "its place is missing"
            raise ShapeError(
                f"box {name!r}: {fault}; give 'min' and 'max', or 'centre', 'half' and, if turned, 'rotation'"
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
        """Lower and upper corner of the smallest box along the axes round it [m], shape (2, 3)."""
        centre, half = np.array(self.centre), np.abs(np.array(self.rotation)) @ np.array(self.half)
        return np.stack([centre - half, centre + half])


@dataclass(frozen=True)
class Capsule:
    """A capsule fixed to a link of a limb.

    Attributes:
        link: One of `LINKS`; the gripper's frame is that of the flange, z towards the grasp.
        start: One end of the axis in the link's frame, that of the manufacturer's description [m].
        end: The other end [m].
        radius: Radius [m].
    """

    link: str
    start: Triple
    end: Triple
    radius: float

    def __post_init__(self) -> None:
        """Check every figure."""
        if self.link not in LINKS:
            raise ShapeError(f"capsule on unknown link {self.link!r}; valid links are {', '.join(LINKS)}")
        for name in ("start", "end"):
            ends = _triple(_numbers(getattr(self, name), (3,), f"capsule on {self.link}: {name}"))
            object.__setattr__(self, name, ends)
            if self.link in LINKS[6:] and max(abs(ends[0]), abs(ends[1])) > 1e-9:
                raise ShapeError(f"capsule on {self.link}: {name} {ends} must lie on the flange axis, x = y = 0")
        radius = float(_numbers(self.radius, (), f"capsule on {self.link}: radius"))
        if radius <= 0.0:
            raise ShapeError(f"capsule on {self.link}: radius is {radius:g}; it must be above 0")
        object.__setattr__(self, "radius", radius)


def _numbers(value: Any, shape: tuple[int, ...], where: str) -> Array:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ShapeError(f"{where} {value!r} must be numbers of shape {shape}") from None
    if array.shape != shape or not np.isfinite(array).all():
        raise ShapeError(f"{where} {value!r} must be finite numbers of shape {shape}")
    return array


def _triple(array: Array) -> Triple:
    x, y, z = array.tolist()
    return (x, y, z)


def boxes_from(data: Any, kind: str) -> tuple[Box, ...]:
    """Boxes from a list of plain data.

    Raises:
        ShapeError: If an entry is faulty or an id appears twice.
    """
    if not isinstance(data, (list, tuple)):
        raise ShapeError("boxes must be a list")
    boxes = tuple(Box.from_dict(entry, kind) for entry in data)
    ids = [box.id for box in boxes]
    for i, name in enumerate(ids):
        if name in ids[:i]:
            raise ShapeError(f"box {name!r} appears more than once")
    return boxes


def load_obstacles(path: str | Path) -> tuple[tuple[Box, ...], tuple[str, ...]]:
    """Boxes and ids of occupied points from a JSON file `{"boxes": [...], "occupied": [...]}`; see `Box.from_dict`.

    Raises:
        ShapeError: If the file cannot be read or an entry is faulty.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ShapeError(f"cannot read obstacles {str(path)!r}: {error}") from None
    if not isinstance(data, dict) or set(data) - {"boxes", "occupied"}:
        raise ShapeError(f"obstacles {str(path)!r}: must be an object with 'boxes' and 'occupied' and nothing else")
    occupied = data.get("occupied", [])
    if not isinstance(occupied, list) or not all(isinstance(point, str) for point in occupied):
        raise ShapeError(f"obstacles {str(path)!r}: 'occupied' must be a list of point ids")
    return boxes_from(data.get("boxes", []), "obstacle"), tuple(occupied)
