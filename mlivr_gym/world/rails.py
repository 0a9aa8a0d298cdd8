"""Rails with graspable points, and handrails, together with their boxes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from mlivr_gym.errors import MapError, shortened
from mlivr_gym.schema import NAME, Choice, FieldPath, OrNone, Struct, Tuples
from mlivr_gym.values import MAX_LENGTH, MIN_SIZE, Triple, as_triple
from mlivr_gym.world.boxes import CORNER, Box

INTO_BAR = 0.008
"""Overlap of a handrail's post with its bar [m]."""


@dataclass(frozen=True)
class Segment:
    """A straight rail along which points may be grasped.

    Ends [m] and outward surface normal are given in the map's frame, width and thickness in [m].
    """

    id: Annotated[str, NAME]
    face: Annotated[str, NAME]
    start: Annotated[Triple, POSITION]
    end: Annotated[Triple, POSITION]
    normal: Annotated[Triple, DIRECTION]
    width: Annotated[float, LENGTH] = 0.0256
    thickness: Annotated[float, LENGTH] = 0.013

    def __post_init__(self) -> None:
        """Check every figure."""
        SEGMENT.check(self, FieldPath(f"segment {shortened(self.id)}", MapError))

    @property
    def box(self) -> Box:
        """Return the strip of a seat track, its face in the plane of the grasps."""
        start, end, normal = (np.array(v) for v in (self.start, self.end, self.normal))
        length = float(np.linalg.norm(end - start))
        along = (end - start) / length
        return Box(
            self.id,
            "track",
            as_triple(0.5 * (start + end) - 0.5 * self.thickness * normal),
            (0.5 * length, 0.5 * self.width, 0.5 * self.thickness),
            Box.rows(np.column_stack([along, np.cross(normal, along), normal])),
            self.face,
        )


@dataclass(frozen=True)
class Handrail:
    """A handrail: its bounding box with posts, and the bar alone.

    Lower and upper corners are given in the map's frame [m]; `axis` is that of the bar.
    """

    id: Annotated[str, NAME]
    face: Annotated[str, NAME]
    min: Annotated[Triple, POSITION]
    max: Annotated[Triple, POSITION]
    axis: Annotated[str, Choice(("x", "y", "z"))] = "x"
    bar_min: Annotated[Triple | None, OrNone(POSITION)] = None
    bar_max: Annotated[Triple | None, OrNone(POSITION)] = None

    def __post_init__(self) -> None:
        """Check every figure."""
        place = FieldPath(f"handrail {shortened(self.id)}", MapError)
        HANDRAIL.check(self, place)
        if (self.bar_min is None) != (self.bar_max is None):
            raise place.fault("has one of bar_min and bar_max; it must have both or neither")

    @property
    def boxes(self) -> tuple[Box, ...]:
        """Return a bar on two posts, or only the bounding box if the bar is not known."""
        if self.bar_min is None or self.bar_max is None:
            return (Box.between(self.id, "handrail", self.min, self.max, self.face),)
        bar = Box.between(self.id, "handrail", self.bar_min, self.bar_max, self.face)
        along = "xyz".index(self.axis)
        high, low = list(self.max), list(self.min)
        high[along] = self.bar_min[along] + INTO_BAR
        low[along] = self.bar_max[along] - INTO_BAR
        ends = (self.min, high), (low, self.max)
        return bar, *(
            Box.between(f"{self.id}/post{side}", "stanchion", *end, self.face)
            for side, end in enumerate(ends)
        )


DIRECTION = Tuples((3,), -1e6, 1e6)
"""A vector of which the direction counts."""

LENGTH = Tuples((), MIN_SIZE, MAX_LENGTH, "m")
"""A length above zero."""

POSITION = replace(CORNER, hint="for a map in millimetres give unit 'mm'")
"""A position in a map."""

SEGMENT = Struct.of(Segment)
"""Fields of a `Segment`."""

HANDRAIL = Struct.of(Handrail)
"""Fields of a `Handrail`."""
