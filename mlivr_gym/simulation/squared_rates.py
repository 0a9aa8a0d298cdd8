"""The two passes of time-optimal path parameterisation (compiled), see `time_optimal`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import entry, kernel

TINY = 1e-12
"""Numbers below this count as zero."""

RATIOS: Array = np.concatenate([-np.geomspace(1e3, 1e-2, 60), [0.0], np.geomspace(1e-2, 1e3, 60)])
"""Ratios sigma'' / b that are tried for the maximum velocity curve, shape (R,)."""


class SquaredLoads(NamedTuple):
    """Squared loads at K nodes in units of the limits, as quadratic forms in sigma'' and b.

    A torque or wrench `u sigma'' + v b` is within its limit if its square
    `uu sigma''^2 + 2 uv sigma'' b + vv b^2` is at most 1. All arrays have the shape (K, G) for G
    torques and wrenches.
    """

    uu: Array
    uv: Array
    vv: Array


@entry
def reduce_squares(loads: SquaredLoads, ratios: Array, sigmas: Array, squares: Array) -> None:
    """Reduce b = sigma'^2 at K nodes, shape (K,), to what can be reached from and to rest.

    First each b is reduced to the maximum velocity curve of Bobrow et al. (1985), the largest for
    which some sigma'' is feasible, by the ratios of `RATIOS`. A backward pass reduces it to that
    from which the end can still be reached, a forward pass to that which can be reached from the
    start.
    """
    for k in range(len(squares)):
        squares[k] = min(squares[k], 1.0 / max(np.sqrt(least_load(loads, k, ratios)), TINY))
    last = len(squares) - 1
    for k in range(last - 1, 0, -1):
        # sigma'' = (b[k + 1] - b[k]) / (2 spacing) at node k
        rate, ahead = 0.5 / (sigmas[k + 1] - sigmas[k]), squares[k + 1]
        high = largest_feasible(loads, k, (ahead * rate, -rate), (0.0, 1.0))
        while high < 0.0 and ahead >= TINY:
            ahead *= 0.9
            high = largest_feasible(loads, k, (ahead * rate, -rate), (0.0, 1.0))
        squares[k] = min(squares[k], max(high, 0.0))
    for k in range(last):
        rate, here = 0.5 / (sigmas[k + 1] - sigmas[k]), squares[k]
        high = largest_feasible(loads, k, (-here * rate, rate), (here, 0.0))
        squares[k + 1] = min(squares[k + 1], max(high, 0.0))


@kernel
def least_load(loads: SquaredLoads, k: int, ratios: Array) -> float:
    """Return the largest squared load at node `k` for b = 1 and the best of the ratios."""
    least = np.inf
    for r in ratios:
        largest = 0.0
        for g in range(loads.uu.shape[1]):
            square = r * r * loads.uu[k, g] + 2.0 * r * loads.uv[k, g] + loads.vv[k, g]
            largest = max(largest, square)
        least = min(least, largest)
    return least


@kernel
def largest_feasible(
    loads: SquaredLoads, k: int, change: tuple[float, float], square: tuple[float, float]
) -> float:
    """Return the largest x at which all loads of node `k` are within their limits.

    Here `sigma'' = change[0] + change[1] x` and `b = square[0] + square[1] x`. The result is -1 if
    no x from 0 on is feasible.
    """
    (p, dp), (q, dq) = change, square
    lowest, highest = 0.0, np.inf
    for g in range(loads.uu.shape[1]):
        uu, uv, vv = loads.uu[k, g], loads.uv[k, g], loads.vv[k, g]
        # a x^2 + 2 b x + c <= 0
        a = dp * dp * uu + 2.0 * dp * dq * uv + dq * dq * vv
        b = p * dp * uu + (p * dq + q * dp) * uv + q * dq * vv
        c = p * p * uu + 2.0 * p * q * uv + q * q * vv - 1.0
        if a > TINY**2:
            root = b * b - a * c
            if root < 0.0:
                return -1.0
            lowest = max(lowest, (-b - np.sqrt(root)) / a)
            highest = min(highest, (np.sqrt(root) - b) / a)
        elif c > 1e-9:
            return -1.0
    return highest if highest >= lowest - 1e-9 else -1.0
