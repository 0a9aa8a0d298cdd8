"""Maps joined by rigid transforms, such as a station of its modules."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextvars import ContextVar
from dataclasses import replace
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MapError
from mlivr_gym.schema import FieldPath
from mlivr_gym.values import as_triple, check_unique
from mlivr_gym.world.boxes import UNIT, Box

_FILES: ContextVar[tuple[Any, ...]] = ContextVar("_FILES", default=())
"""Files whose parts are being read."""


def placed_maps(
    parts: Sequence[dict[str, Any]],
    folder: Path,
    names: Sequence[str],
    read: Callable[[Any, FieldPath], Any],
) -> list[dict[str, Any]]:
    """Return the fields of the parts of a map file, which `map_entries.PART` has checked.

    `folder` is that of the files that they name, `names` are those of maps, which are not files,
    and `read` returns the map of a part, see `grasp_map.as_map`. Raises a `MlivrError` that names
    the entry if a map is faulty, or is a part of itself, or if two have the same id. A file is read
    once.
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
        placed.append(_moved(made[key], f"{part['id']}/", rotation, translation))
    check_unique([part["id"] for part in parts], "part", MapError)
    return placed


def _moved(part: Any, name: str, rotation: Array, translation: Array) -> dict[str, Any]:
    """Return the fields of a map, moved by a rotation, (3, 3), and a translation, (3,) [m].

    The ids of points, segments and boxes begin with a name; the cabin has its eight corners.
    """

    def at(local: Any) -> Any:
        return np.asarray(local) @ rotation.T + translation

    segments = tuple(
        replace(
            segment,
            id=f"{name}{segment.id}",
            start=as_triple(at(segment.start)),
            end=as_triple(at(segment.end)),
            normal=as_triple(rotation @ np.array(segment.normal)),
        )
        for segment in part.segments
    )
    return {
        "ids": tuple(f"{name}{point}" for point in part.ids),
        "faces": part.faces,
        "positions": at(part.positions),
        "rotations": rotation @ part.rotations,
        "segments": segments,
        "boxes": Box.each_placed(part.boxes, name, rotation, translation),
        "cabin": at(list(product(*part.cabin.T))),
    }


def joined_fields(fields: dict[str, Any], parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the fields of a `GraspMap` that has its own entries and those of its parts.

    If `cabin` is missing, it becomes the bounding box of the parts' cabins. Since it is one box, it
    may hold positions outside all modules, which the boxes of their walls keep the robot from.
    Handrails of parts are kept as boxes only, since a `Handrail` lies along an axis.
    """
    corners = np.concatenate([part["cabin"] for part in parts])
    every = [fields, *parts]
    return {
        "cabin": np.stack([corners.min(axis=0), corners.max(axis=0)]),
        **fields,
        **{
            name: tuple(chain(*(one[name] for one in every)))
            for name in ("ids", "faces", "segments", "boxes")
        },
        **{
            name: np.concatenate([one[name] for one in every])
            for name in ("positions", "rotations")
        },
    }
