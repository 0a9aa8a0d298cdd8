"""Label-setting search over the table of a graph, for any number of limbs; edges checked lazily.

The table tells what every edge keeps at most, so the cheapest walk over it bounds the cost of all
plans. Nearly all edges keep that much. So the edges of a walk are checked, and where one keeps less
the next walk is looked for, until one is found whose edges are all known. With two limbs that is
all. With more there are rounds: before the cheapest walk others are looked for, with a lower weight
of the cost so far, which are found sooner, and each that is found is an incumbent with a gap.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.limb_masks import packed, unpacked
from mlivr_gym.kinematics.batches import distances
from mlivr_gym.planners.backward_search import LEAST
from mlivr_gym.planners.checked_edges import CheckedEdges
from mlivr_gym.planners.costs import Cost, weights_of
from mlivr_gym.planners.label_search import (
    CAPACITY,
    NO_LABEL,
    PAUSED,
    NodeOrigins,
    NodeWalk,
    SearchParameters,
    cheapest_walk,
)
from mlivr_gym.planners.lazy_table import StatePath
from mlivr_gym.planners.lower_bounds import GoalBounds, LowerBounds
from mlivr_gym.planners.outcome import EXHAUSTED, FOUND, LIMIT, Improvement, Path
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.postures.turns import permuted_limbs
from mlivr_gym.stances.node_pairs import edge_ends
from mlivr_gym.transitions.state import State


class SearchStage(NamedTuple):
    """How the walks of one round are looked for."""

    parameters: SearchParameters
    """How each is."""
    admissible: bool = False
    """Whether edges keep what they may at most, so that no plan costs less than the walk."""
    confirms: bool = False
    """Whether it follows only where the round before came to an end without a walk."""


SOONER = 1.0 / 1.3, 8
"""Weight of the cost so far, and most labels of a node, of a search for a first walk."""

FIRST, AT_ONCE = (
    SearchStage(SearchParameters(*SOONER)),
    SearchStage(SearchParameters(*SOONER, 100_000)),
)
"""What finds a first walk; and the same where there is another way to look for one."""

STAGES = (
    FIRST,
    SearchStage(SearchParameters(1.0 / 1.1, 8)),
    SearchStage(SearchParameters(), admissible=True),
    SearchStage(SearchParameters()),
)
"""One round after the other."""

TRAPPED = SearchStage(SearchParameters(0.5, max_expansions=300, lazy=True), admissible=True)
"""What finds out soon that few states can be reached."""

ENCLOSED = SearchStage(
    SearchParameters(0.5, max_expansions=300, lazy=True, equal_only=True),
    admissible=True,
    confirms=True,
)
"""What comes to all of them, and so proves it."""

BLOCKED = TRAPPED, ENCLOSED, SearchStage(SearchParameters(0.5, 8)), *STAGES
"""The rounds among obstacles."""

ABOUT = 200
"""Nodes that are looked at about one which touches an obstacle."""

PATIENCE = 100
"""Labels expanded before lower bounds are brought closer by what was found of edges; four times as
many each time."""

BACKWARD = 4
"""Times as many are expanded backward for them."""

SAME = 1e-9
"""A walk whose cost is less by no more than this share is no better."""


def search_table(bounds: LowerBounds, search: SearchQuery, start: State) -> Path | None:
    """Search from a state over the table of a graph.

    Parameters
    ----------
    bounds
        Lower bounds on the graph.
    search
        What to look for, and stage.
    start
        Where to start.

    Returns
    -------
    Path | None
        What was found; None if the goal is not connected with the start, whatever steps there are.
    """
    running = _TableSearch(bounds, search, start)
    if running.arrived:
        return Path(FOUND, (start,), 0.0, 1, 1, np.zeros((0, 2, 3)), bound=1.0)
    best, improvements = None, []
    for walk in running.walks():
        cost = running.cost(walk)
        best, bound = walk, running.bound(cost)
        passed = time.perf_counter() - search.began
        improvements.append(Improvement(passed, cost, bound))
        if bound <= search.inflation:
            break
    counts = running.expanded, running.generated, running.tree()
    if best is None:
        if running.low == np.inf and not bounds.connected(search.goal, start):
            return None
        status = EXHAUSTED if running.low == np.inf else LIMIT
        return Path(status, (start,), 0.0, *counts, running.backward)
    cost = running.cost(best)
    return Path(
        FOUND, best.states, cost, *counts, running.backward, running.bound(cost),
        tuple(improvements),
    )  # fmt: skip


class _TableSearch:
    """A search in progress.

    Attributes
    ----------
    low
        No plan costs less; infinite if there is none.
    found
        Whether there was a walk.
    expanded
        Labels expanded, of all searches.
    generated
        Labels generated.
    backward
        Nodes whose exact cost-to-go was worked out.
    """

    def __init__(self, bounds: LowerBounds, search: SearchQuery, start: State) -> None:
        self.graph, self.goal, self.search = bounds.graph, search.goal, search
        self._bounds, self._world = bounds, bounds.world
        self.low, self.found = 0.0, False
        self.expanded = self.generated = self.backward = self._explored = 0
        self._end = PAUSED
        self._labels = bounds.labels
        self._nothing = CheckedEdges.none(len(bounds.table.points))
        position = self.graph.posture_of(start).base_position
        self.arrived = bool(self.goal.reached(position[0], start.stance))
        self._origin_paths: list[StatePath] = []
        self._set_origins(StatePath((start,), position))

    def _set_origins(self, start: StatePath) -> None:
        """Note ways to the nodes at which walks may begin, these, and the turns that lead there."""
        state, here = start.states[0], start.positions[0]
        states, costs = [state], np.zeros(1)
        self._origin_paths = [start]
        if state.pose is not None:
            # The steps that leave a given pose are edges of no table.
            steps = self.graph.successors(state)
            states = [steps.after(state, k) for k in range(len(steps.limb))]
            places = steps.base_in_world
            self._origin_paths = [
                StatePath((state, after), np.stack([here, place]))
                for after, place in zip(states, places, strict=True)
            ]
            shift = np.linalg.norm(places - here, axis=1)
            costs = self.goal.cost.base_weight * shift + self.goal.cost.step_weight
        stances = np.array([s.stance for s in states], dtype=np.int64)
        masks = np.array([s.masks for s in states], dtype=np.int64)
        rows, self._turns = self._world.table.find(stances.reshape(-1, self.graph.limbs))
        masks = masks.reshape(-1, self.graph.limbs)
        self._origins = NodeOrigins(rows, packed(permuted_limbs(masks, self._turns)), costs)

    def _guides(self) -> Iterator[tuple[GoalBounds, tuple[SearchStage, ...]]]:
        """Lower bounds, and the rounds of searches that they serve.

        What is known from plans before comes first; as long as there is no walk then the fewest
        steps, which are known sooner than what else is charged.
        """
        search, goal, starts = self.search, self.goal, self._origins.nodes
        world = self._world
        rounds: tuple[SearchStage, ...] = STAGES
        first: tuple[SearchStage, ...] = (FIRST,)
        if world.exact:
            rounds = (
                SearchStage(
                    SearchParameters(search.g_weight, lazy=not world.complete), admissible=True
                ),
            )
            if search.heuristic != "cost_to_go":
                yield self._bounds.by_distance(search), rounds
                return
        elif self.graph.obstacles:
            rounds, first = BLOCKED, BLOCKED[:3]
        known = self._bounds.known(goal, starts)
        if world.exact and not world.complete:
            yield from self._learning(known or self._bounds.to(goal, starts))
            return
        if known is not None and (world.exact or known.occupied == self.graph.occupied):
            yield known, rounds
            return
        if known is not None:
            yield known, (AT_ONCE,) if first == (FIRST,) and goal.cost.base_weight else first
        if goal.cost.base_weight and not world.exact and not self.found:
            steps = replace(goal, cost=Cost.named("steps"))
            yield self._bounds.known(steps, starts) or self._bounds.to(steps, starts), first
        if time.perf_counter() < search.until:
            new = self._bounds.to(goal, starts)
            self.backward += int(new.exact.sum())
            yield new, rounds

    def _learning(self, guide: GoalBounds) -> Iterator[tuple[GoalBounds, tuple[SearchStage, ...]]]:
        """Bounds that come closer to the cost as more edges turn out to be none."""
        search, patience = self.search, PATIENCE
        while True:
            parameters = SearchParameters(search.g_weight, max_expansions=patience, lazy=True)
            yield guide, (SearchStage(parameters, admissible=True),)
            late = time.perf_counter() >= search.until
            if late or self.low == np.inf or self.expanded >= search.limit:
                return
            if self._origin_paths[0].states[0].pose is None:
                guide = self._backward(guide, BACKWARD * patience)
            patience *= 4

    def _backward(self, guide: GoalBounds, limit: int) -> GoalBounds:
        """Closer bounds, from a search backward from the goal that checks its edges.

        An edge of two limbs keeps the same there and back, so that search is the same one. Where it
        got to, costs are exact; all else costs at least what it had come to, less what leads there.
        """
        world, goal, start = self._world, self.goal, self._origins.nodes[0]
        base, nodes = world.table.base_position, np.flatnonzero(guide.h == 0.0)
        away = distances(base, base[start])
        toward = goal.cost.heuristic("consistent", away, 0.0, self.graph.max_step)
        toward = np.maximum(toward, LEAST)
        toward[start] = 0.0
        origins = NodeOrigins(nodes, world.table.masks[nodes], np.zeros(len(nodes)))
        steps = world.table, world.known, weights_of(goal.cost)
        found = cheapest_walk(
            steps, toward, origins, self._labels, SearchParameters(max_expansions=limit, lazy=True),
            until=self.search.until, check=world.masks_after,
        )  # fmt: skip
        self.backward, self._explored = self.backward + found.expanded, 0
        explored = self._labels.expanded[: found.expanded]
        exact = np.full(len(base), np.inf)
        np.minimum.at(exact, self._labels.waiting.node[explored], self._labels.cost[explored])
        closer = np.maximum(guide.h, np.minimum(exact, found.low - toward))
        closer[nodes] = 0.0
        return guide._replace(h=closer)

    def walks(self) -> Iterator[StatePath]:
        """Walks to the goal, each cheaper than the last, as long as more are found."""
        if not len(self._origins.nodes):
            self.low = np.inf
            return
        below = np.inf
        for guide, rounds in self._guides():
            self._look_at(guide)
            for one in rounds:
                walk = self._next(guide, one, below)
                if walk is not None:
                    self.found, below = True, self.cost(walk)
                    yield walk
                if self.low >= below * (1.0 - SAME):
                    return

    def _look_at(self, guide: GoalBounds) -> None:
        """Note what no plan costs less than."""
        if self.search.heuristic == "paper":
            return
        origins = self._origins
        least = float((origins.cost + guide.h[origins.nodes]).min())
        if guide.cost == self.goal.cost or least == np.inf:
            self.low = max(self.low, least)

    def _next(self, guide: GoalBounds, stage: SearchStage, below: float) -> StatePath | None:
        """A walk that costs less than the last; None if a round finds none."""
        most, world, search = below * (1.0 - SAME), self._world, self.search
        parameters = stage.parameters
        if stage.confirms and self._end != NO_LABEL:
            return None
        while time.perf_counter() < search.until and self.low < most:
            limit = min(parameters.max_expansions, search.limit - self.expanded)
            known = self._nothing if stage.admissible and not world.exact else world.known
            found = cheapest_walk(
                (world.table, known, weights_of(guide.cost)), guide.h, self._origins, self._labels,
                parameters._replace(max_expansions=limit), below=most, until=search.until,
                check=world.masks_after,
            )  # fmt: skip
            walk = found.walk
            self._end = found.end if walk is None else PAUSED
            self.expanded, self._explored = self.expanded + found.expanded, found.expanded
            self.generated += self._labels.used
            over = walk is None and found.end == NO_LABEL
            over &= parameters.labels_per_node == CAPACITY
            over &= world.exact or parameters.equal_only or not parameters.lazy
            proves = stage.admissible and (over or parameters.cost_weight == 1.0)
            if proves and search.heuristic != "paper":
                self.low = max(self.low, found.low)
            if walk is None:
                return None
            states: StatePath | None = None
            masks: NDArray[np.uint64] | None = walk.masks
            if not (world.complete or parameters.lazy):
                if world.check_nodes(walk.nodes):
                    self._check_nodes_about(walk.nodes)
                    continue
                world.check(walk.bits)
                masks = self._masks_along(walk)
            if masks is not None:
                begun, turn = self._origin_paths[walk.origin], int(self._turns[walk.origin])
                states = world.walk(begun, turn, walk._replace(masks=masks))
            if states is not None:
                if not self.goal.reached(states.positions[-1], states.states[-1].stance):
                    # It lies beside the goal by less than positions are kept.
                    guide.h[walk.nodes[-1]] = LEAST
                    continue
                return states if self.cost(states) < most else None
            if stage.admissible and not world.exact:
                return None
        return None

    def _check_nodes_about(self, nodes: IntArray) -> None:
        """Look at nodes that were reached about those of a walk which touches something."""
        table, free = self._world.table, self._bounds.table
        reached = self._labels.waiting.node[: self._labels.used].astype(np.int64)
        for node in nodes[table.masks[nodes] != free.masks[nodes]].tolist():
            self._world.check_nodes(reached, ABOUT, table.base_position[node])

    def cost(self, walk: StatePath) -> float:
        """What a walk costs."""
        cost, spent = self.goal.cost, 0.0
        for shift in np.linalg.norm(np.diff(walk.positions, axis=0), axis=1).tolist():
            spent += cost.base_weight * shift + cost.step_weight
        return spent

    def bound(self, cost: float) -> float:
        """Factor of the least cost within which a walk of some cost is proved."""
        if cost <= self.low * (1.0 + SAME):
            return 1.0
        proved = cost / self.low if self.low > 0.0 else math.inf
        return min(proved, self.search.guarantee) if self._world.exact else proved

    def _masks_along(self, walk: NodeWalk) -> NDArray[np.uint64] | None:
        """Branches that limbs may be on along a walk, by what is known of its edges.

        Returns
        -------
        NDArray[np.uint64] | None
            The masks, see `limb_masks`, shape (k + 1,); None if a limb keeps no branch.
        """
        table, limbs = self._world.table, self.graph.limbs
        (before, i), (after, j), _ = edge_ends(table, walk.bits)
        kept = unpacked(self._world.known.of(walk.bits), limbs - 1)
        leaves, grasps = (unpacked(table.released[rows], limbs) for rows in (before, after))
        masks = [unpacked(walk.masks[:1], limbs)[0]]
        for k in range(len(walk.bits)):
            held = np.roll(masks[-1], -i[k] - 1)[:-1] & kept[k]
            if not held.all() or not masks[-1][i[k]] & leaves[k, i[k]]:
                return None
            masks.append(np.roll(np.append(held, grasps[k, j[k]]), j[k] + 1))
        return packed(np.array(masks)) if masks[-1].all() else None

    def tree(self) -> Array:
        """Base positions at both ends of the edges that the last search explored, (e, 2, 3) [m]."""
        labels, base = self._labels, self._world.table.base_position
        explored = labels.expanded[: self._explored]
        link = labels.link[explored]
        after = base[labels.waiting.node[explored]]
        before = after.copy()
        before[link >= 0] = base[labels.waiting.node[link[link >= 0]]]
        for k in np.flatnonzero(link < 0).tolist():
            before[k] = self._origin_paths[-1 - int(link[k])].positions[0]
        ends: Array = np.stack([before, after], axis=1)
        return np.asarray(ends[(link >= 0) | np.any(before != after, axis=1)])
