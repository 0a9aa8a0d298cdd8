"""Walks: sequences of states that a method finds or a policy takes, and the plans they make."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mlivr_gym.arrays import Array
from mlivr_gym.errors import StanceError
from mlivr_gym.motion.commitment import committed_motion
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.plan_parts import Query, Statistics, World
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State, moving_limb


class Walk(NamedTuple):
    """What a method found.

    Attributes
    ----------
    states
        K states, the first of them the start.
    reached
        Whether the last one is at the goal.
    expanded
        States expanded.
    """

    states: tuple[State, ...]
    reached: bool
    expanded: int

    @property
    def actions(self) -> tuple[tuple[int, int], ...]:
        """Limb that moves and point it moves to, K - 1 pairs."""
        pairs = []
        for before, after in zip(self.states, self.states[1:], strict=False):
            limb = moving_limb(before.stance, after.stance)
            pairs.append((limb, after.stance[limb]))
        return tuple(pairs)


def plan_of(
    graph: StanceGraph,
    states: Sequence[State],
    goal: Array,
    tolerance: float,
    method: str,
    expanded: int = 0,
) -> Plan | None:
    """The plan of a walk; None if one of its steps is not executable after those before it.

    Parameters
    ----------
    graph
        The stance graph.
    states
        The states, each a step from the one before it.
    goal
        Goal position [m], shape (3,).
    tolerance
        Radius of the goal region [m].
    method
        Name of what found the states.
    expanded
        States explored.
    """
    motion = committed_motion(graph, states).motion
    if motion is None:
        return None
    x, y, z = (float(value) for value in goal)
    query = Query((x, y, z), tolerance, "steps", None, method, "none")
    statistics = Statistics(float(len(motion.steps)), expanded, expanded)
    return Plan(query, World.of(graph), motion, statistics)


def edges_along(graph: StanceGraph, stances: Sequence[Sequence[str | int]]) -> int:
    """How many steps of a sequence of stances are edges of a graph, from the first on."""
    points = [graph.indices(stance) for stance in stances]
    try:
        state = graph.state(points[0])
    except StanceError:
        return 0
    for done, stance in enumerate(points[1:]):
        after = graph.step_to(state, stance)
        if after is None:
            return done
        state = after
    return len(points) - 1
