"""Unreliable grasps: how likely an attempt to grasp a point fails."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError, nonnegative

LARGEST = 0.95
"""Largest failure probability of a point."""


def failure_probabilities(points: int, grasp_failure: float | Array, seed: int = 0) -> Array:
    """Probability that an attempt at each point fails, shape (m,).

    Args:
        points: Number of points m.
        grasp_failure: Mean of the probabilities, which are drawn evenly between 0 and twice the
            mean; or the probabilities themselves, shape (m,).
        seed: Seed of the draw.

    Raises:
        SettingError: If the mean is above 0.45 or a probability does not lie between 0 and
            `LARGEST`.
    """
    if np.ndim(grasp_failure):
        given = np.array(grasp_failure, dtype=np.float64)
        if given.shape != (points,) or not ((given >= 0.0) & (given <= LARGEST)).all():
            raise SettingError(
                f"grasp_failure must be one number, or {points} numbers from 0 to {LARGEST:g}"
            )
        return given
    mean = nonnegative("grasp_failure", float(grasp_failure))
    if mean > 0.45:
        raise SettingError(f"grasp_failure is {mean:g}; the mean must be at most 0.45")
    return (
        np.random.default_rng(seed).uniform(0.0, 2.0 * mean, points) if mean else np.zeros(points)
    )
