"""How likely a step is, from where the points lie: an order in which few checks find most steps."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.lazy_graph import LazyGraph

ROUNDS, RIDGE = 30, 1e-3
"""Newton steps of the fit, and what is added to its curvature."""


def features(graph: LazyGraph, stance: tuple[int, ...], here: Postures, after: IntArray) -> Array:
    """What tells likely steps from a stance from others, shape (k, 4).

    One, the distance of the new point from where the base is likely to be then, that from the old
    point [m], and the cosine of the angle between the new point and the limb's mount, seen from the
    base before.

    Args:
        graph: The stance graph.
        stance: The stance before.
        here: Its posture, with a leading 1.
        after: Stances that differ in one limb, shape (k, N).
    """
    rows, positions = np.arange(len(after)), graph.grasp_map.positions
    limb = (after != np.array(stance)).argmax(axis=1)
    new, old = positions[after[rows, limb]], positions[np.array(stance)[limb]]
    away = new - here.base_position[0]
    turn = 2.0 * np.pi * limb / graph.limbs
    mount = np.stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))], axis=1)
    mount = mount @ here.base_rotation[0].T
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
    return np.stack(
        [
            np.ones(len(rows)),
            np.linalg.norm(new - graph.likely_base(after), axis=1),
            np.linalg.norm(new - old, axis=1),
            (away * mount).sum(axis=1) / distance,
        ],
        axis=1,
    )


def fitted(rows: Array, steps: BoolArray) -> Array:
    """Weights of the features by logistic regression, shape (4,).

    Args:
        rows: Features of candidates, shape (k, 4).
        steps: Which of them turned out to be steps, shape (k,).
    """
    weights: Array = np.zeros(rows.shape[1])
    for _ in range(ROUNDS):
        odds = 1.0 / (1.0 + np.exp(-np.clip(rows @ weights, -30.0, 30.0)))
        curvature = rows.T @ (rows * (odds * (1.0 - odds))[:, None])
        slope = rows.T @ (steps - odds) - RIDGE * weights
        weights = weights + np.linalg.solve(curvature + RIDGE * np.eye(len(weights)), slope)
    return weights
