"""Kinds of values that only robots have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mlivr_gym.schema import FieldPath, Tuples
from mlivr_gym.values import LONGEST_ROBOT


@dataclass(frozen=True)
class SizeOrEdges:
    """The edge of a cube [m], or three edges of a box.

    Attributes
    ----------
    least
        Smallest edge [m].
    """

    least: float

    @property
    def edge(self) -> Tuples:
        """Kind of the edge of a cube."""
        return Tuples((), self.least, LONGEST_ROBOT, "m")

    @property
    def edges(self) -> Tuples:
        """Kind of three edges."""
        return Tuples((3,), self.least, LONGEST_ROBOT, "m")

    def read(self, value: object, place: FieldPath) -> Any:
        """Return a float, or a tuple of three; three equal edges are those of a cube."""
        several = isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim)
        if not several:
            return self.edge.read(value, place)
        edges = self.edges.read(value, place)
        return edges[0] if len(set(edges)) == 1 else edges
