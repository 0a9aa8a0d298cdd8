"""Which points of a map are close enough to be held at once."""

from __future__ import annotations

import numpy as np
import scipy

from mlivr_gym.arrays import IntArray
from mlivr_gym.errors import MapError
from mlivr_gym.world.grasp_map import GraspMap

FEW_POINTS = 1000
"""Up to here all pairs are compared, which takes less time than it takes to import SciPy's tree."""

MOST_PAIRS = 2_000_000
"""Most ordered pairs of points: those of the JEM with points every 0.03 m take gigabytes."""


def pairs_within(grasp_map: GraspMap, span: float) -> IntArray:
    """Pairs of points that are no farther apart than a span [m], each once, shape (k, 2).

    Raises
    ------
    MapError
        If there are more than `MOST_PAIRS`.
    """
    positions, limit = grasp_map.positions, span + 1e-9
    if len(positions) <= FEW_POINTS:
        pairs = np.column_stack(np.triu_indices(len(positions), 1))
        pairs = pairs[np.linalg.norm(np.diff(positions[pairs], axis=1)[:, 0], axis=1) <= limit]
        count = 2 * len(pairs)
    else:
        tree = scipy.spatial.cKDTree(positions)
        count = int(tree.count_neighbors(tree, limit)) - len(positions)
    if count > MOST_PAIRS:
        raise MapError(
            f"map {grasp_map.name!r} has {count} pairs of points within the span of {span:g} m; "
            f"at most {MOST_PAIRS} can be worked out: take a larger spacing or a smaller span"
        )
    if len(positions) > FEW_POINTS:
        pairs = tree.query_pairs(limit, output_type="ndarray").astype(np.int64)
    return pairs
