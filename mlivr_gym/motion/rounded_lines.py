"""Lines between knots with rounded corners, run through without a stop.

A corner takes a share `before` of the line to it, W, and a share `after` of the line from it, V:

    x(t) = corner - before W f(1 - t) + after V f(t),   f(t) = t^3 (2 - t),   t from 0 to 1

so x stays in the triangle of the corner and both knot_shares, and joins the lines up to the second
derivative if both are run through at such rates that `2 before W` and `2 after V` are the same
share of either. `collisions.sweep` checks the same curve as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mlivr_gym.arrays import Array


@dataclass(frozen=True)
class RoundedLines:
    """Lines from rest to rest.

    Attributes
    ----------
    knots
        Shape (k, 7), k at least 2.
    corners
        Shares of the lines before and after each inner knot, shape (k - 2, 2), above 0.
    """

    knots: Array
    corners: Array

    @cached_property
    def knot_shares(self) -> Array:
        """Where knots would be passed without rounding, as shares of the run, shape (k,)."""
        longer = np.cumprod(self.corners[:, 0] / self.corners[:, 1])
        knot_shares = np.cumsum(np.concatenate([[0.0, 1.0], longer]))
        shares: Array = knot_shares / knot_shares[-1]
        return shares

    def at(self, share: Array) -> Array:
        """Base parameter and joint angles at shares of the run, shape (n, 7)."""
        knot_shares, knots = self.knot_shares, self.knots
        values: Array = np.column_stack(
            [np.interp(share, knot_shares, column) for column in knots.T]
        )
        for k, (before, _) in enumerate(self.corners, start=1):
            half = before * (knot_shares[k] - knot_shares[k - 1])
            here = np.abs(share - knot_shares[k]) < half
            t = 0.5 + 0.5 * (share[here, None] - knot_shares[k]) / half
            into, out = knots[k] - knots[k - 1], knots[k + 1] - knots[k]
            before, after = self.corners[k - 1]
            values[here] = knots[k] - before * into * eased(1.0 - t) + after * out * eased(t)
        return values


def eased(t: Array) -> Array:
    """From 0 to 1 with no velocity at 0 and the velocity 2 at 1, and no acceleration at either."""
    return t**3 * (2.0 - t)
