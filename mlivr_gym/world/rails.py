"""Rails along which points may be grasped, and handrails."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Segment:
    """A straight rail along which points may be grasped, ends in [m]."""

    id: str
    face: str
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    normal: tuple[float, float, float]
    width: float = 0.0256
    thickness: float = 0.013


@dataclass(frozen=True)
class Handrail:
    """A handrail: its bounding box with posts, and the bar alone, in [m]."""

    id: str
    face: str
    min: tuple[float, float, float]
    max: tuple[float, float, float]
    axis: str = "x"
    bar_min: tuple[float, float, float] | None = None
    bar_max: tuple[float, float, float] | None = None
