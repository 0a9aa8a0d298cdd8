"""Pairs of points of a map that are close enough to be held at once."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import scipy

from mlivr_gym.arrays import IntArray
from mlivr_gym.errors import MapError, StanceError
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.world.grasp_map import GraspMap

FEW_POINTS = 1000
"""Number of points up to which all pairs are compared, which is quicker than to import SciPy's
tree."""

MOST_PAIRS, MOST_STEPS = 10_000_000, 4_000_000_000
"""Largest number of ordered pairs of points, and of steps between them: the JEM with points every
0.03 m would take gigabytes, while a long row of modules has few steps for its pairs."""


def pairs_within(grasp_map: GraspMap, span: float) -> IntArray:
    """Return the pairs of points at most a span [m] apart, each once, shape (k, 2).

    Raises a `MapError` if there are more than `MOST_PAIRS`, or about more than `MOST_STEPS` between
    them.
    """
    positions, limit = grasp_map.positions, span + 1e-9
    if len(positions) <= FEW_POINTS:
        pairs = np.column_stack(np.triu_indices(len(positions), 1))
        pairs = pairs[np.linalg.norm(np.diff(positions[pairs], axis=1)[:, 0], axis=1) <= limit]
        count = 2 * len(pairs)
    else:
        tree = scipy.spatial.cKDTree(positions)
        count = int(tree.count_neighbors(tree, limit)) - len(positions)
    steps = 2 * count**2 // len(positions)
    if count > MOST_PAIRS or steps > MOST_STEPS:
        raise MapError(
            f"map {grasp_map.name!r} has {count} pairs of points within the span of {span:g} m, "
            f"with about {steps} steps between them; at most {MOST_PAIRS} and {MOST_STEPS} can be "
            "used: choose a larger spacing or a smaller span"
        )
    if len(positions) > FEW_POINTS:
        pairs = tree.query_pairs(limit, output_type="ndarray").astype(np.int64)
    return pairs


def check_distances(grasp_map: GraspMap, robot: RobotSpec, points: Sequence[int]) -> None:
    """Check that the points of a stance are not too close to each other, and within the span.

    The `StanceError` names the two points, their distance and what is valid.
    """
    for a, b in combinations(points, 2):
        distance = float(np.linalg.norm(grasp_map.positions[a] - grasp_map.positions[b]))
        names = f"{grasp_map.ids[a]!r} and {grasp_map.ids[b]!r}"
        if distance < robot.grasp_separation - 1e-9:
            raise StanceError(
                f"points {names} are {distance:.3f} m apart; two grippers need "
                f"{robot.grasp_separation:g} m"
            )
        if distance > robot.span + 1e-9:
            raise StanceError(
                f"points {names} are {distance:.3f} m apart; robot {robot.name!r} spans "
                f"{robot.span:g} m"
            )
