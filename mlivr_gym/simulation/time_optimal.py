"""The fastest clock of a piece under limits of torque, grasp wrench and speed.

With `b = s'^2` as a function of the share s, `s'' = b' / 2`, and every limit is convex in both: the
largest b from which the end can still be reached is found backwards, the largest that can be
reached from the start forwards (reachability analysis: Pham and Pham, "A New Approach to
Time-Optimal Path Parameterization Based on Reachability Analysis", IEEE Transactions on Robotics
34, 2018). The acceleration of that clock jumps; a moving average over time takes the jumps out, and
a last stretch, one number, brings what the average changed back within the limits.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from mlivr_gym.arrays import Array
from mlivr_gym.simulation.path_dynamics import PieceRows

SMALL = 1e-12
"""Numbers below count as zero."""

SAMPLES = 400
"""Times at which a clock is kept."""


def fastest_clock(rows: PieceRows, rise_time: float) -> PPoly:
    """The fastest clock of a piece, its acceleration without jumps.

    Args:
        rows: What the piece asks for, in units of the limits.
        rise_time: Time in which the acceleration changes from nothing to its largest and back [s].
    """
    squares = fastest_squares(rows)
    times, shares = _times(rows.shares, squares)
    clock = _averaged(times, shares, rise_time)
    longer = rows.binding(clock).duration / float(clock.x[-1])
    order = len(clock.c) - 1
    return PPoly(
        clock.c
        / longer
        ** np.arange(order, -1, -1)[
            :,
            None,
        ],
        clock.x * longer,
    )


def fastest_squares(rows: PieceRows) -> Array:
    """Squared rate of the share at each node of a piece, at rest at both ends, shape (K,)."""
    step = np.diff(rows.shares)
    most: Array = 1.0 / np.maximum((rows.speeds**2).max(axis=1), SMALL)
    squares: Array = np.minimum(most, _largest_without_change(rows))
    squares[0] = squares[-1] = 0.0
    last = len(squares) - 1
    for k in range(last - 1, 0, -1):
        # s'' = (b[k + 1] - b[k]) / (2 step) at node k
        ahead = squares[k + 1]
        while True:
            high = _largest(rows, k, ahead / (2.0 * step[k]), -1.0 / (2.0 * step[k]), 0.0, 1.0)
            if high >= 0.0 or ahead < SMALL:
                break
            ahead *= 0.9
        squares[k] = min(squares[k], max(high, 0.0))
    for k in range(last):
        here = squares[k]
        high = _largest(rows, k, -here / (2.0 * step[k]), 1.0 / (2.0 * step[k]), here, 0.0)
        squares[k + 1] = min(squares[k + 1], max(high, 0.0))
    return squares


def _largest_without_change(rows: PieceRows) -> Array:
    """Largest b at each node with s'' free: where torques bind first it is a bound."""
    return np.array([_curve_limit(rows, k) for k in range(len(rows.shares))])


def _curve_limit(rows: PieceRows, k: int) -> float:
    """Largest b at node k that some s'' allows, by bisection over s'' / b."""
    ratios = np.concatenate([-np.geomspace(1e3, 1e-2, 60), [0.0], np.geomspace(1e-2, 1e3, 60)])
    loads = _load(rows, k, ratios, np.ones_like(ratios))
    return float(1.0 / max(loads.min(), SMALL))


def _load(rows: PieceRows, k: int, change: Array, square: Array) -> Array:
    """What pairs of s'' and b ask for at node k, in units of the limits, the largest of all."""
    torque = np.abs(np.outer(change, rows.torques[k, 0]) + np.outer(square, rows.torques[k, 1]))
    wrench = (
        change[:, None, None] * rows.wrenches[k, 0] + square[:, None, None] * rows.wrenches[k, 1]
    )
    largest: Array = np.maximum(torque.max(axis=1), np.linalg.norm(wrench, axis=2).max(axis=1))
    return largest


def _largest(
    rows: PieceRows, k: int, change: float, by_change: float, square: float, by_square: float
) -> float:
    """Largest x with `s'' = change + by_change x` and `b = square + by_square x` within limits.

    -1 if there is none above zero.
    """
    torques, wrenches = rows.torques[k], rows.wrenches[k]
    fixed = change * torques[0] + square * torques[1]
    slope = by_change * torques[0] + by_square * torques[1]
    steep = np.abs(slope) > SMALL
    if (np.abs(fixed[~steep]) > 1.0 + 1e-9).any():
        return -1.0
    ends = np.stack([(-1.0 - fixed[steep]) / slope[steep], (1.0 - fixed[steep]) / slope[steep]])
    low, high = ends.min(axis=0).max(initial=0.0), ends.max(axis=0).min(initial=np.inf)
    start = change * wrenches[0] + square * wrenches[1]
    along = by_change * wrenches[0] + by_square * wrenches[1]
    # |start + x along|^2 <= 1
    a, b, c = (along**2).sum(axis=1), (start * along).sum(axis=1), (start**2).sum(axis=1) - 1.0
    root = b * b - a * c
    if (root < 0.0).any() or (c[a < SMALL] > 1e-9).any():
        return -1.0
    moving = a >= SMALL
    root = np.sqrt(root[moving])
    low = max(low, ((-b[moving] - root) / a[moving]).max(initial=0.0))
    high = min(high, ((-b[moving] + root) / a[moving]).min(initial=np.inf))
    return float(high) if high >= low - 1e-9 else -1.0


def _times(shares: Array, squares: Array) -> tuple[Array, Array]:
    """Times of evenly spaced samples of a clock, and its shares there."""
    rates = np.sqrt(squares)
    each = 2.0 * np.diff(shares) / np.maximum(rates[:-1] + rates[1:], SMALL)
    nodes = np.concatenate([[0.0], np.cumsum(each)])
    times = np.linspace(0.0, nodes[-1], SAMPLES)
    part = np.clip(np.searchsorted(nodes, times, side="right") - 1, 0, len(each) - 1)
    change = (squares[part + 1] - squares[part]) / (2.0 * np.diff(shares)[part])
    since = times - nodes[part]
    return times, shares[part] + rates[part] * since + 0.5 * change * since**2


def _averaged(times: Array, shares: Array, window: float) -> PPoly:
    """A clock through the moving average of shares over two windows, one after the other."""
    step = times[1]
    half = max(round(0.5 * window / step), 1)
    box = np.ones(half) / half
    kernel = np.convolve(box, box)
    padded = np.concatenate([np.zeros(len(kernel)), shares, np.ones(len(kernel))])
    smooth = np.convolve(padded, kernel, mode="valid")
    # Beyond the ends of the average nothing changes.
    first = int(np.flatnonzero(smooth > 0.0)[0]) - 1
    last = int(np.flatnonzero(smooth < 1.0 - 1e-12)[-1]) + 1
    kept = np.clip(smooth[max(first, 0) : last + 1], 0.0, 1.0)
    kept[0], kept[-1] = 0.0, 1.0
    return CubicSpline(step * np.arange(len(kept)), kept, bc_type="clamped")
