"""Swings by a sampling planner (RRT-Connect), where no simple swing serves.

Two trees grow towards each other in joint space, each line of them checked as a whole (Kuffner and
LaValle, ICRA 2000); the chain that joins them is then shortened. The random numbers are seeded: the
same question has the same answer.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mlivr_gym.arrays import Array

MOST_CHECKS = 3000
"""Most lines that are checked in one search."""

LONGEST_LINE = 1.0
"""Longest line that is added to a tree [rad], by the joint that turns farthest."""

ROUND = np.pi
"""How far beyond both ends a joint is looked for [rad]."""

SHORTCUTS = 60
"""Pairs of knots between which a direct line is tried."""

SEED = 20251121
"""Seed of the random numbers."""


def sampled_line(
    clear: Callable[[Array], bool], limits: Array, start: Array, end: Array
) -> Array | None:
    """Knots from one knot to another while the base rests, shape (k, 7), or None if none are found.

    Args:
        clear: Whether the robot touches nothing along a chain of knots, shape (k, 7).
        limits: Joint limits [rad], shape (6, 2).
        start: Base parameter and joint angles [rad] of the first knot, shape (7,).
        end: Those of the last, with the same base parameter.
    """
    low = np.maximum(np.minimum(start[1:], end[1:]) - ROUND, limits[:, 0])
    high = np.minimum(np.maximum(start[1:], end[1:]) + ROUND, limits[:, 1])
    rng, checks = np.random.default_rng(SEED), _Checks(clear)
    trees = _Tree(start), _Tree(end)
    while checks.remaining > 0:
        target = np.concatenate([start[:1], rng.uniform(low, high)])
        here = trees[0].grow(target, checks)
        if here is not None:
            there = trees[1].reach(trees[0].knots[here], checks)
            if there is not None:
                chain = [*trees[0].chain(here), *trees[1].chain(there)[-2::-1]]
                knots = np.array(chain if trees[0].knots[0] is start else chain[::-1])
                return _shortened(knots, rng, checks)
        trees = trees[1], trees[0]
    return None


class _Checks:
    """Lines that may still be checked."""

    def __init__(self, clear: Callable[[Array], bool]) -> None:
        self._clear, self.remaining = clear, MOST_CHECKS

    def line(self, a: Array, b: Array) -> bool:
        """Whether a line is clear; never if none may be checked any more."""
        self.remaining -= 1
        return self.remaining >= 0 and self._clear(np.stack([a, b]))


class _Tree:
    """A tree of knots that lines join."""

    def __init__(self, root: Array) -> None:
        self.knots, self._parents = [root], [-1]

    def grow(self, target: Array, checks: _Checks) -> int | None:
        """Add a line from the nearest knot towards a target; the new knot, None if blocked."""
        away = np.abs(np.array(self.knots) - target).max(axis=1)
        nearest = int(away.argmin())
        share = min(1.0, LONGEST_LINE / max(float(away[nearest]), 1e-12))
        here = self.knots[nearest]
        new = target if share == 1.0 else here + share * (target - here)
        if not checks.line(here, new):
            return None
        self.knots.append(new)
        self._parents.append(nearest)
        return len(self.knots) - 1

    def reach(self, target: Array, checks: _Checks) -> int | None:
        """Add lines until a target is reached; its knot, None if blocked."""
        while True:
            new = self.grow(target, checks)
            if new is None or self.knots[new] is target:
                return new

    def chain(self, knot: int) -> list[Array]:
        """Knots from the root to one of the tree."""
        out = []
        while knot >= 0:
            out.append(self.knots[knot])
            knot = self._parents[knot]
        return out[::-1]


def _shortened(knots: Array, rng: np.random.Generator, checks: _Checks) -> Array:
    """The chain without knots that a direct line can leave out."""
    checks.remaining = SHORTCUTS
    while len(knots) > 2 and checks.remaining > 0:
        i, j = np.sort(rng.choice(len(knots), 2, replace=False))
        if j - i > 1 and checks.line(knots[i], knots[j]):
            knots = np.concatenate([knots[: i + 1], knots[j:]])
        elif j - i <= 1:
            checks.remaining -= 1
    return knots
