"""Unreliable grasps: how likely an attempt to grasp a point fails."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arguments import Via
from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError
from mlivr_gym.schema import FieldPath, Numbers
from mlivr_gym.values import MOST_POINTS

LARGEST, LARGEST_MEAN = 0.95, 0.45
"""Largest failure probability of a point, and largest mean of those that are drawn."""


def _failure(value: object, place: FieldPath) -> Array:
    """A mean, shape (), or the probabilities, shape (m,)."""
    if isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim):
        return Numbers((None,), 0.0, LARGEST, rows=(1, MOST_POINTS)).read(value, place)
    return Numbers((), 0.0, LARGEST_MEAN).read(value, place)


GRASP_FAILURE = Via(_failure)
"""How likely an attempt to grasp fails: the mean, or each point's probability."""


def failure_probabilities(points: int, grasp_failure: float | Array, seed: int = 0) -> Array:
    """Probability that an attempt at each point fails, shape (m,).

    Parameters
    ----------
    points
        Number of points m.
    grasp_failure
        Mean of the probabilities, which are drawn evenly between 0 and twice the
        mean; or the probabilities themselves, shape (m,).
    seed
        Seed of the draw.

    Raises
    ------
    SettingError
        If they cannot be used.
    """
    given = GRASP_FAILURE.read(grasp_failure, FieldPath("grasp_failure", SettingError))
    if not given.ndim:
        return np.random.default_rng(seed).uniform(0.0, 2.0 * given, points)
    if len(given) != points:
        told = f"has {len(given)} numbers; it must be one number, or {points} numbers"
        raise FieldPath("grasp_failure", SettingError).fault(told)
    return given
