"""Cubes of a grid in which hits were counted, and those that rays pass through again.

Cubes with enough hits are obstacles, merged into boxes. Space carving frees a cube: in enough looks
since its last hit a ray has passed through its hits, within one standard deviation of their mean.
So what was there and went away is forgotten. As long as it is there, such a ray is not possible if
the hits are on a convex surface, and on another one rays beside it hit the cube in the same look.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.special import ndtri

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.extensions.closed_loop.known_boxes import EXPLAINED_DEVIATIONS, mark_around
from mlivr_gym.world import Box, merged_cells

CUBE = 0.05
"""Edge of the cubes [m]."""

FREEING_LOOKS = 10
"""Number of looks through the hits of a cube, since the last of these, after which it is free."""

THICKNESS = 0.001
"""Standard deviation of the hits of a cube below which their spread is not trusted [m]."""

FARTHEST_RAY = 0.05
"""Largest angle between the middle of the hits of a cube and a ray through them [rad]."""

LEAST_GROWTH = 0.005
"""Growth of a sensed box below which it is not told anew, even without a margin [m]."""

SENSED = "sensed"
"""First part of the ids of boxes that were sensed."""

_CUBES = np.dtype(
    [
        ("cell", np.int64, 3),  # index along each axis of the grid
        ("count", np.int64),  # number of hits
        ("passes", np.int64),  # number of looks through the hits since the last of them
        ("is_sure", np.bool_),  # whether it has enough hits
        ("sum", np.float64, 3),  # of the hits, from the middle of the cube [m]
        ("products", np.float64, (3, 3)),  # sum of their products [m^2]
        ("extent", np.float64, (2, 3)),  # of the hits: their negative minimum, and maximum [m]
        ("graph_extent", np.float64, (2, 3)),  # what the graph was told of it
        ("path_extent", np.float64, (2, 3)),  # what the check of the present path was told of it
        ("is_in_graph", np.bool_),
    ]
)


class Caution(NamedTuple):
    """How large sensed boxes are, and how much evidence they need."""

    margin: float
    """Distance by which a box extends beyond the hits in its cubes [m]."""
    hits: int
    """Number of hits that make a cube an obstacle; beside such a cube one hit is enough."""
    is_denoised: bool = False
    """Whether what the noise adds to the extent of the hits is taken away, see `Belief`."""
    is_merged: bool = True
    """Whether cubes are merged into boxes, which fill narrow gaps, or each is a box of its own."""


CAUTIONS = (
    Caution(0.01, 2),
    Caution(0.001, 2),
    Caution(0.001, 2, is_denoised=True),
    Caution(0.001, 3, is_denoised=True),
    Caution(0.001, 3, is_denoised=True, is_merged=False),
)
"""The first holds as long as there is a plan; then the robot has to be less cautious."""


class HitCubes:
    """The cubes with hits.

    `rows` are records of the n cubes, of which those that were freed have no hits; `is_solid` says
    which of them are obstacles.
    """

    def __init__(self, origin: Array, shape: tuple[int, ...], noise: float) -> None:
        """Begin without hits; the grid has a lower corner [m] and a number of cubes on each axis.

        `noise` is the standard deviation of a measured distance [m].
        """
        self._origin, self._noise = origin, noise
        self._row = np.full(shape, -1, dtype=np.int64)  # of each cube, -1 for one without hits
        self._is_beside = np.zeros(shape, dtype=np.bool_)  # touches a cube with enough hits
        self.rows = np.zeros(0, dtype=_CUBES)
        self.is_solid = np.zeros(0, dtype=np.bool_)

    def count(self, hits: Array, cells: IntArray) -> None:
        """Count hits in their cubes, shape (k, 3) each; a cube that has none yet gets a row."""
        number = np.ravel_multi_index(tuple(cells.T), self._row.shape)
        order = np.argsort(number)
        begins = np.flatnonzero(np.diff(number[order], prepend=-1))
        found, hits = cells[order[begins]], hits[order]
        rows: IntArray = self._row[tuple(found.T)]
        fresh = found[rows < 0]
        if len(fresh):
            rows[rows < 0] = len(self.rows) + np.arange(len(fresh))
            self._row[tuple(found.T)] = rows
            added = np.zeros(len(fresh), dtype=_CUBES)
            added["cell"] = fresh
            added["extent"] = added["graph_extent"] = added["path_extent"] = -np.inf
            self.rows = np.concatenate([self.rows, added])
        if len(rows):
            self.rows["passes"][rows] = 0
            self.rows["count"][rows] += np.diff(begins, append=len(number))
            both = np.maximum.reduceat(np.stack([-hits, hits], axis=1), begins)
            self.rows["extent"][rows] = np.maximum(self.rows["extent"][rows], both)
            local = hits - self.middles(cells[order])
            self.rows["sum"][rows] += np.add.reduceat(local, begins)
            products = local[:, :, None] * local[:, None]
            self.rows["products"][rows] += np.add.reduceat(products, begins)

    def middles(self, cells: IntArray) -> Array:
        """Return the middles of cubes, shape (k, 3) [m]."""
        return np.asarray(self._origin + CUBE * (cells + 0.5))

    def find_solid(self, hits: int) -> None:
        """Find the cubes that have enough hits, those beside them, and so the obstacles."""
        cubes, is_sure = self.rows, self.rows["count"] >= hits
        if (cubes["is_sure"] & ~is_sure).any():
            self._is_beside[:], cubes["is_sure"] = False, False
        mark_around(cubes["cell"][is_sure & ~cubes["is_sure"]], 1, self._is_beside)
        cubes["is_sure"] = is_sure
        self.is_solid = self._is_beside[tuple(cubes["cell"].T)] & (cubes["count"] > 0)

    def see_through(self, hits: Array, origins: Array) -> int:
        """Free the cubes that were looked through often enough; return how many obstacles.

        Call it after `count` with the hits of the same look: cubes that were hit begin anew. Rays
        end at hits and begin at origins [m], shape (k, 3) each; those of a camera begin at the same
        place and follow each other.
        """
        rows = np.flatnonzero(self.rows["count"])
        if not len(rows) or not len(hits):
            return 0
        cubes, looked = self.rows[rows], np.zeros(len(rows), dtype=np.bool_)
        mean = cubes["sum"] / cubes["count"][:, None]
        spread = cubes["products"] / cubes["count"][:, None, None]
        spread += THICKNESS**2 * np.eye(3) - mean[:, :, None] * mean[:, None]
        places = mean + self.middles(cubes["cell"]), np.linalg.inv(spread)
        begins = np.flatnonzero((np.diff(origins, axis=0, prepend=np.nan) != 0.0).any(axis=1))
        for begin, end in pairwise([*begins.tolist(), len(hits)]):
            looked |= self._is_looked_through(*places, hits[begin:end], origins[begin])
        self.rows["passes"][rows] += looked
        return self.free(FREEING_LOOKS)

    def free(self, looks: int) -> int:
        """Free the cubes that were looked through so often; return how many were obstacles.

        They are obstacles no longer after `find_solid`.
        """
        free = self.rows["passes"] >= looks
        for name in ("count", "passes", "sum", "products"):
            self.rows[name][free] = 0
        for name in ("extent", "path_extent"):
            self.rows[name][free] = -np.inf
        return int(self._is_beside[tuple(self.rows["cell"][free].T)].sum())

    def _is_looked_through(
        self, mean: Array, inverse: Array, hits: Array, origin: Array
    ) -> BoolArray:
        """Return through the hits of which cubes a ray of one camera passes, shape (k,).

        The hits of the cubes have means (k, 3) [m] and inverse covariances (k, 3, 3) [1 / m^2]. The
        ray whose direction is closest to the mean counts, if it ends far enough behind.
        """
        along, towards = hits - origin, mean - origin
        length, distance = np.linalg.norm(along, axis=1), np.linalg.norm(towards, axis=1)
        rays = along / length[:, None]
        tree = KDTree(rays, balanced_tree=False, compact_nodes=False)
        aims = towards / np.maximum(distance, CUBE)[:, None]
        _, nearest = tree.query(aims, distance_upper_bound=FARTHEST_RAY)
        found = np.flatnonzero(nearest < len(rays))
        behind = distance[found] + CUBE + EXPLAINED_DEVIATIONS * self._noise
        found = found[length[nearest[found]] >= behind]
        ray, aim, weight = rays[nearest[found]], towards[found], inverse[found]
        aim_square, product, ray_square = (
            np.einsum("ki,kij,kj->k", one, weight, other)
            for one, other in ((aim, aim), (aim, ray), (ray, ray))
        )
        passed = np.zeros(len(mean), dtype=np.bool_)
        passed[found] = aim_square - product**2 / ray_square <= 1.0
        return passed

    def has_grown(self, known: str, margin: float) -> BoolArray:
        """Return which cubes have grown beyond an extent that is known by a margin, shape (k,)."""
        grown = self.rows["extent"] > self.rows[known] + max(margin, LEAST_GROWTH)
        return np.asarray(grown.any(axis=(1, 2)))

    def boxes_of(
        self, chosen: BoolArray, there: BoolArray, caution: Caution, number: int = 0
    ) -> tuple[Box, ...]:
        """Return boxes that contain the hits in chosen cubes and the margin about them.

        They may contain other cubes that are there. A caution decides how large they are. Their ids
        count from a number.
        """
        if not chosen.any():
            return ()
        if caution.is_merged:
            cubes, begins = self._merged(chosen, there)
        else:
            cubes, begins = np.flatnonzero(chosen), np.arange(np.sum(chosen))
        extent = np.maximum.reduceat(self.rows["extent"][cubes], begins)
        below, high = extent.swapaxes(0, 1)
        count = np.add.reduceat(self.rows["count"][cubes], begins)
        excess = caution.is_denoised * self._noise * outermost(count)[:, None]
        inwards = np.minimum(excess, 0.5 * (high + below)) - caution.margin
        return Box.each_between(f"{SENSED}/", "obstacle", inwards - below, high - inwards, number)

    def _merged(self, chosen: BoolArray, there: BoolArray) -> tuple[IntArray, IntArray]:
        """Return the cubes in boxes of chosen cubes, and where those of each box begin."""
        cells = self.rows["cell"]
        corner, end = cells[chosen].min(axis=0), cells[chosen].max(axis=0) + 1
        inside = np.flatnonzero(there & ((cells >= corner) & (cells < end)).all(axis=1))
        row = np.full(end - corner, -1)
        row[tuple((cells[inside] - corner).T)] = inside
        is_chosen = np.zeros(row.shape, dtype=np.bool_)
        is_chosen[tuple((cells[chosen] - corner).T)] = True
        parts = []
        for first, last in merged_cells(is_chosen, row >= 0):
            where = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
            parts.append(row[where].ravel())
        return np.concatenate(parts), np.cumsum([0, *map(len, parts[:-1])])


def outermost(count: IntArray) -> Array:
    """Return the means of the largest of some standard normal numbers (Blom 1958)."""
    return np.asarray(ndtri((count - 0.375) / (count + 0.25)))
