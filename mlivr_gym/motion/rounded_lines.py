"""Lines between knots with rounded corners, which a limb follows without stopping.

The rounding of a corner replaces a fraction `before` of the line to it, W, and a fraction `after`
of the line from it, V:

    x(t) = corner - before W f(1 - t) + after V f(t),   f(t) = t^3 (2 - t),   t from 0 to 1

The curve stays in the triangle of the corner and its two end points. Its first and second
derivatives agree with those of the lines, if the path parameter sigma of the segment is distributed
over the lines so that `2 before W` and `2 after V` are the derivatives by t on either side.
`collisions.sweep` checks the same curve as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mlivr_gym.arrays import Array


@dataclass(frozen=True)
class RoundedLines:
    """Lines with rounded corners between two points of rest."""

    knots: Array
    """Base parameter and joint angles at each knot, shape (k, 7), with k at least 2."""
    corners: Array
    """Fractions of the lines before and after each inner knot that its rounding replaces, shape (k
    - 2, 2), positive."""

    @cached_property
    def knot_sigmas(self) -> Array:
        """Values of sigma at which the knots would be passed without rounding, shape (k,)."""
        longer = np.cumprod(self.corners[:, 0] / self.corners[:, 1])
        knot_sigmas = np.cumsum(np.concatenate([[0.0, 1.0], longer]))
        sigmas: Array = knot_sigmas / knot_sigmas[-1]
        return sigmas

    def at(self, sigma: Array) -> Array:
        """Return base parameter and joint angles at n values of sigma, shape (n, 7)."""
        knot_sigmas, knots = self.knot_sigmas, self.knots
        values: Array = np.column_stack(
            [np.interp(sigma, knot_sigmas, column) for column in knots.T]
        )
        for k, (before, _) in enumerate(self.corners, start=1):
            half = before * (knot_sigmas[k] - knot_sigmas[k - 1])
            here = np.abs(sigma - knot_sigmas[k]) < half
            t = 0.5 + 0.5 * (sigma[here, None] - knot_sigmas[k]) / half
            into, out = knots[k] - knots[k - 1], knots[k + 1] - knots[k]
            before, after = self.corners[k - 1]
            values[here] = knots[k] - before * into * ease(1.0 - t) + after * out * ease(t)
        return values


def ease(t: Array) -> Array:
    """Return `t^3 (2 - t)`, from 0 at rest to 1 with velocity 2, both without acceleration."""
    return t**3 * (2.0 - t)
