"""Clocks: how a segment of a path is run through in time, from rest to rest.

A clock is a piecewise polynomial of time, SciPy's `PPoly`, that goes from 0 to 1, with velocity and
acceleration zero at both ends. Its last breakpoint is the duration of the segment [s].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.path_segments import PathSegment
from mlivr_gym.schema import FieldPath, Struct, Tuples

MAXIMUM_DURATION = 3600.0
"""Largest duration of a step [s]; the paper's is 50 s."""


def quintic(duration: float) -> scipy.interpolate.PPoly:
    """The quintic from 0 to 1 with velocity and acceleration zero at both ends."""
    powers = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
    return scipy.interpolate.PPoly(
        powers[:, None] / duration ** np.arange(5, -1, -1)[:, None], [0.0, duration]
    )


def duration_of(clock: scipy.interpolate.PPoly) -> float:
    """How long a clock runs [s]."""
    return float(clock.x[-1])


def stretched(clock: scipy.interpolate.PPoly, factor: float) -> scipy.interpolate.PPoly:
    """The clock that takes `factor` times as long."""
    order = len(clock.c) - 1
    return scipy.interpolate.PPoly(
        clock.c / factor ** np.arange(order, -1, -1)[:, None], clock.x * factor
    )


@dataclass(frozen=True)
class Durations:
    """How long the parts of a step take; by default the paper's.

    Attributes
    ----------
    departure
        Departure along the surface normal [s].
    swing
        Swing, with the base moving [s].
    approach
        Approach along the surface normal [s].
    """

    departure: float = 10.0
    swing: float = 30.0
    approach: float = 10.0

    def __post_init__(self) -> None:
        """Check that each is above zero, and the whole not too long."""
        DURATIONS.check(self, FieldPath("duration", SettingError))
        if self.total > MAXIMUM_DURATION:
            raise SettingError(
                f"duration of a step is {self.total:g} s; it must be at most {MAXIMUM_DURATION:g} s"
            )

    @property
    def total(self) -> float:
        """Duration of a step [s]."""
        return self.departure + self.swing + self.approach

    @classmethod
    def of_step(cls, total: float) -> Durations:
        """A step of `total` seconds, divided as the paper's: a fifth, three fifths, a fifth."""
        total = DURATION.read(total, FieldPath("total", SettingError))
        return cls(0.2 * total, 0.6 * total, 0.2 * total)

    def clocks(self, segments: Sequence[PathSegment]) -> tuple[scipy.interpolate.PPoly, ...]:
        """Quintics for the segments of a step.

        Those of the swing share its time with the square root of the farthest travel of a joint,
        since accelerations go with travel over time squared.
        """
        roots: Array = np.sqrt([segment.travel for segment in segments[1:-1]])
        swing = self.swing * roots / roots.sum()
        return tuple(quintic(float(time)) for time in (self.departure, *swing, self.approach))


DURATION = Tuples((), 1e-9, MAXIMUM_DURATION, "s")
"""How long something takes."""

DURATIONS = Struct(Durations, dict.fromkeys(("departure", "swing", "approach"), DURATION))
"""Fields of `Durations`."""
