"""The searches of a planner: compiled for two limbs, batched for more, and Algorithm 1."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.building import finished
from mlivr_gym.planners.estimates import Estimates
from mlivr_gym.planners.found import Improvement
from mlivr_gym.planners.lazy_search import lazy_search
from mlivr_gym.planners.node_bounds import NodeBounds
from mlivr_gym.planners.pair_search import (
    EXHAUSTED,
    FOUND,
    LIMIT,
    NOBODY,
    Expanded,
    Seeds,
    search,
    weights_of,
)
from mlivr_gym.planners.query import Search
from mlivr_gym.planners.roadmap import Roadmap
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_files import node_table
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.stance_sets import key_of
from mlivr_gym.transitions.state import State

PATIENCE, SHARE = 40, 1 / 200
"""States explored before the estimate is brought closer to the truth by a search backward.

So many, or this share of the stances where that is more; four times as many each time.
"""

CHEAP = 10
"""Times as many where steps are not checked for collisions: such a check takes a tenth as long."""

LEARNING = 8
"""Entries taken from the queue of the backward search for each state explored until then.

Most need no new step checked.
"""


@dataclass(frozen=True)
class Path:
    """What a search found.

    Attributes:
        status: `FOUND`, `EXHAUSTED` or `LIMIT` of `pair_search`.
        states: States from the start to the last one explored, the goal if it was found.
        cost: Cost of the path to it.
        expanded: States expanded.
        generated: States generated.
        tree: Base positions at both ends of each explored step, shape (e, 2, 3) [m].
        backward: Stances that searches backward have expanded for the heuristic.
        bound: Factor of the least cost within which the path is proved; infinite if within none.
        improvements: The plans found one after the other, each better than the last.
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


class Searcher(Protocol):
    """A search over one stance graph."""

    def find(self, search: Search, first: State) -> Path | None:
        """Search from a state; None if the goal is not connected with it."""


class PairSearcher:
    """The compiled search of two limbs."""

    def __init__(self, graph: PairGraph, estimates: Estimates) -> None:
        """Search `graph` with the help of `estimates`."""
        self.graph, self.estimates = graph, estimates

    def find(self, search: Search, first: State) -> Path | None:
        """See `Searcher.find`."""
        graph, goal = self.graph, search.goal
        origin = graph.posture_of(first)
        seeds = _Seeds(graph, first, origin, search)
        arrived = bool(goal.reached(origin.base_position[0], first.stance))
        if seeds.given and (arrived or not len(seeds.all.stance)):
            status = FOUND if arrived else EXHAUSTED
            return Path(status, (first,), 0.0, 1, 1, np.zeros((0, 2, 3)), bound=1.0)
        region, known = self.estimates.region(goal), self.estimates.expanded
        if not set(graph.components[1][seeds.all.stance].tolist()) & region.parts:
            return None
        status, out, explored, generated = self._search(search, seeds, origin)
        stance, moved, mask, parent, g = out
        backward, chain = self.estimates.expanded - known, _chain(parent)
        states = tuple(self._state(int(stance[k]), int(moved[k]), int(mask[k])) for k in chain)
        before = np.where(
            parent[:, None] >= 0, graph.base_in_world[stance[parent]], origin.base_position[0]
        )
        tree = np.stack([before, graph.base_in_world[stance]], axis=1)
        if not seeds.given:
            counts, tree = (explored, generated), tree[1:]
        else:
            counts, states = (explored + 1, generated + 1), (first, *states)
        cost, bound = float(g[-1]), search.guarantee
        return Path(int(status), states, cost, *counts, tree, backward, bound)

    def _search(
        self, search_: Search, seeds: _Seeds, origin: Postures
    ) -> tuple[int, Expanded, int, int]:
        """Search, and learn from the goal where the estimate misleads; counts of all rounds."""
        graph, goal, estimates = self.graph, search_.goal, self.estimates
        cost, region = goal.cost, estimates.region(goal)
        tables = search_.heuristic == "cost_to_go"
        if tables:
            h = estimates.table(goal, seeds.start)
        else:
            h = search_.estimate(region.distance, graph.max_step)
        patience = search_.limit
        if tables and graph.settings.transitions:
            patience = max(PATIENCE, int(SHARE * len(graph)))
            patience *= 1 if graph.settings.collisions else CHEAP
        bound, explored, generated = h, 0, 0
        while True:
            weights = weights_of(cost, search_.g_weight, min(search_.limit - explored, patience))
            status, made, out = search(graph, seeds.all, region.goal, h, weights)
            explored, generated = explored + len(out.stance), generated + made
            if status != LIMIT or explored >= search_.limit:
                return status, out, explored, generated
            # Many steps that the estimate counts on are no edges: learn from the goal.
            # From some branches of a stance the way may be longer than from all.
            h, bound = estimates.learn(
                goal,
                -1 if seeds.given else seeds.start,
                origin.base_position[0],
                bound,
                LEARNING * patience,
            )
            estimates.keep(goal, bound)
            patience *= 4

    def _state(self, s: int, moved: int, mask: int) -> State:
        """A state as the search has it: stance, limb that moved last (2 if none), other's mask."""
        graph = self.graph
        masks = graph.mask[s].tolist()
        if moved < 2:
            masks[1 - moved] = mask
            if graph.settings.transitions:
                masks[moved] = int(graph.releasable[s, moved])
        a, b = graph.points[s].tolist()
        return State((a, b), (masks[0], masks[1]))


class _Seeds:
    """Where a search of two limbs begins.

    Attributes:
        start: Index of the start stance, -1 if the robot stands in a given pose.
        all: The seeds.
        given: Whether the pose or the branches at the start are given: the seeds are then the
            stances that a first step leads to.
    """

    def __init__(self, graph: PairGraph, first: State, origin: Postures, search: Search) -> None:
        self.start = graph.find(first.stance) if first.pose is None else -1
        self.given = self.start < 0 or first.masks != tuple(graph.mask[self.start].tolist())
        if not self.given:
            self.all = _seeds([(self.start, NOBODY, 0)], np.zeros(1))
            return
        cost, steps = search.goal.cost, graph.successors(first)
        rows = []
        for k, limb in enumerate(steps.limb.tolist()):
            after = steps.after(first, k)
            rows.append((graph.find(after.stance), limb, after.masks[1 - limb]))
        away = [float(np.linalg.norm(p - origin.base_position[0])) for p in steps.base_in_world]
        costs = np.array([cost.base_weight * d + cost.step_weight for d in away])
        self.all = _seeds(rows, costs)


def _seeds(rows: Sequence[tuple[int, int, int]], costs: Array) -> Seeds:
    """Seeds of stance, limb that moved there and branches of the other limb."""
    stance, moved, mask = np.array(rows, dtype=np.int64).reshape(-1, 3).T.copy()
    return Seeds(stance, moved, mask, costs)


class LazySearcher:
    """The search of any number of limbs."""

    def __init__(self, graph: LazyGraph, *, work_out: bool = True) -> None:
        """Search `graph`.

        Args:
            graph: The stance graph.
            work_out: Whether its sets of points are worked out first where they are not known.
        """
        self.graph, self.work_out = graph, work_out
        self._bounds: NodeBounds | None = None

    def _ready(self, search: Search) -> bool:
        """Whether what is worked out once for the graph is there before the time is over."""
        graph, key = self.graph, key_of(self.graph)
        if search.guided:
            if not finished(("nodes", key), lambda: node_table(graph), search.until):
                return False
            node_table(graph)
        if graph.table is not None and not graph.obstacles:
            return True
        work_out = self.work_out
        return finished(("sets", key), lambda: graph.sets(work_out=work_out), search.until)

    def _node_bounds(self) -> NodeBounds | None:
        """What is left over all nodes; None where these are not known, or there are obstacles."""
        table = None if self.graph.obstacles else self.graph.table
        if table is None:
            return None
        self._bounds = self._bounds or NodeBounds(self.graph, table)
        return self._bounds

    def find(self, search: Search, first: State) -> Path | None:
        """See `Searcher.find`."""
        if not self._ready(search):
            return Path(LIMIT, (first,), 0.0, 0, 0, np.zeros((0, 2, 3)))
        bounds = self._node_bounds() if search.guided else None
        roadmap = Roadmap.of(self.graph) if search.guided and bounds is None else None
        found = lazy_search(self.graph, first, search, roadmap, bounds)
        if not found.states:  # no moves lead to the goal, whatever steps there are
            return None
        position = np.concatenate([p.base_position for p in found.postures])
        states = tuple(found.states[k] for k in _chain(np.array(found.parents), found.goal))
        counts, tree = (len(found.states), found.generated), _tree(position, found.parents)
        return Path(
            found.status, states, found.costs[found.goal], *counts, tree,
            bound=found.bound, improvements=tuple(found.improvements),
        )  # fmt: skip


class Algorithm1Searcher:
    """Algorithm 1 in plain Python."""

    def __init__(self, graph: StanceGraph) -> None:
        """Search `graph`."""
        self.graph = graph

    def find(self, search: Search, first: State) -> Path | None:
        """See `Searcher.find`."""
        goal = search.goal
        found = algorithm1(
            self.graph,
            first,
            goal,
            search.heuristic,
            inflation=search.inflation,
            limit=search.limit,
            progress=search.progress,
        )
        states = tuple(found.states[k] for k in _chain(np.array(found.parents)))
        tree = _tree(np.array(found.positions), found.parents)
        counts = len(found.states), found.generated
        return Path(found.status, states, found.costs[-1], *counts, tree, bound=search.guarantee)


def _tree(position: Array, parents: Sequence[int]) -> Array:
    """Base positions at both ends of each explored step, shape (e, 2, 3) [m]."""
    above = np.array(parents[1:], dtype=np.int64)
    return np.stack([position[above], position[1:]], axis=1)


def _chain(parent: IntArray, last: int = -1) -> list[int]:
    """Indices from the first to the last entry, or to another one, along the parents."""
    chain = [last % len(parent)]
    while parent[chain[-1]] >= 0:
        chain.append(int(parent[chain[-1]]))
    return chain[::-1]
