"""Graspable points: where a limb may hold on.

A `GraspMap` is a frozen set of points in the JEM frame (origin on the
centreline at the Node 2 end bulkhead, +x port, +y aft, +z overhead; metres).
Maps come from JSON files that list points, track segments, or both; the module
that ships with the package is read by the same loader.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import (
    GoalError,
    MapError,
    MlivrError,
    SettingError,
    UnknownPointError,
    nonnegative,
)
from mlivr_gym.files import read_json
from mlivr_gym.values import LONGEST, MOST_POINTS, entries, numbers, text, unique
from mlivr_gym.world.boxes import Box, boxes_from
from mlivr_gym.world.map_entries import (
    check_point,
    clear_of_handrails,
    discretise,
    given_number,
    handrail_of,
    point_of,
    segment_of,
    vector_of,
)
from mlivr_gym.world.rails import Handrail, Segment
from mlivr_gym.world.surroundings import handrail_boxes, module_boxes, track_box


@dataclass(frozen=True)
class GraspMap:
    """Graspable points and the surroundings they belong to.

    Attributes:
        ids: m point ids, for example `"D4a:3"`.
        positions: Points in the map's frame, which is the world [m], shape (m, 3).
        rotations: Axes of the points in that frame, shape (m, 3, 3); columns are x along the rail,
            y, and z the outward surface normal.
        faces: m names out of `FACES`.
        cabin: Lower and upper corner of the space a base may be in [m], shape (2, 3).
        name: Short name of the map.
        segments: Rails that the points lie on.
        handrails: Handrails.
        boxes: What stands round the points: tracks and handrails, racks and walls.
    """

    ids: tuple[str, ...]
    positions: Array
    rotations: Array
    faces: tuple[str, ...]
    cabin: Array
    name: str = "map"
    segments: tuple[Segment, ...] = ()
    handrails: tuple[Handrail, ...] = ()
    boxes: tuple[Box, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        """Check shapes and values, and freeze the arrays."""
        m = len(self.ids)
        text(self.name, "the name of the map", MapError)
        if not 0 < m <= MOST_POINTS:
            count = f"{m or 'no'} graspable point(s)"
            raise MapError(f"map {self.name!r} has {count}; at most {MOST_POINTS} are taken")
        unique(self.ids, "point", MapError)
        unique([box.id for box in self.boxes], "box", MapError)
        object.__setattr__(self, "_index", {point: i for i, point in enumerate(self.ids)})
        for attribute, shape in (
            ("positions", (m, 3)),
            ("rotations", (m, 3, 3)),
            ("cabin", (2, 3)),
        ):
            array = np.array(getattr(self, attribute), dtype=np.float64)
            if array.shape != shape:
                raise MapError(f"{attribute} must have shape {shape}, not {array.shape}")
            array.setflags(write=False)
            object.__setattr__(self, attribute, array)
        for point, face, position, turn in zip(
            self.ids, self.faces, self.positions, self.rotations, strict=True
        ):
            check_point(point, face, position, turn)
        numbers(self.cabin, (2, 3), "cabin", MapError, LONGEST)
        if not (self.cabin[0] < self.cabin[1]).all():
            raise MapError(f"cabin {self.cabin.tolist()} must have its min below max")

    _index: dict[str, int] = field(init=False, repr=False, compare=False, default_factory=dict)

    def __len__(self) -> int:
        """Number of points."""
        return len(self.ids)

    @cached_property
    def normals(self) -> Array:
        """Outward surface normals in the map's frame, shape (m, 3)."""
        return self.rotations[:, :, 2]

    def index(self, point: str | int) -> int:
        """Index of a point given by id (or by index, which is checked).

        Raises:
            UnknownPointError: If there is no such point.
        """
        if isinstance(point, str):
            if point in self._index:
                return self._index[point]
        elif isinstance(point, (int, np.integer)) and 0 <= point < len(self.ids):
            return int(point)
        raise UnknownPointError(point, self.ids)

    def subset(self, keep: BoolArray, name: str | None = None) -> GraspMap:
        """Map with only the points where `keep`, shape (m,), is true."""
        chosen = np.flatnonzero(keep)
        return GraspMap(
            ids=tuple(self.ids[i] for i in chosen),
            positions=self.positions[chosen],
            rotations=self.rotations[chosen],
            faces=tuple(self.faces[i] for i in chosen),
            cabin=self.cabin,
            name=name or self.name,
            segments=self.segments,
            handrails=self.handrails,
            boxes=self.boxes,
        )

    def sparse(
        self, seed: int, keep: tuple[str, ...] = (), clear_deck: tuple[float, float] | None = None
    ) -> GraspMap:
        """Half of the points by a seeded draw: the map of the paper's Case 4.

        Args:
            seed: Seed of the draw.
            keep: Ids that stay in any case (the start stance).
            clear_deck: Range of x [m] in which every deck point is dropped.
        """
        kept = np.zeros(len(self), dtype=bool)
        kept[np.random.default_rng(seed).permutation(len(self))[: len(self) // 2]] = True
        if clear_deck is not None:
            low, high = sorted(clear_deck)
            x = self.positions[:, 0]
            kept &= ~((np.array(self.faces) == "deck") & (x > low) & (x < high))
        kept[[self.index(point) for point in keep]] = True
        return self.subset(kept, name=f"{self.name}-sparse-{seed}")

    def check_goal(self, goal: Any) -> Array:
        """Return `goal` as an array of shape (3,) [m].

        Raises:
            GoalError: If it is not three finite numbers inside the cabin.
        """
        try:
            array = np.array(goal, dtype=np.float64)
        except (TypeError, ValueError):
            raise GoalError(f"goal {goal!r} must be three numbers x, y, z in metres") from None
        if array.shape != (3,) or not np.isfinite(array).all():
            raise GoalError(f"goal {array.tolist()} must be three finite numbers x, y, z in metres")
        low, high = self.cabin
        if (array < low).any() or (array > high).any():
            raise GoalError(
                f"goal {array.tolist()} lies outside the cabin, which reaches from {low.tolist()} "
                f"to {high.tolist()}"
            )
        return array

    @cached_property
    def fingerprint(self) -> str:
        """Hash of points and boxes: plans carry it, so that they are not used on another map."""
        digest = hashlib.sha256(
            "\n".join([*self.ids, *(f"{box.id} {box.kind}" for box in self.boxes)]).encode()
        )
        boxes = [[*box.centre, *box.half, *np.ravel(box.rotation)] for box in self.boxes]
        # Rounded, and no negative zeros: the last digits differ between machines.
        for array in (self.positions, self.rotations, np.array(boxes)):
            digest.update((np.round(array, 9) + 0.0).tobytes())
        return digest.hexdigest()[:16]

    def to_dict(self) -> dict[str, Any]:
        """The map as plain data for JSON, from which `from_dict` makes the same map."""
        return {
            "name": self.name, "ids": list(self.ids), "faces": list(self.faces),
            "positions": self.positions.tolist(), "rotations": self.rotations.tolist(),
            "cabin": self.cabin.tolist(),
            "segments": [asdict(segment) for segment in self.segments],
            "handrails": [
                {name: v for name, v in asdict(rail).items() if v is not None}
                for rail in self.handrails
            ],
            "boxes": [box.to_dict() for box in self.boxes],
        }  # fmt: skip

    @classmethod
    def load(
        cls, path: str | Path, spacing: float | None = None, clearance: float | None = None
    ) -> GraspMap:
        """Read a map from a JSON file; see `from_dict` for its fields.

        Raises:
            MapError: If the file cannot be read or any entry is faulty; the message names the
                entry.
        """
        data = read_json(path, "map", MapError)
        try:
            return cls.from_dict(data, spacing, clearance, name=Path(path).stem)
        except MlivrError as error:
            raise type(error)(f"map {str(path)!r}: {error}") from None

    @classmethod
    def from_dict(
        cls,
        data: Any,
        spacing: float | None = None,
        clearance: float | None = None,
        name: str = "map",
    ) -> GraspMap:
        """Build a map from parsed JSON.

        Fields (all lengths in [m]): `points` (list of `id`, `face`, `position`, `normal`, `rail`),
        `segments` (list of `id`, `face`, `start`, `end`, `normal`), `spacing` of points along
        segments (0.2), `handrails` (list of `id`, `face`, `min`, `max`), `clearance` round
        handrails inside which points are left out (0.03), `cabin` (`min`, `max`; by default the
        points' bounding box), `boxes` (whatever else the robot must not touch, see
        `Box.from_dict`), `name`. A point of a segment counts with the rail's width. What `to_dict`
        returns is known by its `ids` and taken as it is.

        Args:
            data: The parsed JSON object.
            spacing: Overrides the file's spacing [m].
            clearance: Overrides the file's clearance [m].
            name: Used when the data names none.
        """
        if not isinstance(data, dict):
            raise MapError("a map is a JSON object with 'points' or 'segments'")
        if "ids" in data:
            return _map_of_fields(data)
        spacing = given_number(spacing, data, "spacing", 0.2)
        if not 0.0 < spacing < float("inf"):
            raise SettingError(f"spacing is {spacing!r}; it must be finite and above 0")
        clearance = nonnegative("clearance", given_number(clearance, data, "clearance", 0.03))
        segments, handrails = _rails(data.get("segments", []), data.get("handrails", []))
        points = entries(data.get("points", []), "points", MapError, MOST_POINTS)
        rows = [point_of(entry, i) for i, entry in enumerate(points)]
        for segment in segments:
            rows.extend(discretise(segment, spacing, MOST_POINTS - len(rows)))
        rows = clear_of_handrails(rows, handrails, clearance)
        if not rows:
            raise MapError("the map has no graspable point")
        ids, faces, positions, rotations, _ = zip(*rows, strict=True)
        return cls(
            ids=ids,
            positions=np.array(positions),
            rotations=np.array(rotations),
            faces=faces,
            cabin=_cabin(data.get("cabin"), np.array(positions)),
            name=data.get("name", name),
            segments=segments,
            handrails=handrails,
            boxes=(
                *module_boxes(
                    data.get("scene", {}), entries(data.get("racks", []), "racks", MapError)
                ),
                *map(track_box, segments),
                *(box for rail in handrails for box in handrail_boxes(rail)),
                *boxes_from(data.get("boxes", []), "panel"),
            ),
        )


def jem_map(spacing: float = 0.2, clearance: float = 0.03) -> GraspMap:
    """Measured seat tracks of the JEM: 331 points with the default arguments."""
    return GraspMap.load(asset_path("jem.json"), spacing, clearance)


def as_map(given: str | Path | GraspMap | dict[str, Any] | None) -> GraspMap:
    """A map as it is, from plain data or a file, or the measured JEM for None.

    Raises:
        MapError: If the file or the data are faulty.
    """
    if given is None:
        return jem_map()
    if isinstance(given, dict):
        return GraspMap.from_dict(given)
    return given if isinstance(given, GraspMap) else GraspMap.load(given)


_FIELDS = (
    "name",
    "ids",
    "faces",
    "positions",
    "rotations",
    "cabin",
    "segments",
    "handrails",
    "boxes",
)
"""What `GraspMap.to_dict` writes."""


def _rails(segments: Any, handrails: Any) -> tuple[tuple[Segment, ...], tuple[Handrail, ...]]:
    """Rails and handrails from lists of plain data."""
    rails = entries(segments, "segments", MapError)
    bars = entries(handrails, "handrails", MapError)
    return (
        tuple(segment_of(entry, i) for i, entry in enumerate(rails)),
        tuple(handrail_of(entry, i) for i, entry in enumerate(bars)),
    )


def _cabin(given: Any, positions: Array) -> Array:
    """Lower and upper corner of the cabin [m], shape (2, 3), by default of all points."""
    if given is None:
        cabin = np.array([np.min(positions, axis=0), np.max(positions, axis=0)])
        flat = cabin[1] - cabin[0] < 1e-9
        cabin[0, flat] -= 1.0
        cabin[1, flat] += 1.0
        return cabin
    if not isinstance(given, dict):
        raise MapError("cabin must be an object with 'min' and 'max'")
    return np.array([vector_of(given, "min", "cabin"), vector_of(given, "max", "cabin")])


def _map_of_fields(data: dict[str, Any]) -> GraspMap:
    """The inverse of `GraspMap.to_dict`."""
    for name in (*_FIELDS, *data):
        if (name in data) != (name in _FIELDS):
            fault = "is missing" if name in _FIELDS else "is unknown"
            raise MapError(
                f"field {name!r} of the map {fault}; a map with 'ids' has {', '.join(_FIELDS)}"
            )
    ids, faces = (
        tuple(entries(data[name], name, MapError, MOST_POINTS)) for name in ("ids", "faces")
    )
    if not all(isinstance(name, str) for name in (*ids, *faces)):
        raise MapError("ids and faces must be lists of strings")
    if len(ids) != len(faces):
        raise MapError(f"the map has {len(ids)} ids but {len(faces)} faces")
    shapes = {"positions": (len(ids), 3), "rotations": (len(ids), 3, 3), "cabin": (2, 3)}
    arrays = {
        name: numbers(data[name], shape, name, MapError, LONGEST if name != "rotations" else np.inf)
        for name, shape in shapes.items()
    }
    boxes = boxes_from(data["boxes"], "panel")
    segments, handrails = _rails(data["segments"], data["handrails"])
    return GraspMap(
        ids=ids,
        positions=arrays["positions"],
        rotations=arrays["rotations"],
        faces=faces,
        cabin=arrays["cabin"],
        name=str(data["name"]),
        segments=segments,
        handrails=handrails,
        boxes=boxes,
    )
