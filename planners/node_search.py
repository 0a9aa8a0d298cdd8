"""Walks of many limbs over the table of all nodes: better and better ones, and what none can beat.

Where steps are not checked a walk is found in no time, and most of its steps turn out to be some.
So the cheapest such walk is looked for, its steps are checked, and then the next, until one has no
step that is not known. In the first rounds what is left weighs more, as walks are found sooner so.

What a step keeps depends on the branches that the limbs are on, so that walks over what is known to
be kept bound nothing. Those over what steps may keep at most do, see `relaxed_steps`: the cheapest
of them bounds the cost of all plans, before any step is checked and ever better afterwards.
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
from mlivr_gym.planners.node_labels import Labels, NodeOrigins, NodeWalk, cheapest_walk
from mlivr_gym.planners.pair_search import weights_of
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.set_bounds import fewest_moves
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.turns import turned
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_pairs import ends_of
from mlivr_gym.stances.node_steps import moves_of, node_stances
from mlivr_gym.stances.node_table import ROUNDED, NodeTable
from mlivr_gym.transitions.state import State


class Manner(NamedTuple):
    """How the walks of one round are looked for."""

    factor: float
    """Weight of what is left."""
    unknown: float
    """Share of the charge for an unknown step."""
    most: int
    """Most labels of a node."""
    bounds: bool
    """Whether steps keep what they may at most, so that no plan costs less than the walk."""


EVERY_LABEL = 1 << 30
"""More labels than a node has."""

ROUNDS = (
    Manner(2.0, 1.0, 4, bounds=False),
    Manner(1.5, 1.0, 4, bounds=False),
    Manner(1.2, 0.5, 8, bounds=False),
    Manner(1.0, 0.0, EVERY_LABEL, bounds=True),
    Manner(1.0, 0.0, EVERY_LABEL, bounds=False),
)
"""One round after the other."""

AT_FIRST = 0.3
"""How long the cheapest walk is looked for before any step is checked [s]."""

CHARGE = (0.1, 0.15)
"""Charge for an unknown step: a share of what one costs, and a base displacement [m]."""

FARTHER_BY = (0.03, 2.0)
"""How much farther than to the start costs are worked out: a share, and a number of steps."""

SAME = 1e-9
"""A walk whose cost is less by no more than this share is no better."""

OTHERS = 8
"""Steps from each node of a walk that are checked with those of the walk, the most promising."""

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
        self._known, self._most = (KnownSteps.none(len(table.points)) for _ in range(2))
        self._labels = Labels.of(len(table.points))
        self._begun, self._origins, self._turns = self._begin(start)
        if not len(self._origins.nodes):
            self.low = np.inf
            return
        shift, step = goal.cost.base_weight, goal.cost.step_weight
        self._charge = CHARGE[0] * step + CHARGE[1] * shift
        self._h = costs_to_goal(
            table, self._goals(), self._weights, self._origins.nodes, self._toward(),
            (FARTHER_BY[0] * (shift > 0.0), FARTHER_BY[1] * step),
        )  # fmt: skip
        self._cheapest(ROUNDS[-2], time.perf_counter() + AT_FIRST, np.inf)

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
        known = self._most if manner.bounds else self._known
        charged = manner.factor, manner.unknown * self._charge, manner.most
        steps = self.table, known, self._weights
        found, low = cheapest_walk(
            steps, self._h, self._origins, self._labels, charged, below=below, until=until
        )
        if manner.bounds:
            self.low = max(self.low, low)
        self.generated += int(self._labels.entries.filled["used"])
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
                if not self._check(walk, manner):
                    continue
                states = self._states(walk)
                if states is None:
                    if manner.bounds:
                        break
                    continue
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

    def _cost(self, states: list[At]) -> float:
        """What a walk costs."""
        places = np.concatenate([posture.base_position for _, posture in states])
        shift = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
        return self.goal.cost.base_weight * shift + self.goal.cost.step_weight * (len(states) - 1)

    def _check(self, walk: NodeWalk, manner: Manner) -> bool:
        """Check the steps of a walk that are not known; whether all were."""
        known = self._most if manner.bounds else self._known
        if known.has(walk.bits).all():
            return True
        graph, limbs, bits = self.graph, self.graph.limbs, walk.bits
        if not manner.bounds:
            bits = np.concatenate([bits, *map(self._promising, walk.nodes[:-1].tolist())])
        new = np.unique(bits[~known.has(bits)])
        (before, i), (after, j), back = ends_of(self.table, new)
        rows, turns = np.concatenate([before, after]), np.concatenate([np.zeros_like(i), j - i])
        stances = node_stances(graph.grasp_map, graph.robot, self.table, rows, turns)
        here = np.arange(len(new))
        steps = graph.step_rows(stances, here, here + len(new), stances.mask[here])
        ask = graph.most_of_steps if manner.bounds else graph.masks_of_steps
        found = ask(steps, stances)
        kept = packed(turned(found, i + 1)[:, : limbs - 1])
        if manner.bounds:
            self._most = self._most.with_steps(before, new, kept)
        else:
            kept[~found.all(axis=1)] = 0
            self._known = self._known.with_steps(before, new, kept)
            self._known = self._known.with_steps(after, back, kept)
        return False

    def _promising(self, node: int) -> IntArray:
        """The bits of some steps from a node, those after which the least is left to go."""
        _, rows, _, bits = moves_of(self.table, node, 0)
        away = np.linalg.norm(
            self.table.base_position[rows] - self.table.base_position[node], axis=1
        )
        to_go = self.goal.cost.base_weight * away + self._h[rows]
        return bits[np.argsort(to_go, kind="stable")[:OTHERS]]

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
