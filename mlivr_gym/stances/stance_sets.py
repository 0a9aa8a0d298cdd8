"""Sets of points that the limbs of a robot may hold at once, in any order of the limbs.

Every node of three and four limbs holds such a set, see `postures.reach`, so the nodes of a table
are looked for among them. Obstacles and occupied points do not change them: these only remove
stances.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.stances.stance_postures import StancePostures

MOST_SETS = 40_000_000
"""Largest number of sets of points close enough to be checked; four limbs on the JEM have 11
million."""

AT_ONCE = 100_000
"""Number of sets that are compared with the reach of the robot at once."""


def stance_sets(graph: StancePostures) -> NDArray[np.uint16] | None:
    """Return the sets of points that may be held at once, ascending, in lexical order, (n, N).

    None for another number of limbs than three and four, and if there are too many sets.
    """
    if not 3 <= graph.limbs <= 4:
        return None
    compatible = graph.compatible.copy()
    touching = graph.solver.point_cause > 0
    compatible[touching], compatible[:, touching] = False, False
    ahead, count = np.triu(compatible, 1), 0
    close = [np.zeros((0, graph.limbs), dtype=np.uint16)]
    for pair in np.argwhere(ahead):
        close.append(_with_pair(ahead, pair, graph.limbs))
        count += len(close[-1])
        if count > MOST_SETS:
            return None
    sets = np.concatenate(close)
    parts = np.array_split(sets, len(sets) // AT_ONCE + 1)
    return np.concatenate([part[graph.solver.in_reach(part.astype(np.int64))] for part in parts])


def _with_pair(ahead: BoolArray, pair: IntArray, limbs: int) -> NDArray[np.uint16]:
    """Return the sets of three or four points, all compatible, that start with two points."""
    rest = np.flatnonzero(ahead[pair].all(axis=0))
    last = rest[:, None]
    if limbs == 4:
        last = rest[np.argwhere(ahead[np.ix_(rest, rest)])]
    return np.column_stack([np.tile(pair, (len(last), 1)), last]).astype(np.uint16)
