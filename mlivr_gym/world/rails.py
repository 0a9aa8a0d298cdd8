"""Rails along which points may be grasped, and handrails."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Segment:
    """A straight rail along which points may be grasped.

    Ends [m] and outward surface normal are given in the map's frame, width and thickness in [m].
    """

    id: str
    face: str
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    normal: tuple[float, float, float]
    width: float = 0.0256
    thickness: float = 0.013


@dataclass(frozen=True)
class Handrail:
    """A handrail: its bounding box with posts, and the bar alone.

    Lower and upper corners are given in the map's frame [m]; `axis` is that of the bar.
    """

    id: str
    face: str
    min: tuple[float, float, float]
    max: tuple[float, float, float]
    axis: str = "x"
    bar_min: tuple[float, float, float] | None = None
    bar_max: tuple[float, float, float] | None = None
