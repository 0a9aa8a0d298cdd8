"""The passes of time-optimal path parameterisation against a search over a fine grid."""

import numpy as np

from mlivr_gym.simulation.time_optimal import RATIOS, SquaredLoads, reduce_squares


def test_between_two_nodes_b_is_the_largest_that_all_loads_allow():
    """One node lies between two whose b is given; the spacing on both sides of it differs."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        u, v = rng.normal(size=(2, 3, 5, 3)) * rng.uniform(0.02, 1.0, size=(2, 1, 5, 1))
        sigmas, squares = np.array([0.0, rng.uniform(0.2, 0.8), 1.0]), np.array([0.02, 40.0, 0.01])
        loads = SquaredLoads((u * u).sum(axis=2), (u * v).sum(axis=2), (v * v).sum(axis=2))
        rates = 0.5 / np.diff(sigmas)
        first, last, largest = squares[0], squares[2], 0.0
        reduce_squares(loads, RATIOS, sigmas, squares)
        for grid in (np.linspace(0.0, 40.0, 4001), np.linspace(0.0, 0.01, 101)):
            b = largest + grid
            start = u[0, :, :, None] * rates[0] * (b - first) + v[0, :, :, None] * first
            end = u[1, :, :, None] * rates[1] * (last - b) + v[1, :, :, None] * b
            both = np.maximum(np.linalg.norm(start, axis=1), np.linalg.norm(end, axis=1))
            largest = b[(both <= 1.0).all(axis=0)].max()
        np.testing.assert_allclose(squares, [0.02, largest, 0.01], atol=2e-4)


def test_a_node_alone_has_the_largest_b_for_which_some_ratio_is_allowed():
    u, v = np.random.default_rng(1).normal(size=(2, 1, 5, 3))
    loads = SquaredLoads((u * u).sum(axis=2), (u * v).sum(axis=2), (v * v).sum(axis=2))
    squares = np.full(1, 1e3)
    reduce_squares(loads, RATIOS, np.zeros(1), squares)
    largest = np.linalg.norm(u[0] * np.linspace(-9, 9, 9001)[:, None, None] + v[0], axis=2).max(1)
    assert 0.9 <= squares[0] * largest.min() <= 1.0 + 1e-6
