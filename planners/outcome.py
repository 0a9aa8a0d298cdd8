"""What searches find."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.transitions.state import State

FOUND, EXHAUSTED, LIMIT = 0, 1, 2
"""How a search ends: at a goal, with nothing more to expand, or at its limit of expansions or of
time."""


@dataclass(frozen=True)
class Improvement:
    """A plan that a search found before it ended.

    Attributes
    ----------
    time
        When [s], from the start of the search.
    cost
        Cost of the plan.
    bound
        Factor of the least cost within which it was proved then; infinite if within none.
    """

    time: float
    cost: float
    bound: float


@dataclass(frozen=True)
class Path:
    """What a search found.

    Attributes
    ----------
    status
        `FOUND`, `EXHAUSTED` or `LIMIT`.
    states
        States from the start to the last one explored, the goal if it was found.
    cost
        Cost of the path to it.
    expanded
        States expanded.
    generated
        States generated.
    tree
        Base positions at both ends of each explored step, shape (e, 2, 3) [m].
    backward
        Nodes that a search backward has settled for the lower bound.
    bound
        Factor of the least cost within which the path is proved; infinite if within none.
    improvements
        The plans found one after the other, each better than the last.
    """

    status: int
    states: tuple[State, ...]
    cost: float
    expanded: int
    generated: int
    tree: Array
    backward: int = 0
    bound: float = math.inf
    improvements: tuple[Improvement, ...] = ()


def tree_of(position: Array, parents: Sequence[int]) -> Array:
    """Base positions at both ends of each explored step, shape (e, 2, 3) [m]."""
    above = np.array(parents[1:], dtype=np.int64)
    return np.stack([position[above], position[1:]], axis=1)


def chain_to(parents: Sequence[int], last: int = -1) -> list[int]:
    """Indices from the first to the last entry, or to another one, along the parents."""
    chain = [last % len(parents)]
    while parents[chain[-1]] >= 0:
        chain.append(int(parents[chain[-1]]))
    return chain[::-1]
