"""Boxes that a robot knows, and which measured surface points they explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlivr_gym.arguments import Reader
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.schema import FieldPath, Numbers, Tuples
from mlivr_gym.values import MAX_LENGTH
from mlivr_gym.world import Box

EXPLAINED_DEVIATIONS = 5.0
"""Distance from a known box within which a hit belongs to it, in standard deviations."""

INSIDE = 0.03
"""Depth below the faces of a box at which a ray passes through it, for errors of poses [m]."""

PASSES = 20
"""Number of rays through a movable box after which it is gone, or on it after which it is seen."""

PARALLEL = 1e-12
"""Least length of a ray along an axis of a box, which stands for none [m]."""

ROUNDING = 1e-4
"""Distance added to this for the rounding of numbers [m]."""

NOISE = Tuples((), 0.0, 0.1, "m")
"""Validator of the standard deviation of a measured distance."""

MOST_HITS = 100_000_000
"""Maximum number of hits of one look."""


def _read_hits(value: object, place: FieldPath) -> Array:
    """Return hits as an array of shape (k, 3); rays that hit nothing must have been left out."""
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind == "f":
        is_finite = np.isfinite(value).all(axis=1)
        if not is_finite.all():
            first, count = int(np.argmin(is_finite)), int(np.sum(~is_finite))
            raise place.fault(
                f"has {count} of {len(value)} rows that are not finite, the first is row {first}, "
                f"{shortened(value[first].tolist())}; it must be finite positions [m], without "
                "rays that hit nothing"
            )
    return Numbers((None, 3), most=MAX_LENGTH, unit="m", rows=(0, MOST_HITS)).read(value, place)


HITS = Reader(_read_hits)
"""Validator of measured positions of surfaces in the module frame."""


def _entering_ball(centre: Array, square: float, hits: Array, origins: Array) -> IntArray:
    """Return the rays that enter a ball of a centre [m] and the square of a radius [m^2].

    A ball without a ray in it takes a fraction of the time of a box.
    """
    along, outwards = hits - origins, centre - origins
    length = np.einsum("ij,ij->i", along, along) + PARALLEL**2
    share = np.clip(np.einsum("ij,ij->i", outwards, along) / length, 0.0, 1.0)
    apart = outwards - share[:, None] * along
    return np.flatnonzero(np.einsum("ij,ij->i", apart, apart) <= square)


def passes_through(box: Box, hits: Array, origins: Array, noise: float) -> BoolArray:
    """Return which rays pass through a box, at least `INSIDE` below its faces, shape (k,).

    A ray that ends in the box, or within the noise behind it, does not. Through a box that is thin
    along one axis a ray passes from face to face, if it ends at least `INSIDE` behind it. Rays end
    at hits and begin at origins in the module frame [m], shape (k, 3) each; the noise is the
    standard deviation of a measured distance [m].
    """
    rotation, half = np.array(box.rotation), np.array(box.half) - INSIDE
    found, is_thin = np.zeros(len(hits), dtype=np.bool_), half <= 0.0
    if is_thin.sum() > 1:
        return found
    half = np.maximum(half, 0.0)
    rays = _entering_ball(np.array(box.centre), float(half @ half), hits, origins)
    begin, along = (origins[rays] - box.centre) @ rotation, (hits[rays] - origins[rays]) @ rotation
    is_behind = (np.abs(begin + along) > np.array(box.half) + INSIDE)[:, is_thin].all(axis=1)
    along = np.where(np.abs(along) < PARALLEL, PARALLEL, along)
    planes = np.stack([(-half - begin) / along, (half - begin) / along])
    entry = np.maximum(planes.min(axis=0).max(axis=1), 0.0)
    end = 1.0 - EXPLAINED_DEVIATIONS * noise / np.linalg.norm(along, axis=1)
    leave = planes.max(axis=0).min(axis=1)
    found[rays] = (entry <= leave) & (leave < end) & is_behind
    return found


def surface_distances(box: Box, positions: Array) -> Array:
    """Return the distances of positions (k, 3) from the surface of a box, shape (k,) [m]."""
    excess = np.abs((positions - box.centre) @ np.array(box.rotation)) - box.half
    outside = np.linalg.norm(np.maximum(excess, 0.0), axis=1)
    return np.asarray(np.where(outside > 0.0, outside, -excess.max(axis=1)))


def mark_around(cells: IntArray, reach: int, grid: BoolArray) -> None:
    """Mark the cubes of a grid that are at most `reach` cubes away from some cubes, (k, 3)."""
    if not len(cells):
        return
    low = np.maximum(cells.min(axis=0) - reach, 0)
    where = tuple(map(slice, low, cells.max(axis=0) + reach + 1))
    marked = np.zeros(grid[where].shape, dtype=np.bool_)
    marked[tuple((cells - low).T)] = True
    for axis in range(3):
        along = np.moveaxis(marked, axis, 0)
        begin = along.copy()
        for k in range(1, reach + 1):
            along[k:] |= begin[:-k]
            along[:-k] |= begin[k:]
    grid[where] |= marked


class KnownBoxes:
    """Boxes sorted by the cubes of a grid, so that a hit is compared with those at its cube."""

    def __init__(
        self,
        fixed: Sequence[Box],
        noise: float,
        grid: tuple[Array, float, tuple[int, ...]],
        movable: Sequence[Box] = (),
    ) -> None:
        """Sort boxes into the cubes of a grid that they explain in part.

        `noise` is the standard deviation of a measured distance [m]; the grid is given by its lower
        corner [m], the edge of a cube [m] and the number of cubes along each axis. Movable boxes
        may turn out to be gone.
        """
        self._origin, self._edge, self._shape = grid
        self._fixed, self._noise = tuple(fixed), noise
        self._passes = dict.fromkeys(movable, 0)  # the number of rays through each movable box
        self._hits = dict.fromkeys(movable, 0)  # the number of rays that end on it
        self._has_looked = False
        self._sort()

    @property
    def boxes(self) -> tuple[Box, ...]:
        """The boxes that are not gone."""
        return *self._fixed, *self._passes

    def see_through(self, hits: Array, origins: Array) -> list[str]:
        """Give up the movable boxes that `PASSES` rays have passed through; return their ids.

        The rays begin at `origins` and end at `hits`, both in the module frame [m], shape (k, 3).
        Raises a `SettingError` if there are not as many of both.
        """
        if len(origins) != len(hits):
            raise SettingError(
                f"origins has {len(origins)} rows; it must have {len(hits)}, as hits"
            )
        self._has_looked = True
        for box in self._passes:
            self._passes[box] += int(passes_through(box, hits, origins, self._noise).sum())
            if self._hits[box] < PASSES:
                self._hits[box] += int((surface_distances(box, hits) <= self._tolerance).sum())
        return self._give_up([box for box, count in self._passes.items() if count >= PASSES])

    def doubt(self) -> list[str]:
        """Give up the movable boxes that fewer than `PASSES` rays have hit; return their ids.

        None is given up before the first look.
        """
        unseen = [box for box in self._passes if self._hits[box] < PASSES]
        return self._give_up(unseen if self._has_looked else [])

    def _give_up(self, boxes: Sequence[Box]) -> list[str]:
        """Take movable boxes to be gone; return their ids."""
        for box in boxes:
            del self._passes[box]
        if boxes:
            self._sort()
        return [box.id for box in boxes]

    def _sort(self) -> None:
        """Sort the boxes into the cubes."""
        self._tolerance = EXPLAINED_DEVIATIONS * self._noise + ROUNDING
        # Large boxes come first, since they hide most.
        ordered = sorted(self.boxes, key=lambda box: -float(np.prod(box.half)))
        self._centre = np.array([box.centre for box in ordered]).reshape(-1, 3)
        self._half = np.array([box.half for box in ordered]).reshape(-1, 3)
        self._rotation = np.array([box.rotation for box in ordered]).reshape(-1, 3, 3)
        numbers, entries = np.arange(np.prod(self._shape)).reshape(self._shape), [np.zeros((0, 2))]
        for k, box in enumerate(ordered):
            low, high = (
                np.floor((bound - self._origin) / self._edge).astype(int).clip(0, self._shape)
                for bound in box.bounds + self._tolerance * np.array([[-1.0], [1.0]])
            )
            cubes = numbers[tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))].ravel()
            entries.append(np.stack([cubes, np.full(len(cubes), k)], axis=1))
        cube, self._box = np.concatenate(entries).astype(np.int64).T
        order = np.argsort(cube, kind="stable")
        self._box = self._box[order]
        self._start = np.searchsorted(cube[order], np.arange(numbers.size + 1))

    def unexplained(self, hits: Array) -> tuple[Array, IntArray]:
        """Return the hits in the grid that lie neither on nor in a box, and their cubes.

        Hits are measured positions of surfaces in the module frame [m], shape (k, 3); returned are
        r of them and the indices of their cubes along each axis, shape (r, 3) each.
        """
        cells = np.floor((hits - self._origin) / self._edge).astype(np.int64)
        inside = ((cells >= 0) & (cells < self._shape)).all(axis=1)
        hits, cells = hits[inside], cells[inside]
        cube = np.ravel_multi_index(tuple(cells.T), self._shape)
        following, end = self._start[cube], self._start[cube + 1]
        rest = np.arange(len(hits))
        explained = np.zeros(len(hits), dtype=np.bool_)
        while len(rest := rest[~explained[rest] & (following[rest] < end[rest])]):
            box = self._box[following[rest]]
            local = np.einsum("ki,kij->kj", hits[rest] - self._centre[box], self._rotation[box])
            excess = np.maximum(np.abs(local) - self._half[box], 0.0)
            explained[rest] = np.einsum("ij,ij->i", excess, excess) <= self._tolerance**2
            following[rest] += 1
        return hits[~explained], cells[~explained]
