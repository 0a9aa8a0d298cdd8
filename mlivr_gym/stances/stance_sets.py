"""Sets of points that the limbs of a robot may hold at once, in any order of the limbs.

Every node holds such a set, see `postures.reach`, and a step changes one of its points. So the
smallest number of changes between two sets is a lower bound of the steps of a path, and a stance
that holds no such set is no node: searches of three limbs without a node table use both, and node
tables are built from them. The sets of a map and robot are computed once and stored.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.postures import reach
from mlivr_gym.stances.checked_steps import CheckedSteps
from mlivr_gym.stances.node_table import codes
from mlivr_gym.stances.parts import Progress
from mlivr_gym.stances.stance_postures import StancePostures
from mlivr_gym.stances.table_files import Arrays, TableFiles, check_arrays

LARGEST_SET = 4
"""Largest number of points of a set, whose indices fit into 64 bits."""

MOST_SETS = 40_000_000
"""Largest number of sets of points close enough to be checked; four limbs on the JEM have 11
million."""


@dataclass(frozen=True)
class StanceSets:
    """Sets of points that may be held at once."""

    points: NDArray[np.uint16]
    """Points of each set, ascending, the sets in the order of their codes, shape (n, N)."""
    support_sets: NDArray[np.int32]
    """Number of the support set that remains of each set without one of its points: sets with a
    common support set are one step apart; shape (n, N)."""
    support_set_count: int
    """Number of support sets."""

    def __len__(self) -> int:
        """Return the number of sets."""
        return len(self.points)

    @cached_property
    def _codes(self) -> NDArray[np.uint64]:
        """Codes of the sets, ascending, shape (n,)."""
        return codes(self.points)

    def find(self, stances: IntArray) -> IntArray:
        """Return the rows of the sets that stances hold, (k, N) -> (k,); -1 if there is none."""
        if not len(self):
            return np.full(len(stances), -1)
        code = codes(np.sort(stances, axis=1))
        row = np.minimum(np.searchsorted(self._codes, code), len(self) - 1)
        found: IntArray = np.where(self._codes[row] == code, row, -1)
        return found

    @classmethod
    def of(
        cls, graph: StancePostures, progress: Progress | None = None, *, build: bool = True
    ) -> StanceSets | None:
        """Return the sets of a graph from memory or from the cache folder, or compute them.

        Obstacles and occupied points do not change them, since they only remove stances. Returns
        None if the sets are not known and not to be computed, for two or more than four limbs, and
        if there are too many.
        """
        if not 3 <= graph.limbs <= LARGEST_SET:
            return None
        found = SET_TABLES.find(graph)
        if found is not None:
            return found[1]
        sets = _computed(graph, progress) if build else None
        if sets is not None:
            SET_TABLES.remember(graph, SET_TABLES.cache(graph, sets), sets)
        return sets


def _computed(graph: StancePostures, progress: Progress | None) -> StanceSets | None:
    """Compute the sets of a graph; None if there are too many."""
    limbs, compatible = graph.limbs, graph.compatible.copy()
    touching = graph.solver.point_cause > 0
    compatible[touching], compatible[:, touching] = False, False
    counts = np.zeros(len(compatible), dtype=np.int64)
    if not count_sets(compatible, limbs, MOST_SETS, counts):
        return None
    blocks = [np.zeros((0, limbs), dtype=np.uint16)]
    done, every = 0, max(int(counts.sum()), 1)
    for first in np.flatnonzero(counts).tolist():
        sets = np.empty((counts[first], limbs), dtype=np.int64)
        sets_from(compatible, first, sets)
        blocks.append(sets[graph.solver.in_reach(sets)].astype(np.uint16))
        done += len(sets)
        if progress is not None:
            progress(done / every)
    points = np.concatenate(blocks)
    support_sets = np.stack([codes(np.delete(points, i, axis=1)) for i in range(limbs)], axis=1)
    distinct, numbers = np.unique(support_sets, return_inverse=True)
    return StanceSets(points, numbers.reshape(support_sets.shape).astype(np.int32), len(distinct))


@entry
def count_sets(compatible: BoolArray, limbs: int, most: int, counts: IntArray) -> bool:
    """Count the sets of three or four points, all pairwise `compatible`, by their first point.

    The matrix is of shape (m, m), the counts are written into `counts`, shape (m,). Returns whether
    there are no more than `most` in all.
    """
    count, total = len(compatible), 0
    for a in range(count):
        for b in range(a + 1, count):
            if compatible[a, b]:
                for c in range(b + 1, count):
                    if compatible[a, c] and compatible[b, c]:
                        if limbs == 3:
                            counts[a] += 1
                        else:
                            for d in range(c + 1, count):
                                if compatible[a, d] and compatible[b, d] and compatible[c, d]:
                                    counts[a] += 1
        total += counts[a]
        if total > most:
            return False
    return True


@entry
def sets_from(compatible: BoolArray, a: int, out: IntArray) -> None:
    """Write the sets that start with point `a`, in order, into `out`, shape (k, 3) or (k, 4)."""
    count, n = len(compatible), 0
    for b in range(a + 1, count):
        if compatible[a, b]:
            for c in range(b + 1, count):
                if compatible[a, c] and compatible[b, c]:
                    if out.shape[1] == 3:
                        out[n, 0], out[n, 1], out[n, 2] = a, b, c
                        n += 1
                    else:
                        for d in range(c + 1, count):
                            if compatible[a, d] and compatible[b, d] and compatible[c, d]:
                                out[n, 0], out[n, 1], out[n, 2], out[n, 3] = a, b, c, d
                                n += 1


def _encode(_: CheckedSteps, sets: StanceSets) -> Arrays:
    """Return sets in the arrays of a file."""
    return {
        "points": sets.points,
        "supports": sets.support_sets,
        "support_count": np.array(sets.support_set_count),
    }


def _decode(graph: CheckedSteps, arrays: Arrays) -> StanceSets:
    """Check the arrays of a file and return its sets."""
    points, support_sets, count = (
        arrays[name].copy() for name in ("points", "supports", "support_count")
    )
    shape = len(points), graph.limbs
    check_arrays((points, shape, 0, len(graph.grasp_map)), (support_sets, shape, 0, int(count)))
    if (points.dtype.name, support_sets.dtype.name) != ("uint16", "int32"):
        raise ValueError
    return StanceSets(points, support_sets, int(count))


SET_TABLES = TableFiles(
    "sets", 6, zipfile.ZIP_STORED, _encode, _decode, source=Path(reach.__file__), is_shared=True
)
"""Files of stance sets."""
