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

CHUNK = 64
"""Number of points, in their order along the map, that are compared with others at once."""

MOST_PAIRS, MOST_STEPS = 10_000_000, 4_000_000_000
"""Largest number of ordered pairs of points, and of steps between them: the JEM with points every
0.03 m would take gigabytes, while a long row of modules has few steps for its pairs."""


def pairs_within(grasp_map: GraspMap, span: float) -> IntArray:
    """Return the pairs of points at most a span [m] apart, each once, shape (k, 2).

    Raises a `MapError` if there are more than `MOST_PAIRS`, or about more than `MOST_STEPS` between
    them.
    """
    positions, limit, chunks, count = grasp_map.positions, span + 1e-9, [], 0
    # SciPy's tree is quicker on large maps, but takes longer to import than all pairs of a station.
    along = positions[:, np.ptp(positions, axis=0).argmax()]
    order = np.argsort(along, kind="stable")
    ordered, last = positions[order], np.searchsorted(along[order], along[order] + limit, "right")
    for first in range(0, len(order), CHUNK):
        chunk = ordered[first : first + CHUNK]
        others = ordered[first : last[first + len(chunk) - 1]]
        apart = np.linalg.norm(chunk[:, None] - others, axis=2)
        chunks.append(order[first + np.argwhere(np.triu(apart <= limit, 1))])
        count += 2 * len(chunks[-1])
        if count > MOST_PAIRS:
            break
    steps = 2 * count**2 // len(positions)
    if count > MOST_PAIRS or steps > MOST_STEPS:
        counted = f"over {MOST_PAIRS}" if count > MOST_PAIRS else f"{count}"
        raise MapError(
            f"map {grasp_map.name!r} has {counted} pairs of points within the span of {span:g} m, "
            f"with about {steps} steps between them; at most {MOST_PAIRS} and {MOST_STEPS} can be "
            "used: choose a larger spacing or a smaller span"
        )
    return np.concatenate(chunks)


def count_farther(grasp_map: GraspMap, robot: RobotSpec) -> int:
    """Return the number of ordered pairs beyond the span that two outstretched limbs reach."""
    tree = scipy.spatial.cKDTree(grasp_map.positions)
    pairs = tree.query_pairs(2.0 * robot.reach, output_type="ndarray")
    apart = np.linalg.norm(np.diff(grasp_map.positions[pairs], axis=1)[:, 0], axis=1)
    return 2 * int((apart > robot.span + 1e-9).sum())


def nearest_told(grasp_map: GraspMap, span: float) -> str:
    """Return how far the nearest two points are apart, for a message; empty for a single point."""
    if len(grasp_map) == 1:
        return ""
    positions = grasp_map.positions
    nearest = float(scipy.spatial.cKDTree(positions).query(positions, 2)[0][:, 1].min())
    ask = "; if the map is not in metres, give its unit" if nearest > span else ""
    return f": the nearest two are {nearest:g} m apart{ask}"


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
