"""Random stances, and random states that a step leaves."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.errors import StanceError
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.values import MIN_SIZE
from mlivr_gym.world.grasp_map import GraspMap

TRIES = 200
"""Number of draws after which sampling ends."""

LIMBS_AS_DRAWN = 4
"""Largest number of limbs that hold points in the order of the draw, see `order_around_body`."""


class Randomness(Protocol):
    """A source of random numbers: a `numpy.random.Generator`, or a `Stream`."""

    def integers(self, low: int, /) -> Any:
        """Return a whole number from 0 to `low` - 1."""

    def choice(self, a: Any, size: int, /, *, replace: bool) -> Any:
        """Return `size` of the values `a`, all different if not `replace`."""


def random_state(graph: StanceGraph, rng: Randomness) -> State:
    """Return a random stance that a step leaves, as a state; `StanceError` after `TRIES`."""
    for _ in range(TRIES):
        state = random_stance(graph, rng)
        if state is not None and graph.successors(state):
            return state
    raise StanceError(
        f"no stance that a step leaves was found on map {graph.grasp_map.name!r} in {TRIES} draws"
    )


def random_stance(graph: StanceGraph, rng: Randomness) -> State | None:
    """Return the state of a random stance, or None if the stance that was drawn cannot be held.

    It is drawn from all stances or, if these are not known, from a batch around a random point.
    """
    if graph.lists_all:
        stance = graph.points[int(rng.integers(len(graph)))].tolist()
    else:
        first = int(rng.integers(len(graph.grasp_map)))
        close = graph.partners(first)
        if len(close) < graph.limbs:
            return None
        rows = []
        for _ in range(64):
            rest = rng.choice(close, graph.limbs - 1, replace=False)
            if all(b in graph.partners(int(a)) for i, a in enumerate(rest) for b in rest[i + 1 :]):
                rows.append((first, *rest.tolist()))
        if not rows:
            return None
        stances = np.array(rows, dtype=np.int64)
        if graph.limbs > LIMBS_AS_DRAWN:
            stances = order_around_body(graph.grasp_map, stances)
        nodes = np.flatnonzero(graph.is_node(graph.nodes(stances)))
        if not len(nodes):
            return None
        stance = stances[nodes[0]].tolist()
    try:
        return graph.state(stance)
    except StanceError:
        return None


def order_around_body(grasp_map: GraspMap, stances: IntArray) -> IntArray:
    """Return stances whose points are in the order of the mounts, shape (k, N) -> (k, N).

    Limbs seldom reach N points in another of the N! orders than the 2N around the body, which for
    five points are one in ten and for six one in sixty. Limb 0 keeps its point; the others run
    around the centroid in the direction in which the point of limb 1 comes before that of limb 2.
    """
    points, normals = grasp_map.positions[stances], grasp_map.normals[stances]
    away = points - points.mean(axis=1, keepdims=True)
    out = normals.mean(axis=1)
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), MIN_SIZE)
    aside = np.cross(out, away[:, 0])
    ahead = np.cross(aside, out)
    x, y = (np.einsum("kni,ki->kn", away, axis) for axis in (ahead, aside))
    azimuths = np.arctan2(y, x) % (2.0 * np.pi)
    azimuths[azimuths[:, 1] > azimuths[:, 2]] *= -1.0
    azimuths[:, 0] = -np.inf
    ordered: IntArray = np.take_along_axis(stances, azimuths.argsort(axis=1), axis=1)
    return ordered
