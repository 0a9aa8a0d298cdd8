"""Validators of values that only robots have."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from mlivr_gym.schema import FieldPath, ListOf, Tuples, Validator
from mlivr_gym.values import MAX_ROBOT_LENGTH

APART = (
    ("base", "upper_arm"),
    ("forearm", "wrist_2"),
    ("wrist_1", "wrist_3"),
    ("wrist_1", "gripper"),
)
"""Pairs of links that lie beside each other, by lengths that no joint angle changes."""


SMALLEST_BODY = 1e-3
"""Smallest edge of the body [m]: MuJoCo refuses the inertia of a smaller one."""

MOST_FOLDS = 4
"""Largest number of entries of `RobotSpec.folds`."""

MOST_POSES = 64
"""Largest number of candidate heights or rolls; the robots that ship have four and five."""


@dataclass(frozen=True)
class PairOf:
    """Validator of one of several pairs of names, in either order."""

    pairs: tuple[tuple[str, str], ...]
    """The pairs."""

    def read(self, value: object, place: FieldPath) -> tuple[str, str]:
        """Return the pair in the order in which it is listed."""
        given = value if isinstance(value, list | tuple) else ()
        for pair in self.pairs:
            if list(given) in (list(pair), list(pair[::-1])):
                return pair
        raise place.refused(value, "one of " + ", ".join(map(json.dumps, self.pairs)))


@dataclass(frozen=True)
class SizeOrEdges:
    """Validator of the edge of a cube [m], or of three edges of a box."""

    least: float = SMALLEST_BODY
    """Smallest edge [m]."""

    @property
    def edge(self) -> Tuples:
        """Validator of the edge of a cube."""
        return Tuples((), self.least, MAX_ROBOT_LENGTH, "m")

    @property
    def edges(self) -> Tuples:
        """Validator of three edges."""
        return Tuples((3,), self.least, MAX_ROBOT_LENGTH, "m")

    def read(self, value: object, place: FieldPath) -> Any:
        """Return a float, or a tuple of three; three equal edges are those of a cube."""
        if not _is_list(value):
            return self.edge.read(value, place)
        edges = self.edges.read(value, place)
        return edges[0] if len(set(edges)) == 1 else edges


@dataclass(frozen=True)
class OneOrEach:
    """Validator of one value for all, or of a list with one for each."""

    kind: Validator[Any]
    """Validator of each value."""

    def read(self, value: object, place: FieldPath) -> tuple[Any, ...]:
        """Return a tuple of the values, of one if a single value is given."""
        if _is_list(value):
            return ListOf(self.kind).read(value, place)
        return (self.kind.read(value, place),)


def _is_list(value: object) -> bool:
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)
