"""Time scalings of path segments, each from rest to rest.

A time scaling is the function sigma(t) that maps the time since the start of a segment to its path
parameter sigma, from 0 to 1. It is a piecewise polynomial (SciPy's
`PPoly`) whose first and second derivatives vanish at both ends; its last breakpoint is the duration
of the segment [s].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError
from mlivr_gym.schema import FieldPath, Struct, Tuples

MAX_DURATION = 3600.0
"""Upper bound of the duration of a step [s]; a step of the paper takes 50 s."""


def quintic(duration: float) -> scipy.interpolate.PPoly:
    """Return the quintic time scaling of a duration [s].

    `sigma(t) = 10 r^3 - 15 r^4 + 6 r^5` with `r = t / duration` is the polynomial of lowest degree
    from 0 to 1 with zero velocity and acceleration at both ends, and the minimum-jerk one (Flash
    and Hogan, Journal of Neuroscience 5, 1985); the paper uses it for all motions.

    Examples
    --------
    >>> scaling = quintic(2.0)
    >>> round(float(scaling(1.0)), 6), round(float(scaling(1.0, 1)), 6)
    (0.5, 0.9375)
    """
    powers = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
    return scipy.interpolate.PPoly(
        powers[:, None] / duration ** np.arange(5, -1, -1)[:, None], [0.0, duration]
    )


def duration_of(scaling: scipy.interpolate.PPoly) -> float:
    """Return the duration of a time scaling [s]."""
    return float(scaling.x[-1])


def stretch(scaling: scipy.interpolate.PPoly, factor: float) -> scipy.interpolate.PPoly:
    """Return the time scaling of the same shape that takes `factor` times as long."""
    order = len(scaling.c) - 1
    return scipy.interpolate.PPoly(
        scaling.c / factor ** np.arange(order, -1, -1)[:, None], scaling.x * factor
    )


@dataclass(frozen=True)
class Durations:
    """Durations of the three phases of a step; by default those of the paper.

    Examples
    --------
    >>> Durations().total
    50.0
    """

    departure: Annotated[float, DURATION] = 10.0
    """Duration of the departure along the surface normal [s]."""
    swing: Annotated[float, DURATION] = 30.0
    """Duration of the swing, during which the base moves [s]."""
    approach: Annotated[float, DURATION] = 10.0
    """Duration of the approach along the surface normal [s]."""

    def __post_init__(self) -> None:
        """Check that each duration is positive and that their sum is at most `MAX_DURATION`."""
        DURATIONS.check(self, FieldPath("duration", SettingError))
        if self.total > MAX_DURATION:
            raise SettingError(
                f"duration of a step is {self.total:g} s; it must be at most {MAX_DURATION:g} s"
            )

    @property
    def total(self) -> float:
        """Duration of a step [s]."""
        return self.departure + self.swing + self.approach

    @classmethod
    def of_step(cls, total: float) -> Durations:
        """Return the durations of a step of `total` seconds, divided 1 : 3 : 1 as in the paper."""
        total = DURATION.read(total, FieldPath("total", SettingError))
        return cls(0.2 * total, 0.6 * total, 0.2 * total)

    def time_scalings(self, shares: Array) -> tuple[scipy.interpolate.PPoly, ...]:
        """Return a quintic time scaling for each segment of a step.

        The segments of its swing share the duration of that in proportion to `shares`, one each.
        """
        swing = self.swing * shares / shares.sum()
        return tuple(quintic(float(time)) for time in (self.departure, *swing, self.approach))


DURATION = Tuples((), 1e-9, MAX_DURATION, "s")
"""Validator of a duration [s]."""

DURATIONS = Struct.of(Durations)
"""Schema of the fields of `Durations`."""
