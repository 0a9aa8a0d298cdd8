"""Unreliable grasps: the probability that an attempt to grasp a point fails, and what follows."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arguments import Reader
from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError
from mlivr_gym.schema import FieldPath, Numbers
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.values import MAX_POINTS

MAX_PROBABILITY, MAX_MEAN_PROBABILITY = 0.95, 0.45
"""Largest failure probability of a point, and largest mean of probabilities that are drawn."""


def _read_failure(value: object, path: FieldPath) -> Array:
    """Return a mean probability, shape (), or the probability of each point, shape (m,)."""
    if isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim):
        return Numbers((None,), 0.0, MAX_PROBABILITY, rows=(1, MAX_POINTS)).read(value, path)
    return Numbers((), 0.0, MAX_MEAN_PROBABILITY).read(value, path)


GRASP_FAILURE = Reader(_read_failure)
"""Validator of the argument `grasp_failure`: a mean probability, or the probability of each
point."""


def failure_probabilities(points: int, grasp_failure: float | Array, seed: int = 0) -> Array:
    """Return the probability that an attempt to grasp each point fails, shape (m,).

    `grasp_failure` has the probabilities themselves, shape (m,), or their mean; they are then drawn
    uniformly from 0 to twice the mean. Raises a `SettingError` if they are out of range or not one
    for each point.
    """
    given = GRASP_FAILURE.read(grasp_failure, FieldPath("grasp_failure", SettingError))
    if not given.ndim:
        return np.random.default_rng(seed).uniform(0.0, 2.0 * abs(given), points)  # also of -0.0
    if len(given) != points:
        raise SettingError(
            f"grasp_failure has {len(given)} numbers; it must be one number, or {points} numbers, "
            "one for each point"
        )
    return given


def state_after_failure(graph: StanceGraph, before: State, after: State, limb: int) -> State:
    """Return the state after an attempt to grasp a point has failed, instead of `after`.

    The limb holds the point that it released, on all branches on which it can be released. The
    support limbs are on the branches that the step allows.
    """
    grasped = graph.branch_set_after_grasp(before, limb)
    return before._replace(
        branch_sets=(*after.branch_sets[:limb], grasped, *after.branch_sets[limb + 1 :])
    )
