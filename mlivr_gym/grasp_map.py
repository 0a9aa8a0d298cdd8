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
from numpy.typing import NDArray

from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import GoalError, MapError, MlivrError, SettingError, UnknownPointError, nonnegative, shown
from mlivr_gym.files import read_json
from mlivr_gym.shapes import Box, boxes_from, once
from mlivr_gym.surroundings import handrail_boxes, module_boxes, track_box
from mlivr_gym.values import (
    LONGEST,
    MOST_POINTS,
    entries,
    number,
    numbers,
    rotation,
    text,
)

FACES = ("deck", "forward", "aft", "overhead", "starboard", "port")
"""Names of the cabin's six faces."""

UNIT_TOLERANCE = 1e-6
"""Largest deviation of a unit vector's length, and of its right angles, from 1 and 0."""


@dataclass(frozen=True)
class Segment:
    """A straight rail along which points may be grasped, ends in [m]."""

    id: str
    face: str
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    normal: tuple[float, float, float]
    width: float = 0.0256
    thickness: float = 0.013


@dataclass(frozen=True)
class Handrail:
    """A handrail: its bounding box with posts, and the bar alone, in [m]."""

    id: str
    face: str
    min: tuple[float, float, float]
    max: tuple[float, float, float]
    axis: str = "x"
    bar_min: tuple[float, float, float] | None = None
    bar_max: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class GraspMap:
    """Graspable points and the surroundings they belong to.

    Attributes:
        ids: m point ids, for example `"D4a:3"`.
        positions: Shape (m, 3), in the JEM frame [m].
        rotations: Shape (m, 3, 3); columns are x along the rail, y, and z the outward surface normal.
        faces: m names out of `FACES`.
        cabin: Shape (2, 3); lower and upper corner of the space a base may be in [m].
        name: Short name of the map.
        segments: Rails that the points lie on.
        handrails: Handrails.
        boxes: What stands round the points: tracks and handrails, racks and walls.
    """

    ids: tuple[str, ...]
    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]
    faces: tuple[str, ...]
    cabin: NDArray[np.float64]
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
        once(self.ids, "point", MapError)
        once([box.id for box in self.boxes], "box", MapError)
        object.__setattr__(self, "_index", {point: i for i, point in enumerate(self.ids)})
        for attribute, shape in (("positions", (m, 3)), ("rotations", (m, 3, 3)), ("cabin", (2, 3))):
            array = np.array(getattr(self, attribute), dtype=np.float64)
            if array.shape != shape:
                raise MapError(f"{attribute} must have shape {shape}, not {array.shape}")
            array.setflags(write=False)
            object.__setattr__(self, attribute, array)
        for point, face, position, turn in zip(self.ids, self.faces, self.positions, self.rotations, strict=True):
            _check_point(point, face, position, turn)
        numbers(self.cabin, (2, 3), "cabin", MapError, LONGEST)
        if not (self.cabin[0] < self.cabin[1]).all():
            raise MapError(f"cabin {self.cabin.tolist()} must have its min below max")

    _index: dict[str, int] = field(init=False, repr=False, compare=False, default_factory=dict)

    def __len__(self) -> int:
        """Number of points."""
        return len(self.ids)

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """Outward surface normals, shape (m, 3)."""
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

    def subset(self, keep: NDArray[np.bool_], name: str | None = None) -> GraspMap:
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

    def sparse(self, seed: int, keep: tuple[str, ...] = (), clear_deck: tuple[float, float] | None = None) -> GraspMap:
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

    def check_goal(self, goal: Any) -> NDArray[np.float64]:
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
                f"goal {array.tolist()} lies outside the cabin, which reaches from {low.tolist()} to {high.tolist()}"
            )
        return array

    @cached_property
    def fingerprint(self) -> str:
        """Hash of points and boxes: plans carry it, so that they are not used on another map."""
        digest = hashlib.sha256("\n".join([*self.ids, *(f"{box.id} {box.kind}" for box in self.boxes)]).encode())
        boxes = [[*box.centre, *box.half, *np.ravel(box.rotation)] for box in self.boxes]
        # Rounded, and no negative zeros: the last digits differ between machines.
        for array in (self.positions, self.rotations, np.array(boxes)):
            digest.update((np.round(array, 9) + 0.0).tobytes())
        return digest.hexdigest()[:16]

    def to_dict(self) -> dict[str, Any]:
        """The map as plain data for JSON: `from_dict` makes the same map of it, to the last digit."""
        return {
            "name": self.name, "ids": list(self.ids), "faces": list(self.faces),
            "positions": self.positions.tolist(), "rotations": self.rotations.tolist(),
            "cabin": self.cabin.tolist(),
            "segments": [asdict(segment) for segment in self.segments],
            "handrails": [
                {name: v for name, v in asdict(rail).items() if v is not None} for rail in self.handrails
            ],
            "boxes": [box.to_dict() for box in self.boxes],
        }  # fmt: skip

    @classmethod
    def load(cls, path: str | Path, spacing: float | None = None, clearance: float | None = None) -> GraspMap:
        """Read a map from a JSON file; see `from_dict` for its fields.

        Raises:
            MapError: If the file cannot be read or any entry is faulty; the message names the entry.
        """
        data = read_json(path, "map", MapError)
        try:
            return cls.from_dict(data, spacing, clearance, name=Path(path).stem)
        except MlivrError as error:
            raise type(error)(f"map {str(path)!r}: {error}") from None

    @classmethod
    def from_dict(
        cls, data: Any, spacing: float | None = None, clearance: float | None = None, name: str = "map"
    ) -> GraspMap:
        """Build a map from parsed JSON.

        Fields (all lengths in [m]): `points` (list of `id`, `face`, `position`,
        `normal`, `rail`), `segments` (list of `id`, `face`, `start`, `end`,
        `normal`), `spacing` of points along segments (0.2), `handrails` (list
        of `id`, `face`, `min`, `max`), `clearance` round handrails inside which
        points are left out (0.03), `cabin` (`min`, `max`; by default the points'
        bounding box), `boxes` (whatever else the robot must not touch, see `Box.from_dict`), `name`.
        A point of a segment counts with the rail's width. What `to_dict` returns is known by its
        `ids` and taken as it is.

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
        spacing = _given(spacing, data, "spacing", 0.2)
        if not 0.0 < spacing < float("inf"):
            raise SettingError(f"spacing is {spacing!r}; it must be finite and above 0")
        clearance = nonnegative("clearance", _given(clearance, data, "clearance", 0.03))
        segments = tuple(
            _segment(entry, i) for i, entry in enumerate(entries(data.get("segments", []), "segments", MapError))
        )
        handrails = tuple(
            _handrail(entry, i) for i, entry in enumerate(entries(data.get("handrails", []), "handrails", MapError))
        )
        points = entries(data.get("points", []), "points", MapError, MOST_POINTS)
        rows = [_point(entry, i) for i, entry in enumerate(points)]
        for segment in segments:
            rows.extend(_discretise(segment, spacing, MOST_POINTS - len(rows)))
        rows = _clear_of_handrails(rows, handrails, clearance)
        if not rows:
            raise MapError("the map has no graspable point")
        ids, faces, positions, rotations, _ = zip(*rows, strict=True)
        box = data.get("cabin")
        if box is None:
            cabin = np.array([np.min(positions, axis=0), np.max(positions, axis=0)])
            flat = cabin[1] - cabin[0] < 1e-9
            cabin[0, flat] -= 1.0
            cabin[1, flat] += 1.0
        else:
            if not isinstance(box, dict):
                raise MapError("cabin must be an object with 'min' and 'max'")
            cabin = np.array([_vector(box, "min", "cabin"), _vector(box, "max", "cabin")])
        return cls(
            ids=ids,
            positions=np.array(positions),
            rotations=np.array(rotations),
            faces=faces,
            cabin=cabin,
            name=data.get("name", name),
            segments=segments,
            handrails=handrails,
            boxes=(
                *module_boxes(data.get("scene", {}), entries(data.get("racks", []), "racks", MapError)),
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


_FIELDS = ("name", "ids", "faces", "positions", "rotations", "cabin", "segments", "handrails", "boxes")
"""What `GraspMap.to_dict` writes."""


def _map_of_fields(data: dict[str, Any]) -> GraspMap:
    """The inverse of `GraspMap.to_dict`."""
    for name in (*_FIELDS, *data):
        if (name in data) != (name in _FIELDS):
            fault = "is missing" if name in _FIELDS else "is unknown"
            raise MapError(f"field {name!r} of the map {fault}; a map with 'ids' has {', '.join(_FIELDS)}")
    ids, faces = (tuple(entries(data[name], name, MapError, MOST_POINTS)) for name in ("ids", "faces"))
    if not all(isinstance(name, str) for name in (*ids, *faces)):
        raise MapError("ids and faces must be lists of strings")
    if len(ids) != len(faces):
        raise MapError(f"the map has {len(ids)} ids but {len(faces)} faces")
    shapes = {"positions": (len(ids), 3), "rotations": (len(ids), 3, 3), "cabin": (2, 3)}
    arrays = {
        name: numbers(data[name], shape, name, MapError, LONGEST if name != "rotations" else np.inf)
        for name, shape in shapes.items()
    }
    return GraspMap(
        ids=ids, faces=faces, positions=arrays["positions"], rotations=arrays["rotations"],
        cabin=arrays["cabin"], name=str(data["name"]), boxes=boxes_from(data["boxes"], "panel"),
        segments=tuple(
            _segment(entry, i) for i, entry in enumerate(entries(data["segments"], "segments", MapError))
        ),
        handrails=tuple(
            _handrail(entry, i) for i, entry in enumerate(entries(data["handrails"], "handrails", MapError))
        ),
    )  # fmt: skip


_Row = tuple[str, str, NDArray[np.float64], NDArray[np.float64], float]
"""Id, face, position, rotation, width of the rail across [m]."""


def _check_point(point: str, face: str, position: NDArray[np.float64], turn: NDArray[np.float64]) -> None:
    text(point, "the id of a point", MapError)
    if face not in FACES:
        raise MapError(f"point {point!r}: unknown face {shown(face)}; valid faces are {', '.join(FACES)}")
    numbers(position, (3,), f"point {point!r}: position", MapError, LONGEST)
    rotation(turn, f"point {point!r}: rotation", MapError)


def _frame(where: str, rail: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    length = float(np.linalg.norm(normal))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise MapError(f"{where}: normal {normal.tolist()} has length {length:.6g}; it must be 1")
    if not np.linalg.norm(rail) > 1e-9:
        raise MapError(f"{where}: the rail has no direction")
    rail = rail / np.linalg.norm(rail)
    if abs(float(rail @ normal)) > UNIT_TOLERANCE:
        raise MapError(f"{where}: the rail must be at right angles to normal {normal.tolist()}")
    return np.column_stack([rail, np.cross(normal, rail), normal])


def _discretise(segment: Segment, spacing: float, room: int) -> list[_Row]:
    """Points at multiples of `spacing` either side of the segment's middle, about `room` at most."""
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
        (f"{segment.id}:{k + half}", segment.face, middle + k * spacing * frame[:, 0], frame, segment.width)
        for k in range(-half, half + 1)
    ]


def _clear_of_handrails(rows: list[_Row], handrails: tuple[Handrail, ...], clearance: float) -> list[_Row]:
    """Points whose rail's strip keeps `clearance` from the footprint of each handrail on the face."""
    if not rows:
        return []
    faces, positions = np.array([row[1] for row in rows]), np.array([row[2] for row in rows])
    frames, width = np.array([row[3] for row in rows]), np.array([row[4] for row in rows])
    reach = clearance + 0.5 * width[:, None] * np.abs(frames[:, :, 1])
    across = np.abs(frames[:, :, 2]) >= 0.5
    free = np.ones(len(rows), dtype=np.bool_)
    for rail in handrails:
        inside = (np.array(rail.min) - reach <= positions) & (positions <= np.array(rail.max) + reach)
        free &= ~((faces == rail.face) & (inside | across).all(axis=1))
    return [row for row, kept in zip(rows, free, strict=True) if kept]


def _given(argument: float | None, data: dict[str, Any], key: str, default: float) -> float:
    """The argument, or what the data says in its place."""
    if argument is not None:
        return number(argument, key, SettingError)
    return number(data.get(key, default), key, MapError)


def _vector(entry: dict[str, Any], key: str, where: str) -> NDArray[np.float64]:
    if key not in entry:
        raise MapError(f"{where}: {key!r} is missing")
    return numbers(entry[key], (3,), f"{where}: {key}", MapError, LONGEST)


def _triple(entry: dict[str, Any], key: str, where: str) -> tuple[float, float, float]:
    x, y, z = _vector(entry, key, where).tolist()
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


def _point(entry: Any, i: int) -> _Row:
    point, face, where = _header(entry, "point", i)
    rotation = _frame(where, _vector(entry, "rail", where), _vector(entry, "normal", where))
    return point, face, _vector(entry, "position", where), rotation, 0.0


def _segment(entry: Any, i: int) -> Segment:
    segment, face, where = _header(entry, "segment", i)
    return Segment(
        id=segment,
        face=face,
        start=_triple(entry, "start", where),
        end=_triple(entry, "end", where),
        normal=_triple(entry, "normal", where),
        width=number(entry.get("width", 0.0256), f"{where}: width", MapError, LONGEST),
        thickness=number(entry.get("thickness", 0.013), f"{where}: thickness", MapError, LONGEST),
    )


def _handrail(entry: Any, i: int) -> Handrail:
    rail, face, where = _header(entry, "handrail", i)
    bar, axis = "bar_min" in entry and "bar_max" in entry, entry.get("axis", "x")
    if axis not in ("x", "y", "z"):
        raise MapError(f"{where}: unknown axis {shown(axis)}; valid axes are x, y, z")
    return Handrail(
        id=rail,
        face=face,
        min=_triple(entry, "min", where),
        max=_triple(entry, "max", where),
        axis=axis,
        bar_min=_triple(entry, "bar_min", where) if bar else None,
        bar_max=_triple(entry, "bar_max", where) if bar else None,
    )
