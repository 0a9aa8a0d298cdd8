"""The plain search against networkx on a graph of `successors`, and against the compiled one."""

import numpy as np
import pytest
from paper import NO_COLLISIONS
from remembered import remembered
from state_graph import least_cost, reachable, within

from mlivr_gym import Settings, State, stance_graph
from mlivr_gym.planners import Cost, Planner, SearchOptions
from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.outcome import GOAL_REACHED, LIMIT_REACHED, SEARCH_EXHAUSTED
from mlivr_gym.planners.query import Goal

COSTS = [("base", None), ("steps", None), ("weighted", 0.1)]


def random_query(graph, rng):
    """A stance, and a goal: the base of another, or now and then any place among them."""
    start, other = (int(s) for s in rng.integers(0, len(graph), 2))
    anywhere = rng.uniform(graph.base_position.min(axis=0), graph.base_position.max(axis=0))
    goal = anywhere if rng.random() < 0.05 else graph.base_position[other]
    return graph.points[start].tolist(), np.clip(goal, *graph.grasp_map.cabin)


def least_costs(net, start, cost, goals):
    """Least cost to each goal by Dijkstra, inf where none of its states is reached."""

    def weight(_, __, edge):
        return cost.base_weight * edge["base"] + cost.step_weight

    return [least_cost(net, start, within(net, goal, 0.2), weight) for goal in goals]


def path_of(explored):
    """The states from the first to the last of a tree."""
    chain = [len(explored.states) - 1]
    while explored.parents[chain[-1]] >= 0:
        chain.append(explored.parents[chain[-1]])
    return [explored.states[k] for k in reversed(chain)]


@pytest.fixture(scope="module")
def tiny_map(jem):
    """Three tracks, every other point of each."""
    keep = np.isin([point.split(":")[0] for point in jem.ids], ["D1a", "F1b", "F2b"])
    keep &= np.array([int(point.split(":")[1]) % 2 == 0 for point in jem.ids])
    return jem.subset(keep, "tiny")


@pytest.fixture(scope="module", params=[2, 3], ids=["two limbs", "three limbs"])
def explored_from(request, tiny_map):
    """A graph, and all that is reached from each of some starts."""
    limbs, how = request.param, Settings()
    if limbs == 3:
        nine = np.isin(np.arange(15), np.linspace(0, 14, 9).round())
        tiny_map, how = tiny_map.subset(nine, "nine points"), NO_COLLISIONS
    graph = stance_graph(tiny_map, f"mlivr{limbs}", how)
    rng = np.random.default_rng(0)
    drawn = rng.permuted(np.tile(np.arange(len(tiny_map)), (400, 1)), axis=1)[:, :limbs].tolist()
    starts = [stance for stance in drawn if graph.is_node(graph.posture(stance))[0]]
    with remembered(graph, "successors"):
        found = []
        for stance in starts[: 4 - limbs]:
            start = State(tuple(stance), tuple(graph.posture(stance).branch_sets[0].tolist()))
            found.append((start, reachable(graph, start)))
        yield graph, found


@pytest.mark.parametrize(("name", "price"), COSTS)
def test_ways_cost_the_least_by_dijkstra_of_another_library(explored_from, name, price):
    graph, reached = explored_from
    rng, cost = np.random.default_rng(0), Cost.named(name, price)
    longer = missing = 0
    for start, net in reached:
        goals = rng.permutation(np.array([base for _, base in net.nodes(data="base")]))[:5]
        goals += rng.uniform(-0.15, 0.15, (5, 3))
        goals = [*goals, goals[0] + 1.0]
        costs = least_costs(net, start, cost, goals)
        for goal, expected in zip(goals, costs, strict=True):
            for heuristic in ("consistent", "zero"):
                explored = algorithm1(graph, start, Goal(goal, 0.2, cost), heuristic)
                assert explored.status == (
                    GOAL_REACHED if np.isfinite(expected) else SEARCH_EXHAUSTED
                )
                if explored.status == GOAL_REACHED:
                    assert explored.costs[-1] == pytest.approx(expected, abs=1e-9)
                if (name, heuristic) == ("steps", "zero"):
                    # Breadth first: no way found later is shorter.
                    assert explored.generated <= len(net)
                longer += len(path_of(explored)) > 2
                missing += explored.status == SEARCH_EXHAUSTED
    assert longer >= 2
    assert missing >= 2


def test_inflation_limit_and_progress(small_graph):
    planner, rng = Planner(small_graph), np.random.default_rng(6)
    start, goal = max(
        (random_query(small_graph, rng) for _ in range(8)),
        key=lambda query: planner.plan(*query, options=SearchOptions(method="dijkstra")).expanded,
    )
    best = planner.plan(
        start, goal, options=SearchOptions(method="algorithm1", heuristic="zero")
    ).unwrap()
    inflated = planner.plan(
        start, goal, options=SearchOptions(method="algorithm1", inflation=2.0)
    ).unwrap()
    assert best.cost - 1e-9 <= inflated.cost <= 2.0 * best.cost + 1e-9
    assert inflated.statistics.expanded < best.statistics.expanded
    seen = []
    options = SearchOptions("algorithm1", "zero", limit=150, progress=seen.append)
    short = planner.plan(start, goal, options=options)
    assert (short.reason, short.expanded, seen) == ("limit reached", 150, [0, 100])
    state = small_graph.state(start)
    assert algorithm1(small_graph, state, Goal(goal, 0.2, Cost()), limit=1).status == LIMIT_REACHED
