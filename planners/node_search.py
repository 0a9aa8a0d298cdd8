"""Walks of many limbs over the table of all nodes: better and better ones, and what none can beat.

The table tells what every step keeps at most, see `relaxed_steps`. The cheapest walk over that
bounds the cost of all plans. Nearly all steps keep that much, so the steps of a walk are checked,
and if one keeps less the next walk is looked for, until one is found whose steps are all known.
Before the cheapest others are looked for, of which what is left weighs more: they are found sooner.
What is left at least comes from `node_bounds`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.limb_masks import packed, unpacked
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.first_walk import At, masks_along
from mlivr_gym.planners.known_steps import KnownSteps
from mlivr_gym.planners.node_bounds import Bounds, NodeBounds
from mlivr_gym.planners.node_costs import LEAST
from mlivr_gym.planners.node_labels import ROOM, Labels, NodeOrigins, NodeWalk, cheapest_walk
from mlivr_gym.planners.pair_search import weights_of
from mlivr_gym.planners.query import Goal
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.turns import turned
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_pairs import ends_of
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


FIRST, AT_ONCE = Manner(1.3, 8), Manner(1.3, 8, 100_000)
"""What finds a first walk; and the same where there is another way to look for one."""

SOON = Manner(1.0, ROOM, 500_000, bounds=True)
"""What finds the cheapest walk if that is soon."""

ROUNDS = FIRST, SOON, Manner(1.1, 8), Manner(1.0, ROOM, bounds=True), Manner(1.0, ROOM)
"""One round after the other."""

ROUND = 200
"""Nodes that are looked at about one which touches an obstacle."""

SAME = 1e-9
"""A walk whose cost is less by no more than this share is no better."""


class NodeSearch:
    """Walks from a start to a goal over the table of all nodes.

    Attributes:
        low: No plan costs less; infinite if there is none.
        generated: Nodes reached on some branches, of all searches.
        found: Whether there was a walk.
    """

    def __init__(self, bounds: NodeBounds, goal: Goal, start: State) -> None:
        """Look up where walks may begin.

        Args:
            bounds: What is left at least.
            goal: Where to go.
            start: Where to start, no goal.
        """
        self.graph, self.goal, self._bounds = bounds.graph, goal, bounds
        self._world = bounds.world()
        self.table = self._world.table
        self.low, self.generated, self.found = 0.0, 0, False
        self._known, self._nothing = (KnownSteps.none(len(self.table.points)) for _ in range(2))
        self._labels = Labels.of(len(self.table.points))
        self._begun, self._origins, self._turns = self._begin(start)

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

    def _guides(self, until: float) -> Iterator[tuple[Bounds, tuple[Manner, ...]]]:
        """What is left at least, and the rounds of searches that it serves.

        What is known from plans before comes first; as long as there is no walk then the fewest
        steps, which are known sooner than what else is charged.
        """
        goal, starts = self.goal, self._origins.nodes
        known = self._bounds.known(goal, starts)
        if known is not None and known.occupied == self.graph.occupied:
            yield known, ROUNDS
            return
        if known is not None:
            yield known, (AT_ONCE if goal.cost.base_weight else FIRST,)
        if goal.cost.base_weight and not self.found:
            steps = replace(goal, cost=Cost.named("steps"))
            yield self._bounds.known(steps, starts) or self._bounds.to(steps, starts), (FIRST,)
        if known is not None and self.found:
            yield known, (SOON,)
        if time.perf_counter() < until:
            yield self._bounds.to(goal, starts), ROUNDS

    def walks(self, until: float) -> Iterator[list[At]]:
        """Walks to the goal, each cheaper than the last, as long as more are found.

        Args:
            until: When to give up, on the clock of `time.perf_counter`.
        """
        if not len(self._origins.nodes):
            self.low = np.inf
            return
        below = np.inf
        for guide, manners in self._guides(until):
            self._look_at(guide)
            for manner in manners:
                walk = self._next(guide, manner, until, below)
                if walk is not None:
                    self.found, below = True, self._cost(walk)
                    yield walk
                if self.low >= below * (1.0 - SAME):
                    return

    def _look_at(self, guide: Bounds) -> None:
        """Note what no plan costs less than."""
        origins = self._origins
        least = float((origins.cost + guide.h[origins.nodes]).min())
        if guide.cost == self.goal.cost or least == np.inf:
            self.low = max(self.low, least)

    def _next(self, guide: Bounds, manner: Manner, until: float, below: float) -> list[At] | None:
        """A walk that costs less than the last; None if a round finds none."""
        most = below * (1.0 - SAME)
        while time.perf_counter() < until and self.low < most:
            known = self._nothing if manner.bounds else self._known
            steps = self.table, known, weights_of(guide.cost)
            walk, low = cheapest_walk(
                steps, guide.h, self._origins, self._labels, manner[:3], below=most, until=until
            )
            self.generated += self._labels.used
            if manner.bounds:
                self.low = max(self.low, low)
            if walk is None:
                return None
            if self._world.look_at(walk.nodes):
                self._look_round(walk.nodes)
                continue
            self._learn(walk.bits)
            states = self._states(walk) if self._stands(walk) else None
            if states is not None:
                last, posture = states[-1]
                if not self.goal.reached(posture.base_position[0], last.stance):
                    # It lies beside the goal by less than positions are kept.
                    guide.h[walk.nodes[-1]] = LEAST
                    continue
                return states if self._cost(states) < most else None
            if manner.bounds:
                return None
        return None

    def _look_round(self, nodes: IntArray) -> None:
        """Look at nodes that were reached about those of a walk which touches something."""
        touching = nodes[self.table.masks[nodes] != self._bounds.table.masks[nodes]]
        reached = self._labels.waiting.node[: self._labels.used].astype(np.int64)
        for node in touching.tolist():
            self._world.look_at(reached, ROUND, self.table.base_position[node])

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
        stances = self._world.stances(rows, turns)
        here = np.arange(len(new))
        steps = graph.step_rows(stances, here, here + len(new), stances.mask[here])
        found = graph.masks_of_steps(steps, stances)
        self._world.learn_released(rows, turns, stances)
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
