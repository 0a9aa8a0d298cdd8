"""A step that is to be checked, and the edge that it is if it passes."""

from __future__ import annotations

from typing import Any, NamedTuple

from mlivr_gym.arrays import Array
from mlivr_gym.postures.solver import Postures


class Edge(NamedTuple):
    """An edge of the graph: base path, swing, and the branches that limbs keep on it."""

    kind: int
    """Kind of the base path, `base_path.STRAIGHT` or `base_path.ARC`."""
    fold: int
    """Fold in which the limb can be moved, -1 without collisions or if it swings along a line."""
    pair: int
    """Branches between which the limb can swing along a line, `8 * before + after`, or -1."""
    kept: dict[int, int]
    """Branches on which the limbs that hold can follow it, by limb; none if it is no edge."""


class Candidate(NamedTuple):
    """A step that is to be checked."""

    limb: int
    """Limb that moves."""
    before: tuple[int, ...]
    """Point index of each limb before the step."""
    after: tuple[int, ...]
    """Point index of each limb after it."""
    posture: Postures
    """Postures of both stances."""
    pivot: Array
    """Centre of a base path that is an arc: the centroid of the held points [m], shape (3,)."""
    held: tuple[int, ...]
    """Limbs that hold."""

    @property
    def ends(self) -> tuple[tuple[tuple[int, ...], Postures], ...]:
        """Stance and posture before the step and after it."""
        first, second = (self.posture.take(slice(k, k + 1)) for k in range(2))
        return (self.before, first), (self.after, second)

    def path(self, kind: int) -> tuple[Any, ...]:
        """The base path between the postures as the kernels take it."""
        p, r = self.posture.base_position, self.posture.base_rotation
        return (p[0], r[0], p[1], r[1], kind, self.pivot)
