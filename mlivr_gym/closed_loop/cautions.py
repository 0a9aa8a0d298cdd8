"""How large a robot takes sensed obstacles to be, from most to least cautious."""

from __future__ import annotations

from typing import NamedTuple


class Caution(NamedTuple):
    """How large sensed boxes are, and how much evidence they need."""

    margin: float
    """Distance by which a box extends beyond the hits in its cubes [m]."""
    hits: int
    """Number of hits that make a cube an obstacle; beside such a cube one hit is enough."""
    is_denoised: bool = False
    """Whether what the noise adds to the extent of the hits is taken away, see `Belief`."""
    is_merged: bool = True
    """Whether cubes are merged into boxes, which fill narrow gaps, or each is a box of its own."""


CAUTIONS = (
    Caution(0.01, 2),
    Caution(0.001, 2),
    Caution(0.001, 2, is_denoised=True),
    Caution(0.001, 3, is_denoised=True),
    Caution(0.001, 3, is_denoised=True, is_merged=False),
)
"""The first holds as long as there is a plan; then the robot has to be less cautious."""
