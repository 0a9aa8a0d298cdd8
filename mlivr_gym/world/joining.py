"""Maps joined by rigid transforms, such as a station of its modules."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MapError
from mlivr_gym.schema import FieldPath
from mlivr_gym.values import as_triple, check_unique
from mlivr_gym.world.boxes import UNIT, Box

_FILES: ContextVar[tuple[Any, ...]] = ContextVar("_FILES", default=())
"""Files whose parts are being read."""


class PlacedMap(NamedTuple):
    """A map with its place in another one."""

    id: str
    """Name, with which the ids of its points, segments and boxes begin: `"id/point"`."""
    map: Any
    """The map, a `GraspMap`."""
    rotation: Array
    """Rotation from its frame to that of the other map, shape (3, 3)."""
    translation: Array
    """Its origin in the frame of the other map [m], shape (3,)."""

    def position(self, local: Any) -> Array:
        """Return positions in the frame of the other map, shape (..., 3) [m]."""
        placed: Array = np.asarray(local) @ self.rotation.T + self.translation
        return placed

    @property
    def corners(self) -> Array:
        """Corners of its cabin in the frame of the other map [m], shape (8, 3)."""
        low, high = self.map.cabin
        local = [
            np.where([i & 1, i & 2, i & 4], high, low) for i in range(8)
        ]  # all combinations of the three coordinates
        return self.position(local)


def placed_maps(
    parts: Sequence[dict[str, Any]],
    folder: Path,
    names: Sequence[str],
    read: Callable[[Any, FieldPath], Any],
) -> list[PlacedMap]:
    """Return the parts of a map file, which `map_entries.PART` has checked.

    `folder` is that of the files that they name, `names` are those of maps, which are not files,
    and `read` returns the map of a part, see `grasp_map.as_map`. Raises a `MlivrError` that names
    the entry if a map is faulty, or is a part of itself. A file is read once.
    """
    placed, made = [], dict[Any, Any]()
    for i, part in enumerate(parts):
        place, given = FieldPath("parts", MapError).entry(i).field("map"), part["map"]
        if isinstance(given, str) and given not in names:
            given = (folder / given).resolve()
            if given in _FILES.get():
                raise place.fault(f"is {part['map']!r}, which is a part of itself")
        key = given if isinstance(given, (str, Path)) else i
        if key not in made:
            reset = _FILES.set((*_FILES.get(), given))
            try:
                made[key] = read(given, place)
            finally:
                _FILES.reset(reset)
        rotation = np.array(part.get("rotation", UNIT))
        translation = np.array(part.get("translation", (0, 0, 0)))
        placed.append(PlacedMap(part["id"], made[key], rotation, translation))
    return placed


def joined_fields(fields: dict[str, Any], parts: Sequence[PlacedMap]) -> dict[str, Any]:
    """Return the fields of a `GraspMap` that has its own entries and those of its parts.

    If `cabin` is missing, it becomes the bounding box of the parts' cabins. Since it is one box, it
    may hold positions outside all modules, which the boxes of their walls keep the robot from.
    Handrails of parts are kept as boxes only, since a `Handrail` lies along an axis. Raises a
    `MapError` if two parts have the same id.
    """
    check_unique([part.id for part in parts], "part", MapError)
    corners = np.concatenate([part.corners for part in parts])
    segments, boxes = list(fields["segments"]), list(fields["boxes"])
    for part in parts:
        boxes += Box.each_placed(part.map.boxes, f"{part.id}/", part.rotation, part.translation)
        segments += [
            replace(
                segment,
                id=f"{part.id}/{segment.id}",
                start=as_triple(part.position(segment.start)),
                end=as_triple(part.position(segment.end)),
                normal=as_triple(part.rotation @ np.array(segment.normal)),
            )
            for segment in part.map.segments
        ]
    placed = [part.position(part.map.positions) for part in parts]
    turned = [part.rotation @ part.map.rotations for part in parts]
    ids = [f"{part.id}/{point}" for part in parts for point in part.map.ids]
    return {
        "cabin": np.stack([corners.min(axis=0), corners.max(axis=0)]),
        **fields,
        "ids": (*fields["ids"], *ids),
        "faces": (*fields["faces"], *(face for part in parts for face in part.map.faces)),
        "positions": np.concatenate([fields["positions"], *placed]),
        "rotations": np.concatenate([fields["rotations"], *turned]),
        "segments": tuple(segments),
        "boxes": tuple(boxes),
    }
