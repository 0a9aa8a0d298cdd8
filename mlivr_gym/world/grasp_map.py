"""Graspable points of a module, and the structure around them.

A `GraspMap` is a frozen set of points in a frame of its own; the JEM's has its origin on the
centreline at the Node 2 end bulkhead, +x port, +y aft, +z overhead.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import SEED, FileName, Reader, WithError, checked
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import (
    GoalError,
    MapError,
    StanceError,
    UnknownPointError,
    path_shown,
    shortened,
)
from mlivr_gym.files import load, write_whole
from mlivr_gym.schema import FieldPath, ListOf, Numbers, OrNone, Tuples, are_rotations
from mlivr_gym.values import EqualByData, check_unique
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.csv_points import read_points
from mlivr_gym.world.joining import joined_fields, placed_maps
from mlivr_gym.world.map_entries import POINTS, map_fields, overrides
from mlivr_gym.world.rails import Handrail, Segment
from mlivr_gym.world.units import metres_per_unit


def _point_number(value: object) -> bool:
    """Return whether a value may be the index of a point."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _point(value: Any, place: FieldPath) -> str | int:
    """Return a point by id or index."""
    if not isinstance(value, str) and not _point_number(value):
        raise place.refused(value, "the id of a point, or its index")
    point: str | int = value
    return point


GOAL = WithError(GoalError, Numbers((3,)))
"""A goal position [m]."""

STANCE = WithError(StanceError, ListOf(Reader(_point)))
"""Points by id or index, such as that of each limb."""


@dataclass(frozen=True, repr=False, eq=False)
class GraspMap(EqualByData):
    """Graspable points and the surroundings they belong to.

    Attributes
    ----------
    ids
        m point ids, for example `"D4a:3"`.
    positions
        Points in the map's frame, which is the world [m], shape (m, 3).
    rotations
        Axes of the points in that frame, shape (m, 3, 3); columns are x along the rail,
        y, and z the outward surface normal.
    faces
        Name of the face that each point lies on, m of them.
    cabin
        Lower and upper corner of the space a base may be in [m], shape (2, 3).
    name
        Short name of the map.
    segments
        Rails that the points lie on.
    handrails
        Handrails.
    boxes
        Structure around the points: tracks, handrails, racks and walls.

    Examples
    --------
    >>> grasp_map = jem_map()
    >>> k = grasp_map.index("D2a:4")
    >>> len(grasp_map), grasp_map.faces[k], grasp_map.positions.shape
    (331, 'deck', (331, 3))
    """

    ids: tuple[str, ...]
    positions: Array
    rotations: Array
    faces: tuple[str, ...]
    cabin: Array
    name: str = "map"
    segments: tuple[Segment, ...] = ()
    handrails: tuple[Handrail, ...] = ()
    boxes: tuple[Box, ...] = ()

    def __post_init__(self) -> None:
        """Check shapes and values, and freeze the arrays."""
        place = FieldPath(f"map {shortened(self.name)}", MapError)
        if not len(self.ids):
            raise place.fault("has no graspable point")
        for name, kind in POINTS.required.items():
            object.__setattr__(self, name, kind.read(getattr(self, name), place.field(name)))
        check_unique(self.ids, "point", MapError)
        check_unique([box.id for box in self.boxes], "box", MapError)
        object.__setattr__(self, "_index", {point: i for i, point in enumerate(self.ids)})
        for name in ("faces", "positions", "rotations"):
            if len(getattr(self, name)) != len(self.ids):
                count = len(getattr(self, name))
                raise place.field(name).fault(f"are {count}, of {len(self.ids)} points")
        for array in (self.positions, self.rotations, self.cabin):
            array.setflags(write=False)
        faulty = np.flatnonzero(~are_rotations(self.rotations))
        if len(faulty):
            first = place.field("rotations").entry(int(faulty[0]))
            raise first.fault("must be a right-handed rotation matrix")
        if not (self.cabin[0] < self.cabin[1]).all():
            raise place.field("cabin").fault(f"{self.cabin.tolist()} must have its min below max")

    _index: dict[str, int] = field(init=False, compare=False, default_factory=dict)

    def __repr__(self) -> str:
        """Return name and sizes in one line."""
        return (
            f"<GraspMap {self.name!r}: {len(self)} points, {len(self.segments)} segments, "
            f"{len(self.handrails)} handrails, {len(self.boxes)} boxes>"
        )

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.ids)

    @cached_property
    def normals(self) -> Array:
        """Outward surface normals in the map's frame, shape (m, 3)."""
        return self.rotations[:, :, 2]

    def index(self, point: str | int) -> int:
        """Return the index of a point given by id, or by index, which is checked.

        Raises
        ------
        UnknownPointError
            If there is no such point.
        """
        if isinstance(point, str):
            if point in self._index:
                return self._index[point]
        elif _point_number(point) and 0 <= point < len(self.ids):
            return int(point)
        raise UnknownPointError(point, self.ids)

    def subset(self, keep: BoolArray, name: str | None = None) -> GraspMap:
        """Return the map with only the points for which `keep`, shape (m,), is true."""
        chosen = np.flatnonzero(keep)
        return replace(
            self,
            ids=tuple(self.ids[i] for i in chosen),
            positions=self.positions[chosen],
            rotations=self.rotations[chosen],
            faces=tuple(self.faces[i] for i in chosen),
            name=name or self.name,
        )

    @checked({"seed": SEED, "keep": STANCE, "clear_deck": OrNone(Tuples((2,)))})
    def sparse(
        self, seed: int, keep: tuple[str, ...] = (), clear_deck: tuple[float, float] | None = None
    ) -> GraspMap:
        """Draw half of the points, rounded down, as in Case 4 of the paper.

        Parameters
        ----------
        seed
            Seed of the draw.
        keep
            Ids that stay in any case (the start stance).
        clear_deck
            Range of x [m] in which no deck point is kept but those of `keep`; other points are
            kept in their place, if there are enough.
        """
        last = np.zeros(len(self), dtype=np.int64)
        if clear_deck is not None:
            low, high = sorted(clear_deck)
            x = self.positions[:, 0]
            last[(np.array(self.faces) == "deck") & (x > low) & (x < high)] = 2
        last[[self.index(point) for point in keep]] = -1
        drawn = np.random.default_rng(seed).permutation(len(self))
        drawn = drawn[np.argsort(last[drawn], kind="stable")]
        kept = np.zeros(len(self), dtype=bool)
        kept[drawn[: len(self) // 2]] = True
        kept &= last < 2
        return self.subset(kept, name=f"{self.name}-sparse-{seed}")

    def check_goal(self, goal: Any) -> Array:
        """Return `goal` as an array of shape (3,) [m].

        Raises
        ------
        GoalError
            If it is not three finite numbers inside the cabin.
        """
        array, (low, high) = GOAL.read(goal, FieldPath("goal", GoalError)), self.cabin
        if (array < low).any() or (array > high).any():
            raise GoalError(
                f"goal {array.tolist()} lies outside the cabin, which reaches from {low.tolist()} "
                f"to {high.tolist()} (field 'cabin' of the map)"
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
        """Return the map as plain data for JSON, from which `from_dict` builds the same map."""
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

        Raises
        ------
        MapError
            If the file cannot be read or any entry is faulty; the message names the
            entry.
        """
        given, file = overrides(spacing, clearance), _file(path)
        if file.suffix.lower() == ".csv":
            return cls.from_csv(file)

        def build(data: dict[str, Any]) -> GraspMap:
            return cls._made(map_fields(data, given, file.stem, file.parent), file.parent)

        return load(path, "map", MapError, build)

    @classmethod
    def from_csv(cls, path: str | Path, **surroundings: Any) -> GraspMap:
        """Read the points of a map from a table with columns id, x, y, z, nx, ny, nz, rx, ry, rz.

        Position, outward surface normal and direction of the rail; a column `face` may follow.

        Parameters
        ----------
        path
            The file.
        surroundings
            Other fields of a map file, such as `cabin`, `boxes` and `mesh`; `unit` is also that
            of the table.

        Raises
        ------
        MapError
            If the file cannot be read or a row is faulty; the message names its line.
        """
        path, root = _file(path), FieldPath("", MapError)
        points = {"points": read_points(path, metres_per_unit(surroundings, root))}
        place = FieldPath(f"map {path_shown(path)}", MapError)
        return place.build(cls.from_dict, surroundings | points, name=path.stem)

    def save(self, path: str | Path) -> None:
        """Write the map as JSON, whole or not at all; `load` reads the same map.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=1) + "\n")

    @classmethod
    def from_dict(
        cls,
        data: Any,
        spacing: float | None = None,
        clearance: float | None = None,
        name: str = "map",
    ) -> GraspMap:
        """Build a map from parsed JSON.

        All fields are optional, see "File formats" in the documentation. Points whose rail, with
        its width, is closer to a handrail on the same face than the clearance are left out. Data
        with a field `ids` are those of `to_dict`, in which nothing is left out.

        Parameters
        ----------
        data
            The parsed JSON object.
        spacing
            Overrides the file's spacing [m].
        clearance
            Overrides the file's clearance [m].
        name
            Used when the data names none.

        Raises
        ------
        MapError
            If the data are faulty; the message names the field.
        SettingError
            If spacing or clearance are.
        """
        given = overrides(spacing, clearance)
        place = FieldPath("", MapError)
        return place.build(lambda: cls._made(map_fields(data, given, name, Path()), Path()))

    @classmethod
    def _made(cls, fields: dict[str, Any], folder: Path) -> GraspMap:
        """Return the map of some fields; files that its parts name lie in `folder`."""
        parts = placed_maps(fields.pop("parts", ()), folder, PLACES, as_map)
        return cls(**(joined_fields(fields, parts) if parts else fields))


_PLACE = FieldPath("map", MapError)


def _file(path: object) -> Path:
    """Return the path of a map file."""
    return Path(FileName().read(path, FieldPath("path", MapError)))


def jem_map(spacing: float = 0.2, clearance: float = 0.03) -> GraspMap:
    """Return the measured seat tracks of the JEM, 331 points with the default arguments."""
    return GraspMap.load(asset_path("jem.json"), spacing, clearance)


PLACES = ("jem", "truss", "uslab", "columbus", "hatch", "station")
"""Names of the maps that ship."""


def as_map(given: Any, place: FieldPath = _PLACE) -> GraspMap:
    """Return a map as it is, by name, from plain data or a file, or the measured JEM for None.

    A name is one of `PLACES`.

    Raises
    ------
    MlivrError
        If the name is unknown, the file or the data are faulty, or it is none of these.

    Examples
    --------
    >>> as_map("uslab").name
    'uslab'
    """
    if given is None:
        return jem_map()
    if isinstance(given, str) and given in PLACES:
        return GraspMap.load(asset_path(f"{given}.json"))
    if isinstance(given, str) and given.isidentifier() and not os.path.exists(given):
        raise MapError(
            f"unknown map {shortened(given)}; valid names are {', '.join(PLACES)}, or give the "
            "path of a JSON or CSV file"
        )
    if isinstance(given, dict):
        return place.build(GraspMap.from_dict, given)
    if isinstance(given, (str, os.PathLike)):
        return GraspMap.load(FileName().read(given, place))
    if not isinstance(given, GraspMap):
        raise place.refused(given, "a GraspMap, its plain data, or the path of its file")
    return given


MAP = WithError(MapError, Reader(as_map))
"""A map as `as_map` takes it."""
