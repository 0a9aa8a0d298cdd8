"""Time-optimal path parameterisation under limits of torque, grasp wrench and velocity.

With `b = sigma'^2` as a function of the path parameter sigma, `sigma'' = (db/dsigma) / 2`, and
all limits are convex in b and sigma'' (Verscheure, Demeulenaere, Swevers, De Schutter and Diehl,
IEEE Transactions on Automatic Control 54, 2009). A backward pass computes the largest b from which
the end can still be reached, a forward pass the largest b that can be reached from the start
(reachability analysis: Pham and Pham, "A New Approach to Time-Optimal Path Parameterization Based
on Reachability Analysis", IEEE Transactions on Robotics 34, 2018). The acceleration of this time
scaling is discontinuous. A moving average over time limits its rate of change, and a final uniform
stretch restores the limits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.motion.time_scaling import duration_of, stretch
from mlivr_gym.simulation.path_dynamics import SegmentDynamics

TIME_SAMPLES = 400
"""Number of times at which a time scaling is sampled."""

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


def time_optimal_scaling(dynamics: SegmentDynamics, rise_time: float) -> PPoly:
    """Return the time-optimal time scaling of a segment, smoothed to a continuous acceleration.

    The dynamics along it are in units of the limits; `rise_time` is the width of the moving average
    [s], see `Limits.rise_time`.
    """
    squares = time_optimal_squared_rates(dynamics)
    times, sigmas = _sampled(dynamics.sigmas, squares)
    scaling = _smoothed(times, sigmas, rise_time)
    return stretch(scaling, dynamics.binding(scaling).duration / duration_of(scaling))


def time_optimal_squared_rates(dynamics: SegmentDynamics) -> Array:
    """Return the largest b = sigma'^2 at each node of a segment, zero at both ends, shape (K,)."""
    squares: Array = 1.0 / np.maximum((dynamics.speeds**2).max(axis=1), TINY)
    squares[0] = squares[-1] = 0.0
    u, v = dynamics.load_rates.swapaxes(0, 1)
    loads = SquaredLoads(*((one * other).sum(axis=2) for one, other in ((u, u), (u, v), (v, v))))
    reduce_squares(loads, RATIOS, dynamics.sigmas, squares)
    return squares


def _sampled(sigmas: Array, squares: Array) -> tuple[Array, Array]:
    """Return evenly spaced times of a time scaling given by b at its nodes, and the sigmas."""
    rates = np.sqrt(squares)
    intervals = 2.0 * np.diff(sigmas) / np.maximum(rates[:-1] + rates[1:], TINY)
    nodes = np.concatenate([[0.0], np.cumsum(intervals)])
    times = np.linspace(0.0, nodes[-1], TIME_SAMPLES)
    part = np.clip(np.searchsorted(nodes, times, side="right") - 1, 0, len(intervals) - 1)
    change = (squares[part + 1] - squares[part]) / (2.0 * np.diff(sigmas)[part])
    since = times - nodes[part]
    return times, sigmas[part] + rates[part] * since + 0.5 * change * since**2


def _smoothed(times: Array, sigmas: Array, window: float) -> PPoly:
    """Return the time scaling through a moving average of sigmas over two successive windows."""
    spacing = times[1]
    half = max(round(0.5 * window / spacing), 1)
    box = np.ones(half) / half
    kernel = np.convolve(box, box)
    padded = np.concatenate([np.zeros(len(kernel)), sigmas, np.ones(len(kernel))])
    smooth = np.convolve(padded, kernel, mode="valid")
    # The average is constant outside these samples.
    first = int(np.flatnonzero(smooth > 0.0)[0]) - 1
    last = int(np.flatnonzero(smooth < 1.0 - 1e-12)[-1]) + 1
    kept = np.clip(smooth[max(first, 0) : last + 1], 0.0, 1.0)
    kept[0], kept[-1] = 0.0, 1.0
    return CubicSpline(spacing * np.arange(len(kept)), kept, bc_type="clamped")


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
