"""Walks of many limbs over the table of all nodes: better and better ones, and what none can beat.

The table tells what every step keeps at most, see `relaxed_steps`. The cheapest walk over that
bounds the cost of all plans. Nearly all steps keep that much, so the steps of a walk are checked,
and if one keeps less the next walk is looked for, until one is found whose steps are all known.
Before the cheapest others are looked for, of which what is left weighs more: they are found sooner.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.limb_masks import packed, unpacked
from mlivr_gym.planners.first_walk import masks_along
from mlivr_gym.planners.known_steps import KnownSteps
from mlivr_gym.planners.node_costs import LEAST, costs_to_goal
from mlivr_gym.planners.node_labels import ROOM, Labels, NodeOrigins, NodeWalk, cheapest_walk
from mlivr_gym.planners.pair_search import weights_of
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.set_bounds import fewest_moves
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.turns import turned
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_pairs import ends_of
from mlivr_gym.stances.node_steps import node_stances
from mlivr_gym.stances.node_table import ROUNDED, NodeTable
from mlivr_gym.transitions.state import State


class Manner(NamedTuple):
    """How the walks of one round are looked for."""

    factor: float
    """Weight of what is left."""
    most: int
    """Most labels of a node."""
    room: int = ROOM
    """Labels after which a search gives up."""
    bounds: bool = False
    """Whether steps keep what they may at most, so that no plan costs less than the walk."""


ROUNDS = (
    Manner(2.0, 4),
    Manner(1.0, ROOM, 500_000, bounds=True),
    Manner(1.2, 8),
    Manner(1.0, ROOM, bounds=True),
    Manner(1.0, ROOM),
)
"""One round after the other."""

FARTHER_BY = (0.03, 2.0)
"""How much farther than to the start costs are worked out: a share, and a number of steps."""

SAME = 1e-9
"""A walk whose cost is less by no more than this share is no better."""

At = tuple[State, Postures]


class NodeSearch:
    """Walks from a start to a goal over the table of all nodes.

    Attributes:
        low: No plan costs less; infinite if there is none.
        generated: Nodes reached on some branches, of all searches.
    """

    def __init__(self, graph: LazyGraph, table: NodeTable, goal: Goal, start: State) -> None:
        """Work out what is left at least from each node.

        Args:
            graph: The stance graph, without obstacles.
            table: All its nodes.
            goal: Where to go.
            start: Where to start, no goal.
        """
        self.graph, self.table, self.goal = graph, table, goal
        self.low, self.generated = 0.0, 0
        self._weights = weights_of(goal.cost)
        self._known, self._nothing = (KnownSteps.none(len(table.points)) for _ in range(2))
        self._labels = Labels.of(len(table.points))
        self._begun, self._origins, self._turns = self._begin(start)
        if not len(self._origins.nodes):
            self.low = np.inf
            return
        shift, step = goal.cost.base_weight, goal.cost.step_weight
        self._h = costs_to_goal(
            table, self._goals(), self._weights, self._origins.nodes, self._toward(),
            (FARTHER_BY[0] * (shift > 0.0), FARTHER_BY[1] * step),
        )  # fmt: skip

    def _begin(self, start: State) -> tuple[list[list[At]], NodeOrigins, IntArray]:
        """Ways to the nodes at which walks may begin, these, and the turns that lead to them."""
        graph, posture = self.graph, self.graph.posture_of(start)
        begun, costs = [[(start, posture)]], [0.0]
        if start.pose is not None:
            begun, costs = [], []
            for state, after in _steps_from(graph, start, posture):
                shift = float(np.linalg.norm(after.base_position[0] - posture.base_position[0]))
                begun.append([(start, posture), (state, after)])
                costs.append(self.goal.cost.base_weight * shift + self.goal.cost.step_weight)
        states = [one[-1][0] for one in begun]
        stances = np.array([s.stance for s in states], dtype=np.int64).reshape(-1, graph.limbs)
        masks = np.array([s.masks for s in states], dtype=np.int64).reshape(-1, graph.limbs)
        rows, turns = self.table.find(stances)
        origins = NodeOrigins(rows, packed(turned(masks, turns)), np.array(costs))
        return begun, origins, turns

    def _goals(self) -> BoolArray:
        """Nodes that may be at the goal, shape (n,)."""
        table, goal = self.table, self.goal
        away = table.base_position - goal.target
        close = np.einsum("ij,ij->i", away, away) <= (goal.tolerance + 2.0 * ROUNDED) ** 2
        close[close] = goal.held(table.points[close])
        return np.asarray(close)

    def _toward(self) -> Array:
        """Lower bounds of the cost from where walks begin, infinite for what is occupied."""
        graph, table, cost = self.graph, self.table, self.goal.cost
        toward: Array = np.full(len(table.points), np.inf)
        for place in table.base_position[self._origins.nodes]:
            away = table.base_position - place
            np.minimum(toward, np.einsum("ij,ij->i", away, away), out=toward)
        toward = cost.base_weight * np.sqrt(toward)
        sets = graph.sets(work_out=False)
        if cost.step_weight and sets is not None:
            moves, rows = np.full(len(sets), -1, dtype=np.int16), table.sets
            moves[rows[self._origins.nodes]] = 0
            fewest_moves(sets.rests, moves, np.zeros(sets.rest_count, dtype=np.bool_))
            least = moves[rows].astype(np.float64)
            toward += cost.step_weight * np.where(least < 0, np.inf, least)
        if graph.occupied:
            toward[np.isin(table.points, list(graph.occupied)).any(axis=1)] = np.inf
        return toward

    def _cheapest(self, manner: Manner, until: float, below: float) -> NodeWalk | None:
        """The cheapest walk, see `cheapest_walk`."""
        steps = self.table, self._nothing if manner.bounds else self._known, self._weights
        found, low = cheapest_walk(
            steps, self._h, self._origins, self._labels, manner[:3], below=below, until=until
        )
        if manner.bounds:
            self.low = max(self.low, low)
        self.generated += self._labels.used
        return found

    def walks(self, until: float, below: float = np.inf) -> Iterator[list[At]]:
        """Walks to the goal, each cheaper than the last, as long as more are found.

        Args:
            until: When to give up, on the clock of `time.perf_counter`.
            below: Cost that the first must not reach.
        """
        for manner in ROUNDS:
            while time.perf_counter() < until and self.low < below * (1.0 - SAME):
                walk = self._cheapest(manner, until, below * (1.0 - SAME))
                if walk is None:
                    break
                self._learn(walk.bits)
                states = self._states(walk) if self._stands(walk) else None
                if states is not None:
                    last, posture = states[-1]
                    if not self.goal.reached(posture.base_position[0], last.stance):
                        # It lies beside the goal by less than positions are kept.
                        self._h[walk.nodes[-1]] = LEAST
                        continue
                    cost = self._cost(states)
                    if cost < below * (1.0 - SAME):
                        below = cost
                        yield states
                    break
                if manner.bounds:
                    break

    def _cost(self, states: list[At]) -> float:
        """What a walk costs."""
        places = np.concatenate([posture.base_position for _, posture in states])
        shift = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
        return self.goal.cost.base_weight * shift + self.goal.cost.step_weight * (len(states) - 1)

    def _learn(self, bits: IntArray) -> None:
        """Check steps that are not known."""
        graph, new = self.graph, np.unique(bits[~self._known.has(bits)])
        if not len(new):
            return
        (before, i), (after, j), back = ends_of(self.table, new)
        rows, turns = np.concatenate([before, after]), np.concatenate([np.zeros_like(i), j - i])
        stances = node_stances(graph.grasp_map, graph.robot, self.table, rows, turns)
        here = np.arange(len(new))
        steps = graph.step_rows(stances, here, here + len(new), stances.mask[here])
        found = graph.masks_of_steps(steps, stances)
        kept = packed(turned(found, i + 1)[:, : graph.limbs - 1])
        kept[~found.all(axis=1)] = 0
        self._known = self._known.with_steps(before, new, kept)
        self._known = self._known.with_steps(after, back, kept)

    def _stands(self, walk: NodeWalk) -> bool:
        """Whether every limb keeps a branch all along a walk, by what is known of its steps."""
        limbs = self.graph.limbs
        (_, i), (after, j), _ = ends_of(self.table, walk.bits)
        kept = unpacked(self._known.of(walk.bits), limbs - 1)
        released = unpacked(self.table.released[after], limbs)
        masks = unpacked(walk.masks[:1], limbs)[0]
        for k in range(len(walk.bits)):
            held = np.roll(masks, -i[k] - 1)[:-1] & kept[k]
            if not held.all():
                return False
            masks = np.roll(np.append(held, released[k, j[k]]), j[k] + 1)
        return True

    def _states(self, walk: NodeWalk) -> list[At] | None:
        """The states of a walk; None if a step is none as the robot stands, which is noted."""
        begun = self._begun[walk.origin]
        (before, i), (after, j), backward = ends_of(self.table, walk.bits)
        turns = -np.cumsum([self._turns[walk.origin], *(i - j).tolist()])
        stances = turned(self.table.points[walk.nodes].astype(np.int64), turns)
        masks = turned(unpacked(walk.masks, self.graph.limbs), turns)
        followed = self.graph.nodes(stances[1:])
        found = masks_along(self.graph, stances, masks, join(begun[-1][1], followed))
        bad = np.flatnonzero(~found.all(axis=1))
        if len(bad):
            none = np.zeros(len(bad), dtype=np.uint64)
            self._known = self._known.with_steps(before[bad], walk.bits[bad], none)
            self._known = self._known.with_steps(after[bad], backward[bad], none)
            return None
        rest = [
            (State(tuple(stance), tuple(mask)), followed.take(np.array([k])))
            for k, (stance, mask) in enumerate(
                zip(stances[1:].tolist(), masks[1:].tolist(), strict=True)
            )
        ]
        return [*begun, *rest]


def _steps_from(graph: LazyGraph, start: State, posture: Postures) -> list[At]:
    """What steps from a state lead to."""
    stances = graph.neighbours(start, posture)
    postures = graph.nodes(stances)
    nodes = np.flatnonzero(graph.is_node(postures))
    stances, postures = stances[nodes], postures.take(nodes)
    before = np.zeros(len(nodes), dtype=np.int64)
    masks = graph.masks_after([start], posture, before, stances, postures)
    return [
        (State(tuple(stances[k].tolist()), tuple(masks[k].tolist())), postures.take(np.array([k])))
        for k in np.flatnonzero(masks.all(axis=1)).tolist()
    ]
