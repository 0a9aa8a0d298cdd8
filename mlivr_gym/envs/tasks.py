"""Random start and goal pairs that the stance graph joins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.errors import StanceError
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph, State

Array = NDArray[np.float64]

WALK = 12
"""Most steps of the walk that leads from the start to the goal."""

TRIES = 200
"""Draws after which sampling gives up."""


def random_state(graph: PairGraph | LazyGraph, rng: np.random.Generator) -> State:
    """A random stance that at least one step leaves.

    Raises:
        StanceError: If none is found.
    """
    for _ in range(TRIES):
        if isinstance(graph, PairGraph):
            try:
                state = graph.state(graph.points[int(rng.integers(len(graph)))].tolist())
            except StanceError:
                continue
        else:
            drawn = _draw(graph, rng)
            if drawn is None:
                continue
            state = drawn
        if len(graph.successors(state).limb):
            return state
    raise StanceError(
        f"no stance that a step leaves was found on map {graph.grasp_map.name!r} in {TRIES} draws"
    )


def _draw(graph: LazyGraph, rng: np.random.Generator) -> State | None:
    """One of a batch of stances round a random point that can be held."""
    first = int(rng.integers(len(graph.grasp_map)))
    near = graph.partners(first)
    if len(near) < graph.limbs:
        return None
    rows = []
    for _ in range(64):
        rest = rng.choice(near, graph.limbs - 1, replace=False)
        if all(b in graph.partners(int(a)) for i, a in enumerate(rest) for b in rest[i + 1 :]):
            rows.append((first, *rest.tolist()))
    if not rows:
        return None
    stances = np.array(rows, dtype=np.int64)
    postures = graph.postures(stances)
    nodes = np.flatnonzero(graph.is_node(postures))
    if not len(nodes):
        return None
    try:
        return graph.state(stances[nodes[0]].tolist())
    except StanceError:
        return None


def sample_task(
    graph: PairGraph | LazyGraph,
    rng: np.random.Generator,
    tolerance: float,
    start: State | None = None,
) -> tuple[State, Array]:
    """A start and a goal that a walk of possible steps joins.

    From the start the robot walks towards a random graspable point, at most `WALK` steps, each to
    the stance whose base is nearest to that point; where it ends is the goal.

    Args:
        graph: The stance graph.
        rng: Source of randomness.
        tolerance: Goals nearer to the start than this are drawn again [m].
        start: The start, if it is given.

    Returns:
        Start state and goal position [m], shape (3,).

    Raises:
        StanceError: If no pair is found.
    """
    for _ in range(TRIES):
        state = random_state(graph, rng) if start is None else start
        target = graph.grasp_map.positions[int(rng.integers(len(graph.grasp_map)))]
        origin = _base(graph, state)
        position = _walk(graph, state, origin, target)
        inside = (position >= graph.grasp_map.cabin[0]).all() and (
            position <= graph.grasp_map.cabin[1]
        ).all()
        if inside and np.linalg.norm(position - origin) > tolerance:
            return state, position
    raise StanceError(
        f"no goal that can be reached was found on map {graph.grasp_map.name!r} in {TRIES} draws"
    )


def _base(graph: StanceGraph, state: State) -> Array:
    position: Array = graph.posture_of(state).position[0]
    return position


def _walk(graph: PairGraph | LazyGraph, state: State, origin: Array, target: Array) -> Array:
    best, position = float(np.linalg.norm(origin - target)), origin
    for _ in range(WALK):
        steps = graph.successors(state)
        if not len(steps.limb):
            break
        distance = np.linalg.norm(steps.position - target, axis=1)
        k = int(np.argmin(distance))
        if distance[k] >= best:
            break
        best, position = float(distance[k]), steps.position[k]
        stance = list(state.stance)
        stance[steps.limb[k]] = int(steps.point[k])
        state = State(tuple(stance), tuple(steps.masks[k].tolist()))
    return position
