"""The first walk of a query of many limbs: its start is joined to a roadmap that leads to the goal.

States are expanded from the start, those in the cells of base positions that were expanded least
first; of the neighbours of each the stances of the roadmap are tried, and those that are most
likely steps. From the states that are on the roadmap the cheapest walk to the goal is looked for
there, and its steps are checked on the graph; one that is no step now is taken out.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
import scipy

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.planners.label_search import Origins, RoadmapWalk, cheapest_walk
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.roadmap import Roadmap
from mlivr_gym.planners.step_odds import features
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.turns import lowest_first, turned
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.transitions.state import State

CELL = 0.15
"""Edge of the cells of base positions [m]."""

TRIED = 24
"""Most neighbours tried of those on the roadmap, and of the most likely ones."""

FACTORS = (1.1, 1.5, 3.0)
"""Weights of what is left in the search over the roadmap."""

LEAST_COST = 1e-9
"""Added to the cost of a step, so that what is left is 0 at the goal alone."""

At = tuple[State, Postures]


@dataclass
class _Reached:
    """A state that the start leads to."""

    state: State
    posture: Postures
    parent: int
    cost: float
    row: int
    """Its row on the roadmap, -1 if it is not there or nothing leads on."""


@dataclass
class Joining:
    """The search for a first walk.

    Attributes:
        graph: The stance graph.
        roadmap: A roadmap of it.
        goal: Where to go.
        until: When to give up, on the clock of `time.perf_counter`.
        most: Most states that are expanded.
        reached: What the start leads to.
        expanded: States expanded.
    """

    graph: LazyGraph
    roadmap: Roadmap
    goal: Goal
    until: float
    most: int
    reached: list[_Reached] = field(default_factory=list)
    expanded: int = 0

    def __post_init__(self) -> None:
        """Work out what leads to the goal on the roadmap."""
        roadmap, cost, roads = self.roadmap, self.goal.cost, self.roadmap.roads
        self._cost: Array = np.full(len(roads.other), cost.step_weight + LEAST_COST)
        if cost.base_weight:
            source = np.repeat(np.arange(len(roadmap)), np.diff(roads.start))
            away = roadmap.base_position[roads.other] - roadmap.base_position[source]
            shift = np.sqrt(np.einsum("ij,ij->i", away, away))
            self._cost = cost.base_weight * shift + cost.step_weight + LEAST_COST
        if self.graph.occupied:
            taken = np.isin(roadmap.points, list(self.graph.occupied))
            held = np.asarray(taken.any(axis=1))
            self._cost[held[roads.other]] = np.inf
        reached = self.goal.reached(roadmap.base_position, roadmap.points)
        self._goals: IntArray = np.flatnonzero(reached)
        self._to_goal = self._costs_to_goal()
        self._cells: dict[tuple[int, ...], tuple[list[int], list[int]]] = {}
        self._seen: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
        self._rng = np.random.default_rng(0)

    def _costs_to_goal(self) -> Array:
        """Lower bounds of the cost to the goal over the roadmap, shape (n,)."""
        if not len(self._goals):
            return np.full(len(self.roadmap), np.inf)
        roads, shape = self.roadmap.roads, (len(self.roadmap),) * 2
        matrix = scipy.sparse.csr_array((self._cost, roads.other, roads.start), shape=shape)
        costs: Array = scipy.sparse.csgraph.dijkstra(matrix, indices=self._goals, min_only=True)
        return costs

    def walk(self, start: State) -> list[At] | None:
        """States from the start to the goal with their postures; None if none is found."""
        if not np.isfinite(self._to_goal).any():
            return None
        posture = self.graph.posture_of(start)
        row = int(self.roadmap.find(np.array([start.stance]))[0]) if start.pose is None else -1
        self._add(start, posture, -1, 0.0, row)
        tried = 0
        while time.perf_counter() < self.until and self.expanded < self.most:
            last = self.reached[-1]
            if self.goal.reached(last.posture.base_position[0], last.state.stance):
                return self._chain(len(self.reached) - 1)
            joined = [k for k, one in enumerate(self.reached) if one.row >= 0]
            if len(joined) > tried:
                found = self._over_roadmap(joined)
                if found is not None:
                    return found
                tried = len(joined) + len(joined) // 2
            if not self._expand():
                return None
        return None

    def _add(self, state: State, posture: Postures, parent: int, cost: float, row: int) -> None:
        """Note a state, unless it was reached on these branches."""
        seen = self._seen.setdefault(state.stance, [])
        if any(_covers(old, state.masks) for old in seen):
            return
        seen.append(state.masks)
        cell = tuple(np.floor(posture.base_position[0] / CELL).astype(int).tolist())
        self._cells.setdefault(cell, ([0], []))[1].append(len(self.reached))
        row = row if row >= 0 and np.isfinite(self._to_goal[row]) else -1
        self.reached.append(_Reached(state, posture, parent, cost, row))

    def _expand(self) -> bool:
        """Expand one state; False if there is none."""
        waiting = [cell for cell in self._cells.values() if cell[1]]
        if not waiting:
            return False
        times, members = min(waiting, key=lambda cell: cell[0][0])
        times[0] += 1
        self.expanded += 1
        here = members.pop(int(self._rng.integers(len(members))))
        one, graph = self.reached[here], self.graph
        stances = graph.neighbours(one.state, one.posture)
        if not len(stances):
            return True
        rows = self.roadmap.find(stances)
        to_goal = np.where(rows >= 0, self._to_goal[rows], np.inf)
        odds = features(graph, one.state.stance, one.posture, stances) @ self.roadmap.odds
        best = np.argsort(to_goal, kind="stable")[: min(TRIED, int(np.isfinite(to_goal).sum()))]
        likely = np.argsort(-odds, kind="stable")[:TRIED]
        some = np.concatenate([best, np.setdiff1d(likely, best)])
        postures = graph.nodes(stances[some])
        nodes = np.flatnonzero(graph.is_node(postures))
        some, postures = some[nodes], postures.take(nodes)
        before = np.zeros(len(some), dtype=np.int64)
        masks = graph.masks_after([one.state], one.posture, before, stances[some], postures)
        for k in np.flatnonzero(masks.all(axis=1)).tolist():
            state = State(tuple(stances[some[k]].tolist()), tuple(masks[k].tolist()))
            posture = postures.take(np.array([k]))
            cost = one.cost + self._step_cost(one.posture, posture)
            self._add(state, posture, here, cost, int(rows[some[k]]))
            if self.goal.reached(posture.base_position[0], state.stance):
                return True
        return True

    def _step_cost(self, before: Postures, after: Postures) -> float:
        """Cost of a step."""
        shift = float(np.linalg.norm(after.base_position[0] - before.base_position[0]))
        return self.goal.cost.base_weight * shift + self.goal.cost.step_weight

    def _over_roadmap(self, joined: list[int]) -> list[At] | None:
        """A walk over the roadmap from any state that is there, every step checked."""
        some = [self.reached[k] for k in joined]
        turns = lowest_first(np.array([one.state.stance for one in some]))
        masks = np.array([one.state.masks for one in some], dtype=np.int64)
        origins = Origins(
            np.array([one.row for one in some]),
            turned(masks, turns),
            np.array([one.cost for one in some]),
        )
        while time.perf_counter() < self.until:
            walk = cheapest_walk(self.roadmap.roads, self._cost, self._to_goal, origins, FACTORS)
            if walk is None:
                return None
            begun = self._chain(joined[walk.origin])
            rest = self._checked(begun[-1], walk, int(turns[walk.origin]))
            if rest is None:
                continue
            states = begun + rest
            if self.goal.reached(states[-1][1].base_position[0], states[-1][0].stance):
                return states
            # Obstacles may have moved the base of the last stance away from the goal.
            self._goals = self._goals[self._goals != walk.stances[-1]]
            self._to_goal = self._costs_to_goal()
        return None

    def _checked(self, first: At, walk: RoadmapWalk, turn: int) -> list[At] | None:
        """The states of a walk after the first; None if a step is none now, which is taken out.

        Args:
            first: Where it begins.
            walk: The walk over stances of the roadmap.
            turn: The turn after which the first of them is that where it begins.
        """
        if not walk.steps:
            return []
        back = -np.cumsum([turn, *self.roadmap.roads.turn[walk.steps].tolist()])
        stances = turned(self.roadmap.points[walk.stances], back)
        masks = turned(walk.masks, back)
        after, count = self.graph.nodes(stances[1:]), len(walk.steps)
        nodes = self.graph.is_node(after)
        found = after.mask
        if nodes.all():
            found = masks_along(self.graph, stances, masks, join(first[1], after))
        bad = np.flatnonzero(~found.all(axis=1))
        for k in bad.tolist():
            self._take_out(walk.steps[k], node=bool(nodes[k]))
        if len(bad):
            return None
        return [
            (State(tuple(s), tuple(m)), after.take(np.array([k])))
            for k, s, m in zip(range(count), stances[1:].tolist(), masks[1:].tolist(), strict=True)
        ]

    def _take_out(self, step: int, *, node: bool) -> None:
        """Take a step out of the roadmap, or all steps to its stance if that is no node now."""
        other = self.roadmap.roads.other
        self._cost[step if node else other == other[step]] = np.inf

    def _chain(self, last: int) -> list[At]:
        """States from the start to one that was reached."""
        chain = [last]
        while self.reached[chain[-1]].parent >= 0:
            chain.append(self.reached[chain[-1]].parent)
        return [(self.reached[k].state, self.reached[k].posture) for k in reversed(chain)]


def masks_along(
    graph: LazyGraph, stances: IntArray, masks: IntArray, postures: Postures
) -> IntArray:
    """Masks after the steps of a walk, 0 where there is no step, shape (k, N).

    Where they are others than a roadmap tells, which may be one of the robot after a turn, the
    steps from there on are checked anew.

    Args:
        graph: The stance graph.
        stances: The k + 1 stances.
        masks: The masks there that the roadmap tells; those found take their place.
        postures: Their postures.
    """
    begin, count = 0, len(stances) - 1
    found = np.zeros_like(masks[1:])
    while begin < count:
        rows = np.arange(begin, count)
        states = [
            State(tuple(s), tuple(m))
            for s, m in zip(stances[rows].tolist(), masks[rows].tolist(), strict=True)
        ]
        found[begin:] = graph.masks_after(
            states, postures.take(rows), np.arange(len(rows)), stances[rows + 1],
            postures.take(rows + 1),
        )  # fmt: skip
        other = np.flatnonzero((found[begin:] != masks[begin + 1 :]).any(axis=1))
        if not len(other) or not found[begin:].all():
            break
        begin += int(other[0]) + 1
        masks[begin] = found[begin - 1]
    return found


def _covers(old: tuple[int, ...], new: tuple[int, ...]) -> bool:
    return all(b & ~a == 0 for a, b in zip(old, new, strict=True))
