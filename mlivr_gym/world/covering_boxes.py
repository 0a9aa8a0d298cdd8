"""Boxes that cover point clouds and capsules, so that these are obstacles as boxes are.

Obstacles are boxes, for which motions are certified. What has another shape is covered: a plan that
clears the boxes clears the shape, and each function states by how much the boxes exceed it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import ShapeError
from mlivr_gym.schema import NAME, Numbers, Tuples
from mlivr_gym.values import MAX_LENGTH, MIN_SIZE, as_triple
from mlivr_gym.world.boxes import CORNER, Box
from mlivr_gym.world.mesh_plates import merged_neighbours
from mlivr_gym.world.meshes import MOST_CUBES, RESOLUTION

MOST_POINTS = 10_000_000
"""Maximum number of points of a cloud."""

CLOUD = Numbers((None, 3), -MAX_LENGTH, MAX_LENGTH, "m", (0, MOST_POINTS))
"""Points of the world."""

POSITIVE = Tuples((), MIN_SIZE, MAX_LENGTH, "m")
"""A length of a shape."""


@checked({"points": CLOUD, "name": NAME, "resolution": POSITIVE}, ShapeError)
def point_cloud_boxes(
    points: Sequence[Sequence[float]] | Array,
    resolution: float = RESOLUTION,
    *,
    name: str = "cloud",
) -> tuple[Box, ...]:
    """Return boxes that cover the points of a depth camera or a laser scanner.

    Space is divided into cubes, those with a point are kept, and neighbours are merged. Every point
    lies in a box, and no point of a box is farther from a point of the cloud than the diagonal of a
    cube, `sqrt(3) * resolution`.

    The points in the world have shape (k, 3) [m], and the cubes have edges of `resolution` [m]; the
    ids of the boxes begin with `name`. Raises a `ShapeError` if a point is not finite or farther
    than `MAX_LENGTH`, if the shape is wrong, or if the cloud spans more cubes than are allowed.


    Examples
    --------
    >>> [box.id for box in point_cloud_boxes([(1.0, 0.0, 0.0), (1.01, 0.0, 0.0), (3.0, 0.0, 0.0)])]
    ['cloud0', 'cloud1']
    """
    if not len(points):
        return ()
    cells = np.floor(np.asarray(points) / resolution).astype(np.int64)
    first = cells.min(axis=0)
    shape = cells.max(axis=0) - first + 1
    if np.prod(shape.astype(float)) > MOST_CUBES:
        raise ShapeError(
            f"points span {' x '.join(map(str, shape))} cubes of {resolution:g} m; at most "
            f"{MOST_CUBES:,} are allowed: choose a larger resolution"
        )
    numbers = np.unique(np.ravel_multi_index((cells - first).T, shape))
    # NumPy sorts short integers several times faster.
    low = np.stack(np.unravel_index(numbers, shape), 1).astype(np.min_scalar_type(shape.max()))
    low, high = merged_neighbours(low, low + 1)
    return Box.each_between(
        name, "obstacle", (first + low) * resolution, (first + high) * resolution
    )


@checked({"name": NAME, "start": CORNER, "end": CORNER, "radius": POSITIVE}, ShapeError)
def capsule_box(name: str, start: Sequence[float], end: Sequence[float], radius: float) -> Box:
    """Return the smallest box that covers a capsule and has its axis, such as a strut or a limb.

    Along its sides the box exceeds the capsule by at most `(sqrt(2) - 1) * radius`, and at its
    corners by `(sqrt(3) - 1) * radius`.

    The axis leads from `start` to `end` [m], shape (3,) each; the capsule is a ball if they are the
    same. The radius is in [m], and the id of the box is its name. Raises a `ShapeError` if an
    argument cannot be used.
    """
    first, last = np.array(start, dtype=float), np.array(end, dtype=float)
    length = float(np.linalg.norm(last - first))
    axis = (last - first) / length if length > MIN_SIZE else np.array([1.0, 0.0, 0.0])
    aside = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    aside /= np.linalg.norm(aside)
    rotation = np.stack([axis, aside, np.cross(axis, aside)], axis=1)
    half = (0.5 * length + radius, radius, radius)
    return Box(name, "obstacle", as_triple(0.5 * (first + last)), half, Box.rows(rotation))
