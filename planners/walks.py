"""Walks, sequences of states from a method or a policy, and the plans committed along them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mlivr_gym.arrays import Array
from mlivr_gym.motion.commitment import committed_motion
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.plan_parts import Query, Statistics, World
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State, moving_limb


class Walk(NamedTuple):
    """The walk that a method or a policy made."""

    states: tuple[State, ...]
    """K states, the first of them the start."""
    reached: bool
    """Whether the last state is at the goal."""
    expanded: int
    """Number of states expanded."""

    @property
    def actions(self) -> tuple[tuple[int, int], ...]:
        """Return the limb that moves and the point it moves to, for each of K - 1 steps."""
        pairs = []
        for before, after in zip(self.states, self.states[1:], strict=False):
            limb = moving_limb(before.stance, after.stance)
            pairs.append((limb, after.stance[limb]))
        return tuple(pairs)


def plan_of(
    graph: StanceGraph, states: Sequence[State], goal: Array, tolerance: float, method: str
) -> Plan | None:
    """Return the plan along a walk, or None if one of its steps cannot be committed.

    Each state is a successor of the one before it; the goal region of the base is a ball [m].
    """
    motion = committed_motion(graph, states).motion
    if motion is None:
        return None
    x, y, z = (float(value) for value in goal)
    query = Query((x, y, z), tolerance, "steps", None, method, "none")
    statistics = Statistics(float(len(motion.steps)), expanded=0, generated=0)
    return Plan(query, World.of(graph), motion, statistics)
