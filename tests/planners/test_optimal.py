"""Plans and costs-to-go against SciPy's Dijkstra over all states of `successors`."""

from types import FunctionType
from typing import NamedTuple

import numpy as np
import pytest
from paper import NO_COLLISIONS
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from mlivr_gym import Box, Settings, State, stance_graph
from mlivr_gym.planners import Planner, SearchOptions, table_search
from mlivr_gym.planners.costs import Cost


def prices(stances, points):
    """A user's prices: of points by their numbers, and of stances whose points lie far apart."""
    return 0.02 * (points * 7 % 11) + 0.05 * np.ptp(stances, axis=1)


CUSTOM = [
    Cost.custom(0.7, 0.3, prices),
    Cost.custom(base_weight=1.0, prices=prices),
    Cost.custom(step_weight=0.5, prices=np.arange(60.0) % 7),
]
COSTS = [("base", None), ("steps", None), ("weighted", 0.2), *((cost, None) for cost in CUSTOM)]
CRATE = Box.between("crate", "obstacle", (1.6, -0.15, -0.6), (1.8, 0.15, 0.0))
FEW, MORE = ("D1a", "F1b", "F2b"), ("D1a", "D2a", "F1b", "A1a")
WORLDS = {
    "no collisions": (FEW, NO_COLLISIONS, ()),
    "stances alone": (MORE, Settings(collisions=False, transitions=False), ()),
    "collisions": (MORE, Settings(), ()),
    "crate": (MORE, Settings(), (CRATE,)),
}
"""Tracks, settings and obstacles; with the obstacle two points are occupied."""


class Truth(NamedTuple):
    """A graph of which all is known, its states, where their bases are, and the steps between."""

    graph: object
    lazy: object
    states: list
    places: np.ndarray
    ends: np.ndarray
    moved: np.ndarray


@pytest.fixture(scope="module", params=WORLDS)
def truth(request, jem):
    """Of few enough stances for all their states; nothing is known of the graph `lazy`."""
    tracks, settings, boxes = WORLDS[request.param]
    keep = np.isin([point.split(":")[0] for point in jem.ids], tracks)
    if tracks == FEW:
        keep &= np.array([int(point.split(":")[1]) % 2 == 0 for point in jem.ids])
    graph, lazy = (stance_graph(jem.subset(keep, "few"), settings=settings) for _ in range(2))
    for one in (graph, lazy) if boxes else ():
        one.add_obstacles(boxes)
        one.occupy([4, 20])
    graph.node_postures(np.arange(len(graph)))
    states = [
        State(tuple(points), tuple(branch_sets))
        for points, branch_sets in zip(
            graph.points.tolist(), graph.branch_sets.tolist(), strict=True
        )
        if all(branch_sets) and not graph.occupied.intersection(points)
    ]
    index, edges, moved = {state: k for k, state in enumerate(states)}, [], []
    for state in states:
        here, steps = graph.base_position[graph.find(state.stance)], graph.successors(state)
        for k in range(len(steps.limb)):
            after = steps.after(state, k)
            if after not in index:
                index[after] = len(states)
                states.append(after)
            edges.append((index[state], index[after]))
            moved.append(np.linalg.norm(steps.base_position[k] - here))
    places = np.array([graph.base_position[graph.find(state.stance)] for state in states])
    return Truth(graph, lazy, states, places, np.array(edges).T, np.array(moved))


def price_of(cost, before, after):
    """The price of one step, its point found by what differs."""
    (point,) = (p for old, p in zip(before, after, strict=True) if p != old)
    if not isinstance(cost.prices, FunctionType):
        return point % 7
    return 0.02 * (point * 7 % 11) + 0.05 * (max(after) - min(after))


@pytest.mark.parametrize(("name", "price"), COSTS)
def test_existence_and_cost_of_plans_are_those_of_dijkstra(truth, name, price):
    """Also of the exact cost-to-go, which checks every step."""
    graph, count, cost = truth.graph, len(truth.states), Cost.named(name, price)
    if cost is CUSTOM[2]:  # an array has a number for each point of the map
        priced = cost.prices.values[: len(graph.grasp_map)]
        name = cost = Cost.custom(step_weight=0.5, prices=priced)
    known, planner = Planner(graph), Planner(truth.lazy)
    # SciPy takes a zero for no edge; steps run backwards here.
    paid = cost.base_weight * truth.moved + cost.step_weight
    if cost.prices is not None:
        paid += [price_of(cost, *(truth.states[k].stance for k in ends)) for ends in truth.ends.T]
    weights = np.maximum(paid, 1e-300)
    steps = csr_array((weights, truth.ends[::-1].astype(np.int32)), shape=(count, count))
    rng, how, outcomes = np.random.default_rng(0), {"regrasp_price": price}, []
    how["goal_tolerance"] = 0.05
    for _ in range(6):
        goal = np.clip(truth.places[rng.integers(count)], *graph.grasp_map.cabin)
        inside = np.flatnonzero(np.linalg.norm(truth.places - goal, axis=1) <= 0.05)
        costs = dijkstra(steps, indices=inside, min_only=True)
        values = known.cost_to_go(goal, name, **how)
        for k in rng.integers(count, size=5):
            start, least = truth.states[k], costs[k]
            assert values.value(start) == pytest.approx(least, abs=1e-9)
            for exact in ({}, {"method": "dijkstra"}, {"heuristic": "consistent"}):
                found = planner.plan(start, goal, name, options=SearchOptions(**exact), **how)
                assert bool(found) == np.isfinite(least)
                if found:
                    assert found.plan.cost == pytest.approx(least, abs=1e-9)
                    assert found.plan.statistics.bound == 1.0
            outcomes.append(bool(found))
            if found:
                greedy = planner.plan(
                    start, goal, name, options=SearchOptions(method="greedy"), **how
                ).unwrap()
                inflated = SearchOptions(heuristic="consistent", inflation=1.5)
                fast = planner.plan(start, goal, name, options=inflated, **how).unwrap()
                assert least - 1e-9 <= min(greedy.cost, fast.cost)
                assert fast.cost <= 1.5 * least + 1e-9
    assert sum(outcomes) > 10


@pytest.mark.parametrize(("first", "cost"), [(1, "steps"), (8, "base")])
def test_so_are_those_of_searches_that_give_way_at_once(truth, first, cost, monkeypatch):
    """From the start and from the goal in turn, also where a path of the last label is blocked."""
    monkeypatch.setattr(table_search, "FIRST_LIMIT", first)
    monkeypatch.setattr(table_search, "MANY", 4 * first)
    test_existence_and_cost_of_plans_are_those_of_dijkstra(truth, cost, None)
