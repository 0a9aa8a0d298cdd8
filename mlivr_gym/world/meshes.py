"""Boxes that cover the surface of a triangle mesh, for collision checks against a module's CAD.

Floors, walls and other flat parts become plates (`mesh_plates`). For the rest, space is divided
into cubes of one size. Each cube that a triangle touches is kept, and neighbouring cubes are merged
into boxes. So every point of the surface lies in a box, and no point of a box is farther from the
surface than the diagonal of a cube. The inside of a closed mesh stays free: it may be a cabin.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import FileName, checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.errors import MapError, path_shown, shortened
from mlivr_gym.extras import require
from mlivr_gym.schema import NAME, OrNone, Tuples
from mlivr_gym.values import MAX_LENGTH, MAX_PARTS, MIN_SIZE, as_triple
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.mesh_plates import Plates, areas, cubes_of_triangles, flat_parts

RESOLUTION = 0.05
"""Default edge of a cube [m]."""

MOST_CUBES = 20_000_000
"""Most cubes of the grid round a mesh: 20 MB."""

MOST_CELLS = 4_000_000
"""Largest surface of a mesh, in faces of a cube."""


FORMATS = (".glb", ".gltf", ".obj", ".ply", ".stl")
"""Suffixes of files of meshes."""

MESH_OPTIONS = {
    "resolution": Tuples((), 1e-3, MAX_LENGTH, "m"),
    "scale": Tuples((), MIN_SIZE, MAX_LENGTH),
}
"""Edge of the cubes, and metres per unit of the file."""


def largest_excess(resolution: float) -> float:
    """Return the largest distance [m] of a point of a box from the surface that it covers."""
    return float(np.sqrt(3.0)) * resolution


@checked({"path": FileName(), "name": OrNone(NAME), **MESH_OPTIONS}, MapError)
def mesh_boxes(
    path: str | Path,
    resolution: float = RESOLUTION,
    scale: float = 1.0,
    *,
    name: str | None = None,
) -> tuple[Box, ...]:
    """Return boxes that cover the surface of a mesh.

    The file is glTF, OBJ, STL or PLY, and needs the extra `mesh`; `scale` is metres per unit of the
    file, 0.001 for one in millimetres. The boxes consist of cubes with edges of `resolution` [m],
    see `largest_excess`; their ids begin with `name`, by default that of the file. Raises a
    `MapError` if an argument is faulty, or the file cannot be read, holds no triangle, is larger
    than a map may be, or needs more cubes or boxes than are allowed.
    """
    corners = _triangles(path) * scale
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    extent = float((high - low).max())
    if max(extent, float(np.abs(corners).max())) > MAX_LENGTH:
        raise MapError(
            f"mesh {path_shown(path)} is {extent:g} m long, a map at most {MAX_LENGTH:g} m; for a "
            "file in millimetres give scale 0.001"
        )
    # A margin of half a cube, so that faces of the mesh do not lie on those of cubes.
    origin = low - 0.5 * resolution
    counts = np.floor((high - origin) / resolution).astype(np.int64) + 1
    if counts.prod() > MOST_CUBES:
        raise MapError(
            f"mesh {path_shown(path)} is {extent:g} m long and needs {counts.prod():,} cubes of "
            f"{resolution:g} m, at most {MOST_CUBES:,} are allowed; give a larger resolution, or "
            "scale 0.001 for a file in millimetres"
        )
    cells = areas(corners).sum() / resolution**2
    if cells > MOST_CELLS:
        raise MapError(
            f"mesh {path_shown(path)} has a surface of {cells:,.0f} faces of cubes of "
            f"{resolution:g} m, at most {MOST_CELLS:,} are allowed; give a larger resolution"
        )
    plates, rest = flat_parts(corners, resolution)
    touched = np.zeros(counts, dtype=np.bool_)
    for cubes, _ in cubes_of_triangles((rest - origin) / resolution):
        touched[tuple(np.clip(cubes, 0, counts - 1).T)] = True
    whole = np.array(merged_cells(touched)).reshape(-1, 2, 3) * resolution + origin
    found = [*plates, Plates(np.eye(3), whole[:, 0], whole[:, 1])]
    count = sum(len(part.low) for part in found)
    if count > MAX_PARTS:
        raise MapError(
            f"mesh {path_shown(path)} needs {count:,} boxes at a resolution of "
            f"{resolution:g} m, at most {MAX_PARTS:,} are allowed; give a larger resolution"
        )
    return _boxes(found, f"{name or Path(path).stem}/")


def _boxes(found: list[Plates], name: str) -> tuple[Box, ...]:
    """Return the boxes of some frames; their ids are the name followed by a number."""
    boxes: list[Box] = []
    for rotation, low, high in found:
        upright = Box.each_between(name, "panel", low, high, len(boxes))
        if not np.array_equal(rotation, np.eye(3)):
            rows = Box.rows(rotation)
            upright = tuple(
                replace(box, centre=as_triple(rotation @ np.array(box.centre)), rotation=rows)
                for box in upright
            )
        boxes += upright
    return tuple(boxes)


def _triangles(path: str | Path) -> Array:
    """Return the corners of all triangles in the units of the file, shape (t, 3, 3)."""
    require("trimesh", extra="mesh")
    import trimesh

    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise MapError(
            f"mesh {path_shown(path)} has the suffix {shortened(suffix)}; valid ones are "
            f"{', '.join(FORMATS)}"
        )
    try:
        content = Path(path).read_bytes()
    except OSError as fault:
        reason = fault.strerror or str(fault)
        raise MapError(f"cannot read mesh {path_shown(path)}: {reason}") from None
    try:
        # Unprocessed, since processing leaves out triangles with corners that are not finite.
        mesh: Any = trimesh.load(path, force="mesh", process=False)
        corners = np.asarray(mesh.triangles, dtype=np.float64).reshape(-1, 3, 3)
    except Exception as fault:  # trimesh has no error type of its own, nor words for users
        kind = "glTF" if suffix.startswith(".gl") else suffix[1:].upper()
        reason = f"it is no {kind} file of triangles, or damaged"
        if isinstance(fault, FileNotFoundError) and str(fault).encode() in content:
            reason = f"it names the file {shortened(str(fault))}, which is missing"
        raise MapError(f"cannot read mesh {path_shown(path)}: {reason}") from None
    if not len(corners):
        raise MapError(f"mesh {path_shown(path)} holds no triangle")
    if not np.isfinite(corners).all():
        raise MapError(f"mesh {path_shown(path)} has a corner that is not finite")
    return corners


def merged_cells(touched: BoolArray) -> list[tuple[IntArray, IntArray]]:
    """Return boxes of whole cells that cover each marked cell once, and no other.

    Each box begins at the first marked cell that is not covered yet and grows along z, then y, then
    x.
    """
    # The cells along z as the bits of a number, the first one the lowest, by x and y.
    packed = np.packbits(touched, axis=2, bitorder="little").tolist()
    waiting = [[int.from_bytes(column, "little") for column in plane] for plane in packed]
    boxes = []
    for x, y in np.argwhere(touched.any(axis=2)).tolist():
        while rest := waiting[x][y]:
            z = (rest & -rest).bit_length() - 1
            above = rest >> z
            top = z + (~above & (above + 1)).bit_length() - 1
            cells = (1 << top) - (1 << z)
            side, end = y + 1, x + 1
            while side < touched.shape[1] and waiting[x][side] & cells == cells:
                side += 1
            while end < touched.shape[0] and all(
                one & cells == cells for one in waiting[end][y:side]
            ):
                end += 1
            for columns in waiting[x:end]:
                columns[y:side] = [one & ~cells for one in columns[y:side]]
            boxes.append((np.array([x, y, z]), np.array([end, side, top])))
    return boxes
