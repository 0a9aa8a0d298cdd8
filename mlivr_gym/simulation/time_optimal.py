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

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from mlivr_gym.arrays import Array
from mlivr_gym.motion.time_scaling import duration_of, stretch
from mlivr_gym.simulation.path_dynamics import SegmentDynamics
from mlivr_gym.simulation.squared_rates import RATIOS, TINY, SquaredLoads, reduce_squares

TIME_SAMPLES = 400
"""Number of times at which a time scaling is sampled."""


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
