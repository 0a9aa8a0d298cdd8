"""Graspable points of a module, and the structure around them.

A `GraspMap` is a frozen set of points in a frame of its own; the JEM's has its origin on the
centreline at the Node 2 end bulkhead, +x port, +y aft, +z overhead.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import SEED, FileName, Reader, WithError, checked
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import (
    GoalError,
    MapError,
    UnknownPointError,
    path_shown,
    shortened,
)
from mlivr_gym.files import load, read_json, write_whole
from mlivr_gym.schema import Anything, FieldPath, OrNone, Tuples
from mlivr_gym.values import EqualByData
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.csv_points import read_points
from mlivr_gym.world.given_points import GOAL, STANCE, is_point_number
from mlivr_gym.world.joining import joined_fields, placed_maps
from mlivr_gym.world.map_entries import (
    CLEARANCE,
    SPACING,
    UNIT_OF_LENGTH,
    map_fields,
    plain_fields,
    whole_fields,
)
from mlivr_gym.world.rails import Handrail, Segment

FILE = WithError(MapError, FileName())
"""The path of a map file."""


@dataclass(frozen=True, repr=False, eq=False)
class GraspMap(EqualByData):
    """Graspable points and the surroundings they belong to.

    Examples
    --------
    >>> grasp_map = jem_map()
    >>> k = grasp_map.index("D2a:4")
    >>> len(grasp_map), grasp_map.faces[k], grasp_map.positions.shape
    (331, 'deck', (331, 3))
    """

    ids: tuple[str, ...]
    """m point ids, for example `"D4a:3"`."""
    positions: Array
    """Points in the map's frame, which is the world [m], shape (m, 3)."""
    rotations: Array
    """Axes of the points in that frame, shape (m, 3, 3); columns are x along the rail, y, and z the
    outward surface normal."""
    faces: tuple[str, ...]
    """Name of the face that each point lies on, m of them."""
    cabin: Array
    """Lower and upper corner of the space a base may be in [m], shape (2, 3)."""
    name: str = "map"
    """Short name of the map."""
    segments: tuple[Segment, ...] = ()
    """Rails that the points lie on."""
    handrails: tuple[Handrail, ...] = ()
    """Handrails."""
    boxes: tuple[Box, ...] = ()
    """Structure around the points: tracks, handrails, racks and walls."""

    def __post_init__(self) -> None:
        """Check shapes and values, and freeze the arrays."""
        place = FieldPath(f"map {shortened(self.name)}", MapError)
        for name, value in whole_fields(vars(self), place).items():
            object.__setattr__(self, name, value)
        for array in (self.positions, self.rotations, self.cabin):
            array.setflags(write=False)
        object.__setattr__(self, "_index", {point: i for i, point in enumerate(self.ids)})

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

        Raises an `UnknownPointError` if there is no such point.
        """
        if isinstance(point, str):
            if point in self._index:
                return self._index[point]
        elif is_point_number(point) and 0 <= point < len(self.ids):
            return int(point)
        raise UnknownPointError(point, self.ids)

    @checked(error=MapError)
    def subset(self, keep: BoolArray, name: str | None = None) -> GraspMap:
        """Return the map with only the points for which `keep`, shape (m,), is true."""
        if keep.shape != (len(self),):
            raise MapError(f"keep has shape {keep.shape}; it must have shape ({len(self)},)")
        chosen = np.flatnonzero(keep)
        return replace(
            self,
            ids=tuple(self.ids[i] for i in chosen),
            positions=self.positions[chosen],
            rotations=self.rotations[chosen],
            faces=tuple(self.faces[i] for i in chosen),
            name=self.name if name is None else name,
        )

    @checked({"seed": SEED, "keep": STANCE, "clear_deck": OrNone(Tuples((2,)))})
    def sparse(
        self, seed: int, keep: tuple[str, ...] = (), clear_deck: tuple[float, float] | None = None
    ) -> GraspMap:
        """Draw half of the points, rounded down, as in Case 4 of the paper.

        The ids in `keep` stay in any case (the start stance). In the range `clear_deck` of x [m] no
        deck point is kept but those; other points are kept in their place, if there are enough.
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

        Raises a `GoalError` if it is not three finite numbers inside the cabin.
        """
        array, (low, high) = GOAL.read(goal, FieldPath("goal", GoalError)), self.cabin
        if (array < low).any() or (array > high).any():
            nearest = np.clip(array, low, high)
            raise GoalError(
                f"goal {array.tolist()} lies {np.linalg.norm(array - nearest):.3f} m outside the "
                f"cabin, which reaches from {low.tolist()} to {high.tolist()} (field 'cabin' of "
                f"the map); the nearest position inside is {nearest.tolist()}"
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
        return plain_fields(vars(self))

    @classmethod
    @checked({"path": FILE, "unit": OrNone(UNIT_OF_LENGTH)})
    def load(cls, path: str | Path, *, unit: str | None = None) -> GraspMap:
        """Read a map from a JSON file, see `from_dict` for its fields, or from a CSV table.

        The unit is that of the lengths in the file, such as `"mm"` or `"in"`, if it does not name
        one. Raises a `MapError` if the file cannot be read, or an entry is faulty, which is named,
        and a `SettingError` if the unit is unknown.
        """
        file = Path(path)
        if file.suffix.lower() == ".csv":
            return cls.from_csv(file, **({} if unit is None else {"unit": unit}))
        made = partial(cls._made, unit=unit, name=file.stem, folder=file.parent)
        return load(path, "map", MapError, made)

    @classmethod
    @checked({"path": FILE})
    def from_csv(cls, path: str | Path, **surroundings: Any) -> GraspMap:
        """Read the points of a map from a table with columns id, x, y, z, nx, ny, nz, rx, ry, rz.

        Position, outward surface normal and direction of the rail; a column `face` may follow.

        The surroundings are other fields of a map file, such as `cabin`, `boxes` and `mesh`; `unit`
        is also that of the table. Raises a `MapError` if the file cannot be read or a row is
        faulty, with its line; or if points are given.
        """
        file = Path(path)
        points = read_points(file, surroundings)
        place = FieldPath(f"map {path_shown(path)}", MapError)
        return place.build(cls.from_dict, surroundings | {"points": points}, name=file.stem)

    @classmethod
    @checked({"path": FILE, "scale": Anything(), "resolution": Anything()})
    def from_mesh(
        cls, path: str | Path, *, scale: float = 1, resolution: float | None = None, **entries: Any
    ) -> GraspMap:
        """Make a map of a triangle mesh, whose surface the robot must not touch, and of its rails.

        Boxes cover the surface; they exceed it by at most `mesh_boxes.largest_excess(resolution)`.

        The file is glTF, OBJ, STL or PLY, and needs the extra `mesh`; `scale` is metres per unit of
        the mesh, 0.001 for one in millimetres. `resolution` is the edge of the cubes in the unit of
        the map, by default 0.05 m. Entries are other fields of a map file, such as `segments`, the
        rails that carry points, and `unit`, the unit of all lengths but those in the mesh. Raises a
        `MapError` if the mesh cannot be read or covered, or an entry is faulty.
        """
        finer = {} if resolution is None else {"resolution": resolution}
        mesh = {"file": path, "scale": scale, **finer}
        return cls.from_dict(entries | {"mesh": mesh}, name=Path(path).stem)

    def save(self, path: str | Path) -> None:
        """Write the map as JSON, whole or not at all; `load` reads the same map.

        Raises a `FileError` if the file cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=1) + "\n")

    @classmethod
    def from_dict(cls, data: Any, name: str = "map") -> GraspMap:
        """Build a map from parsed JSON.

        All fields are optional, see "File formats" in the documentation. Points whose rail, with
        its width, is closer to a handrail on the same face than the clearance are left out. Data
        with a field `ids` are those of `to_dict`, in which nothing is left out.

        The name is used when the data name none. Raises a `MapError` that names the field if the
        data are faulty.
        """
        return FieldPath("", MapError).build(cls._made, data, None, name, Path())

    @classmethod
    def _made(cls, data: Any, unit: str | None, name: str, folder: Path) -> GraspMap:
        """Return the map of plain data, see `map_fields`."""
        fields = map_fields(data, unit, name, folder)
        parts = placed_maps(fields.pop("parts", ()), folder, PLACES, as_map)
        return cls(**(joined_fields(fields, parts) if parts else fields))


_PLACE = FieldPath("map", MapError)


@checked({"spacing": SPACING, "clearance": CLEARANCE})
def jem_map(spacing: float = 0.2, clearance: float = 0.03) -> GraspMap:
    """Return the measured seat tracks of the JEM, 331 points with the default arguments.

    Points are `spacing` apart along a track, and keep a clearance from handrails [m].
    """
    data = read_json(asset_path("jem.json"), "map", MapError)
    return GraspMap.from_dict(data | {"spacing": spacing, "clearance": clearance}, "jem")


PLACES = ("jem", "truss", "uslab", "columbus", "hatch", "station")
"""Names of the maps that ship."""


def as_map(given: Any, place: FieldPath = _PLACE) -> GraspMap:
    """Return a map as it is, by name, from plain data or a file, or the measured JEM for None.

    A name is one of `PLACES`.

    Raises an `MlivrError` if the name is unknown, the file or the data are faulty, or it is none of
    these.


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
