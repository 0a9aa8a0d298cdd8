"""Plans with collisions checked, against SciPy's Dijkstra over all states of `successors`."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from mlivr_gym import stance_graph
from mlivr_gym.planners import Planner
from mlivr_gym.planners.costs import Cost
from mlivr_gym.stances.random_states import random_state

COSTS = [("base", None), ("steps", None), ("weighted", 0.2)]


@pytest.fixture(scope="module")
def graph(jem):
    """Few enough stances for all their states."""
    keep = np.isin([point.split(":")[0] for point in jem.ids], ["D1a", "D2a", "F1b", "A1a"])
    return stance_graph(jem.subset(keep, "four tracks"))


@pytest.fixture(scope="module")
def states(graph):
    """All states, where their bases are, and the steps between them with their displacements."""
    todo = [graph.state(points.tolist()) for points in graph.points]
    index, edges = {state: k for k, state in enumerate(todo)}, []
    for state in todo:
        here, steps = graph.base_position[graph.find(state.stance)], graph.successors(state)
        for k in range(len(steps.limb)):
            after = steps.after(state, k)
            if after not in index:
                index[after] = len(todo)
                todo.append(after)
            moved = float(np.linalg.norm(steps.base_position[k] - here))
            edges.append((index[state], index[after], moved))
    places = np.array([graph.base_position[graph.find(state.stance)] for state in todo])
    return index, places, np.array(edges)


@pytest.mark.parametrize(("name", "price"), COSTS)
def test_existence_and_cost_of_plans_are_those_of_dijkstra(graph, states, name, price):
    index, places, edges = states
    cost, planner, rng = Cost.named(name, price), Planner(graph), np.random.default_rng(0)
    # SciPy takes a zero for no edge.
    weights = np.maximum(cost.base_weight * edges[:, 2] + cost.step_weight, 1e-300)
    ends = edges[:, :2].astype(int).T
    steps = csr_array((weights, tuple(ends)), shape=(len(index), len(index)))
    outcomes = []
    for _ in range(5):
        start = random_state(graph, rng)
        for _ in range(rng.integers(3)):  # a limb that held is on some of its branches only
            left = graph.successors(start)
            start = left.after(start, int(rng.integers(len(left.limb))))
        costs = dijkstra(steps, indices=index[start])
        for _ in range(6):
            goal = np.clip(graph.base_position[rng.integers(len(graph))], *graph.grasp_map.cabin)
            inside = np.linalg.norm(places - goal, axis=1) <= 0.05
            least = costs[inside].min(initial=np.inf)
            how = {"goal_tolerance": 0.05, "regrasp_price": price}
            found = planner.plan(start, goal, name, **how)
            outcomes.append(bool(found))
            assert outcomes[-1] == np.isfinite(least)
            if found:
                assert found.plan.statistics.cost == pytest.approx(least, abs=1e-9)
                plain = planner.plan(start, goal, name, method="dijkstra", **how).unwrap()
                assert plain.cost == pytest.approx(least, abs=1e-9)
                greedy = planner.plan(start, goal, name, method="greedy", **how).unwrap()
                inflated = {"heuristic": "consistent", "inflation": 1.5}
                fast = planner.plan(start, goal, name, **inflated, **how).unwrap()
                assert least - 1e-9 <= min(greedy.cost, fast.cost)
                assert fast.cost <= 1.5 * least + 1e-9
    assert sum(outcomes) > 10
