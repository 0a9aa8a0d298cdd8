"""Rails along which points may be grasped, and handrails."""

from __future__ import annotations

from dataclasses import dataclass

from mlivr_gym.errors import MapError, shown
from mlivr_gym.schema import NAME, Choice, Maybe, Place, Record, Tuples
from mlivr_gym.values import LONGEST, SMALLEST, Triple


@dataclass(frozen=True)
class Segment:
    """A straight rail along which points may be grasped.

    Ends [m] and outward surface normal are given in the map's frame, width and thickness in [m].
    """

    id: str
    face: str
    start: Triple
    end: Triple
    normal: Triple
    width: float = 0.0256
    thickness: float = 0.013

    def __post_init__(self) -> None:
        """Check every figure."""
        SEGMENT.check(self, Place(f"segment {shown(self.id)}", MapError))


@dataclass(frozen=True)
class Handrail:
    """A handrail: its bounding box with posts, and the bar alone.

    Lower and upper corners are given in the map's frame [m]; `axis` is that of the bar.
    """

    id: str
    face: str
    min: Triple
    max: Triple
    axis: str = "x"
    bar_min: Triple | None = None
    bar_max: Triple | None = None

    def __post_init__(self) -> None:
        """Check every figure."""
        place = Place(f"handrail {shown(self.id)}", MapError)
        HANDRAIL.check(self, place)
        if (self.bar_min is None) != (self.bar_max is None):
            raise place.fault("has one of bar_min and bar_max; it must have both or neither")


POSITION = Tuples((3,), most=LONGEST, unit="m")
"""A point of the map's frame."""

DIRECTION = Tuples((3,), -1e6, 1e6)
"""A vector of which the direction counts."""

LENGTH = Tuples((), SMALLEST, LONGEST, "m")
"""A length above zero."""

SEGMENT = Record(
    Segment,
    {
        "id": NAME, "face": NAME, "start": POSITION, "end": POSITION, "normal": DIRECTION,
        "width": LENGTH, "thickness": LENGTH,
    },
)  # fmt: skip
"""Fields of a `Segment`."""

HANDRAIL = Record(
    Handrail,
    {
        "id": NAME, "face": NAME, "min": POSITION, "max": POSITION,
        "axis": Choice(("x", "y", "z")), "bar_min": Maybe(POSITION), "bar_max": Maybe(POSITION),
    },
)  # fmt: skip
"""Fields of a `Handrail`."""
