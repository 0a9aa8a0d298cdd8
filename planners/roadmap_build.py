"""Build a roadmap: explore the stance graph, then check every step between what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.planners.roadmap import Pairs, Roadmap, RoadmapError, codes, one_limb_apart
from mlivr_gym.planners.roadmap_use import most_used, use_of
from mlivr_gym.planners.step_odds import features, fitted
from mlivr_gym.postures.postures import Postures
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.stances.stance_sets import key_of
from mlivr_gym.stances.workers import Progress, Workers, tell
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import GraspMap

EXPLORATIONS = 2
"""Explorations whose stances are put together; each has its own seed and process."""

CELL = 0.2
"""Edge of the cells of base positions, of which the one least explored comes next [m]."""

TRIED = 160
"""Most neighbours of a stance that are tried."""

FORGET = 4000
"""Expansions after which the graph forgets what it remembers, which takes memory."""

ANEW = 1500
"""Expansions after which an exploration begins at one more random stance."""

OBSERVED = 100
"""Expansions from whose candidates the odds of a step are fitted."""

AT_ONCE = 512
"""Steps that are checked at once."""

MOST_LIMBS = 4
"""Most limbs of a robot with a roadmap: the numbers of stances have 64 bits."""

CHUNK = 4096
"""Stances whose postures are worked out at once."""

MOST, SPARE = 100_000, 1.5
"""Stances that are kept, and how many times as many are taken before steps are checked."""

STAGES = 5
"""Explore, see what serves, check steps, see what serves, and work out what can be released."""

World = tuple[GraspMap, RobotSpec, Settings]
"""What a graph is made of."""


def build(
    graph: LazyGraph, expansions: int, most: int = MOST, progress: Progress | None = None
) -> Roadmap:
    """Explore the graph and join what is found, in a process for each exploration.

    Args:
        graph: The stance graph, without obstacles and occupied points.
        expansions: Stances whose neighbours are worked out; the more, the shorter are walks over
            the roadmap, and the more starts can be joined to it.
        most: Most stances that are kept.
        progress: Called now and then with the share of the work that is done.

    Raises:
        RoadmapError: If the robot has more than four limbs, steps are not checked, or there are
            obstacles or occupied points.
    """
    if graph.limbs > MOST_LIMBS or not graph.settings.transitions:
        raise RoadmapError(
            f"robot {graph.robot.name!r} has {graph.limbs} limbs, and steps are"
            f"{'' if graph.settings.transitions else ' not'} checked: a roadmap is for at most "
            f"{MOST_LIMBS} limbs and steps that are checked"
        )
    if graph.obstacles or graph.occupied:
        raise RoadmapError("a roadmap is built without obstacles and occupied points")
    world = graph.grasp_map, graph.robot, graph.settings
    graph.sets()  # once for all processes
    with Workers(EXPLORATIONS, STAGES, progress) as workers:
        each = max(expansions // EXPLORATIONS, 1)
        found = workers.run(_explored, [(world, each)] * EXPLORATIONS)
        points, base = _distinct([one[:2] for one in found])
        odds = fitted(*(np.concatenate([one[k] for one in found]) for k in (2, 3)))
        return _joined(graph, _Found(points, base, odds), most, workers)


class _Found(NamedTuple):
    """What was explored."""

    points: IntArray
    """Stances in the order of their codes, shape (n, N)."""
    base: Array
    """Their base positions [m], shape (n, 3)."""
    odds: Array
    """Weights of `step_odds.features`."""


def _joined(graph: LazyGraph, found: _Found, most: int, workers: Workers) -> Roadmap:
    """A roadmap of the stances that serve most of those that were found.

    Most pairs of them are steps, so that what serves least is found without a check of each.
    """
    world, (points, base, odds) = (graph.grasp_map, graph.robot, graph.settings), found
    chosen = _serving(one_limb_apart(points), base, int(SPARE * most), workers)
    points, base = points[chosen], base[chosen]
    pairs = one_limb_apart(points)
    cuts = [len(pairs.rows) * k // EXPLORATIONS for k in range(EXPLORATIONS + 1)]
    parts = [pairs.take(slice(a, b)) for a, b in pairwise(cuts)]
    kept = np.concatenate(workers.run(_steps, [(world, points, part) for part in parts]))
    able = kept.all(axis=1)
    pairs, kept = pairs.take(able), kept[able]
    chosen = _serving(pairs, base, most, workers)
    within = chosen[pairs.rows].all(axis=1)
    points, kept = points[chosen], kept[within]
    pairs = Pairs((np.cumsum(chosen) - 1)[pairs.rows[within]], pairs.limbs[within])
    kept[np.arange(len(kept)), pairs.limbs[:, 0]] = 0
    known = workers.run(_known, [(world, part) for part in np.array_split(points, EXPLORATIONS)])
    position, released = (np.concatenate([one[k] for one in known]) for k in (0, 1))
    return Roadmap(key_of(graph), points, position, released, pairs, kept, odds)


def _serving(pairs: Pairs, base: Array, most: int, workers: Workers) -> BoolArray:
    """The stances that serve most, by either cost; all if there are no more than that."""
    if len(base) <= most:
        workers.skip()
        return np.ones(len(base), dtype=np.bool_)
    given = [(pairs.rows, base, cost) for cost in ("steps", "base")]
    use: Array = np.sum(workers.run(_used, given), axis=0)
    return most_used(use, most)


def _distinct(found: Sequence[tuple[Any, ...]]) -> tuple[IntArray, Array]:
    """Stances and base positions of all explorations, each stance once, in order."""
    points, base = (np.concatenate([one[k] for one in found]) for k in (0, 1))
    _, index = np.unique(codes(points), return_index=True)
    return points[index], base[index]


def _explored(worker: int, world: World, expansions: int) -> tuple[Any, ...]:
    """Stances of an exploration, base positions, candidates of first steps and what these were."""
    found = _Exploration(_graph(world), np.random.default_rng(worker))
    for count in range(expansions):
        found.expand(count)
        if count % FORGET == FORGET - 1:
            found.graph = _graph(world)  # what it remembers takes memory
        tell(worker, (count + 1) / expansions)
    rows, steps = np.concatenate(found.candidates), np.concatenate(found.outcomes)
    base = np.concatenate([posture.base_position for _, posture in found.states])
    return np.array(found.stances, dtype=np.int64), base, rows, steps


def _used(worker: int, pairs: IntArray, base: Array, cost: str) -> Array:
    """How much each stance serves by a cost, shape (n,)."""

    def progress(share: float) -> None:
        tell(worker, share)

    return use_of(pairs, base, cost, progress)


def _steps(worker: int, world: World, points: IntArray, pairs: Pairs) -> IntArray:
    """Masks after steps that may leave all branches; 0 where there is no step, shape (p, N)."""
    graph, used = _graph(world), np.unique(pairs.rows)
    postures, row = _postures(graph, points[used]), np.zeros(len(points), dtype=np.int64)
    row[used] = np.arange(len(used))
    count = len(pairs.rows)
    kept: IntArray = np.zeros((count, graph.limbs), dtype=np.int64)
    for at in range(0, count, AT_ONCE):
        if at % (64 * AT_ONCE) == 0:
            graph = _graph(world)
        some = pairs.take(slice(at, at + AT_ONCE))
        first, before = np.unique(some.rows[:, 0], return_inverse=True)
        here = postures.take(row[first])
        after = postures.take(row[some.rows[:, 1]]).turned(-some.turns)
        states = [
            State(tuple(stance), tuple(mask))
            for stance, mask in zip(points[first].tolist(), here.mask.tolist(), strict=True)
        ]
        stances = some.stances_after(points)
        kept[at : at + AT_ONCE] = graph.masks_after(states, here, before, stances, after)
        tell(worker, (at + len(stances)) / count)
    return kept


def _known(worker: int, world: World, points: IntArray) -> tuple[Array, IntArray]:
    """Base positions of stances [m], and masks on which their limbs can be released."""
    graph = _graph(world)
    postures = _postures(graph, points)
    released: IntArray = np.zeros(points.shape, dtype=np.int64)
    for at in range(0, len(points), AT_ONCE):
        rows = np.arange(at, min(at + AT_ONCE, len(points)))
        released[rows] = graph.all_released(points[rows], postures.take(rows))["branches"]
        tell(worker, (at + len(rows)) / len(points))
    return postures.base_position, released


@dataclass
class _Exploration:
    """States found from random ones, the cell that was expanded least next."""

    graph: LazyGraph
    rng: np.random.Generator
    stances: list[tuple[int, ...]] = field(default_factory=list)
    states: list[tuple[State, Postures]] = field(default_factory=list)
    known: set[tuple[int, ...]] = field(default_factory=set)
    cells: dict[tuple[int, ...], tuple[list[int], list[int]]] = field(default_factory=dict)
    """How often each was expanded, and which of its states were not yet."""
    candidates: list[Array] = field(default_factory=list)
    outcomes: list[BoolArray] = field(default_factory=list)

    def expand(self, count: int) -> None:
        """Expand one state; now and then begin at one more random stance."""
        graph, rng = self.graph, self.rng
        if count % ANEW == 0:
            start = random_state(graph, rng)
            self.add(start, graph.posture_of(start))
        waiting = [cell for cell in self.cells.values() if cell[1]]
        if not waiting:
            return
        cell = min(waiting, key=lambda one: one[0][0] + rng.random() * 0.5)
        cell[0][0] += 1
        state, posture = self.states[cell[1].pop(int(rng.integers(len(cell[1]))))]
        stances = graph.neighbours(state, posture)
        stances = stances[rng.permutation(len(stances))[:TRIED]]
        postures = graph.nodes(stances)
        nodes, steps = np.flatnonzero(graph.is_node(postures)), np.zeros(len(stances), np.bool_)
        before, after = np.zeros(len(nodes), dtype=np.int64), postures.take(nodes)
        masks = graph.masks_after([state], posture, before, stances[nodes], after)
        for k, mask in zip(nodes.tolist(), masks, strict=True):
            steps[k] = mask.all()
            if steps[k]:
                stance = tuple(stances[k].tolist())
                self.add(State(stance, tuple(mask.tolist())), postures.take(np.array([k])))
        if count < OBSERVED and len(stances):
            self.candidates.append(features(graph, state.stance, posture, stances))
            self.outcomes.append(steps)

    def add(self, state: State, posture: Postures) -> None:
        """Note a state, unless its stance is known, the robot turned as it may be."""
        first = state.stance.index(min(state.stance))
        stance = state.stance[first:] + state.stance[:first]
        if stance in self.known:
            return
        self.known.add(stance)
        self.stances.append(stance)
        where = tuple(np.floor(posture.base_position[0] / CELL).astype(int).tolist())
        self.cells.setdefault(where, ([0], []))[1].append(len(self.states))
        self.states.append((state, posture))


def _graph(world: World) -> LazyGraph:
    """A graph that knows nothing yet."""
    grasp_map, robot, settings = world
    graph = stance_graph(grasp_map, robot, settings)
    assert isinstance(graph, LazyGraph)
    graph.sets()  # what is drawn among neighbours depends on them
    return graph


def _postures(graph: LazyGraph, points: IntArray) -> Postures:
    """Postures of many stances."""
    every = range(0, len(points) + CHUNK, CHUNK)
    return join(*(graph.nodes(points[a:b]) for a, b in pairwise(every)))
