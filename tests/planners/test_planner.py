"""The planner: optimal plans, why there is none, and plans as files."""

import itertools
from collections import Counter

import numpy as np
import pytest
import rustworkx as rx
from paper import NO_COLLISIONS
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from state_graph import reachable, within

from mlivr_gym import Settings, State, jem_map, stance_graph
from mlivr_gym.errors import GoalError, MlivrError, PlanError, SettingError
from mlivr_gym.planners import Plan, Planner

COSTS = [("base", None), ("steps", None), ("weighted", 0.1)]


def branch_graph(graph):
    """The graph by its plain definition: a node for every stance with a branch of each limb.

    Returns:
        The number of each node, nodes that are joined, shape (k, 2), and the displacement of the
        base between them [m], shape (k,).
    """
    nodes, edges, displacements = {}, [], []
    full = [
        State(tuple(graph.points[s].tolist()), tuple(graph.branch_sets[s].tolist()))
        for s in range(len(graph))
    ]
    for s, state in enumerate(full):
        for pair in itertools.product(
            *([b for b in range(16) if m >> b & 1] for m in state.branch_sets)
        ):
            nodes[s, *pair] = len(nodes)
    for s, state in enumerate(full):
        steps = graph.successors(state)
        for limb, point, position, branch_sets in zip(*steps, strict=True):
            stance = list(state.stance)
            stance[limb] = int(point)
            t, held = graph.find(tuple(stance)), 1 - limb
            displacement = float(np.linalg.norm(position - graph.base_position[s]))
            kept = [b for b in range(16) if branch_sets[held] >> b & 1]
            old = [b for b in range(16) if state.branch_sets[limb] >> b & 1]
            new = [b for b in range(16) if graph.branch_sets[t, limb] >> b & 1]
            for b in kept:
                for first, then in itertools.product(old, new):
                    here = (s, b, first) if held == 0 else (s, first, b)
                    there = (t, b, then) if held == 0 else (t, then, b)
                    edges.append((nodes[here], nodes[there]))
                    displacements.append(displacement)
    return nodes, np.array(edges), np.array(displacements)


def all_cost(expected, planner, query, price):
    """Plans by every heuristic that is a lower bound cost so much; infinite where there is none."""
    for heuristic in ("relaxed", "consistent", "zero"):
        plan = planner.plan(*query, regrasp_price=price, heuristic=heuristic).plan
        found = plan.statistics.cost if plan else np.inf
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.fixture(scope="module")
def tiny():
    """Few enough stances for an exhaustive search over branches."""
    full = jem_map()
    keep = np.array([point.split(":")[0] in {"D1a", "F1b", "F2b"} for point in full.ids])
    keep &= np.array([int(point.split(":")[1]) % 2 == 0 for point in full.ids])
    return stance_graph(full.subset(keep, "tiny"), settings=NO_COLLISIONS)


@pytest.fixture(scope="module")
def tiny_truth(tiny):
    return branch_graph(tiny)


@pytest.mark.parametrize(("cost", "price"), COSTS)
def test_plans_are_optimal_by_exhaustive_search_of_another_library(
    tiny, tiny_truth, cost, price, weight
):
    (nodes, edges, displacements), planner = tiny_truth, Planner(tiny)
    # SciPy takes a zero for no edge.
    weights = [max(weight(cost, price, moved), 1e-300) for moved in displacements.tolist()]
    truth = csr_array((weights, tuple(edges.T)), shape=(len(nodes), len(nodes)))
    stances = np.array([node[0] for node in nodes])
    rng = np.random.default_rng(0)
    for _ in range(5):
        s, g = (int(v) for v in rng.integers(0, len(tiny), 2))
        goal = np.clip(tiny.base_position[g], *tiny.grasp_map.cabin)
        inside = np.linalg.norm(tiny.base_position[stances] - goal, axis=1) <= 0.2
        reached = dijkstra(truth, indices=np.flatnonzero(stances == s), min_only=True)
        expected = reached[inside].min(initial=np.inf)
        table = planner.cost_to_go(goal, cost, regrasp_price=price)
        assert table.values[s] == pytest.approx(expected, abs=1e-9)
        all_cost(expected, planner, (tiny.points[s].tolist(), goal, cost), price)


@pytest.mark.parametrize(("cost", "price"), COSTS)
def test_node_only_plans_agree_with_rustworkx(small_map, cost, price, weight):
    graph = stance_graph(small_map, settings=Settings(collisions=False, transitions=False))
    truth = rx.PyDiGraph()
    truth.add_nodes_from(range(len(graph)))
    for held in range(2):
        for s in range(len(graph)):
            for t in graph.row(held, s).tolist():
                truth.add_edge(
                    s,
                    t,
                    weight(
                        cost,
                        price,
                        float(np.linalg.norm(graph.base_position[s] - graph.base_position[t])),
                    ),
                )
    planner, rng = Planner(graph), np.random.default_rng(1)
    for _ in range(10):
        s, g = (int(v) for v in rng.integers(0, len(graph), 2))
        goal = np.clip(graph.base_position[g], *small_map.cabin)
        reached = rx.dijkstra_shortest_path_lengths(truth, s, float)
        goals = np.flatnonzero(np.linalg.norm(graph.base_position - goal, axis=1) <= 0.2)
        expected = (
            0.0 if s in goals else min((reached[t] for t in goals if t in reached), default=np.inf)
        )
        all_cost(expected, planner, (graph.points[s].tolist(), goal, cost), price)


def test_a_plan_of_another_map_is_refused(graph, small_map, tmp_path):
    plan = Planner(graph).plan(("D1a:4", "D1b:4"), (3.0, 0.0, 0.0)).unwrap()
    path = tmp_path / "plan.json"
    plan.save(path)
    with pytest.raises(PlanError, match=r"made on map 'jem'.*not on 'small'"):
        Plan.load(path, small_map)
    with pytest.raises(MlivrError, match="cannot write"):
        plan.save(tmp_path / "no" / "plan.json")


def test_no_path_says_why(graph, jem):
    planner = Planner(graph)
    start = ("D1a:4", "D1b:4")
    result = planner.plan(("D1a:4", "D2b:4"), (6.0, 0.0, 0.42))
    assert (result.reason, bool(result)) == ("start infeasible", False)
    assert "limb manipulability" in result.message
    assert (result.expanded, result.generated, len(result.tree)) == (0, 0, 0)
    result = planner.plan(start, (9.5, 0.0, 0.0))
    assert result.reason == "goal outside the reachable set"
    assert "[9.5, 0.0, 0.0]" in result.message
    result = planner.plan(start, (6.0, 0.0, 0.42), heuristic="zero", limit=10)
    assert result.reason == "limit reached"
    assert result.expanded == 10
    with pytest.raises(PlanError, match="limit reached"):
        result.unwrap()
    far = {"D1a", "D1b", "D6a", "D6b", "F6a", "F6b"}
    split = jem.subset(np.array([point.split(":")[0] in far for point in jem.ids]), "split")
    result = Planner(stance_graph(split, settings=NO_COLLISIONS)).plan(start, (6.6, 0.0, -0.4))
    assert result.reason == "goal outside the reachable set"


def test_search_exhausted_where_the_only_step_cannot_be_executed(jem, graph):
    """Three points: both stances can be held, but the limb that stays cannot follow the base."""
    rng, reasons = np.random.default_rng(0), Counter()
    for _ in range(60):
        s = int(rng.integers(len(graph)))
        row = graph.row(0, s)
        none = (
            graph.kept_branches(0, s, row) & graph.branch_sets[s, 0] & graph.branch_sets[row, 0]
            == 0
        )
        for t in row[none][:5].tolist():
            keep = np.zeros(len(jem), dtype=bool)
            keep[[*graph.points[s], *graph.points[t]]] = True
            three = stance_graph(jem.subset(keep, "three"), settings=NO_COLLISIONS)
            start, goal = graph.ids(graph.points[s]), graph.base_position[t]
            result = Planner(three).plan(start, goal, goal_tolerance=0.01)
            near = within(reachable(three, three.state(start)), goal, 0.01)
            assert (result.plan is not None) == bool(near)
            reasons[result.reason] += 1
        if reasons["search exhausted"] > 2:
            break
    assert reasons["search exhausted"] > 2


def test_a_goal_cut_off_by_occupied_points_is_said_to_be_so(small_map):
    """The start has steps; no sequence of them leads on, which no search is needed to prove."""
    graph = stance_graph(small_map, settings=NO_COLLISIONS)
    free, goal = Planner(graph), graph.base_position[graph.base_position[:, 0].argmax()]
    first = int(graph.base_position[:, 0].argmin())
    start = graph.ids(graph.points[first])
    plan = free.plan(start, goal, "steps").unwrap()
    spared = {*start, plan.actions[0][1]}
    graph.occupy([point for point in small_map.ids if point not in spared])
    assert graph.successors(graph.state(start))
    for how in ({}, {"method": "greedy"}, {"heuristic": "paper"}, {"heuristic": "consistent"}):
        result = Planner(graph).plan(start, goal, "steps", **how)
        assert result.reason == "search exhausted", how
        assert "no step leaves the start" not in result.message
    graph.vacate()


def test_a_search_that_is_cut_short_promises_no_more_than_it_proved(graph):
    rng, bounds, factor = np.random.default_rng(3), [], 1.2
    for _ in range(22):
        first, last = rng.integers(len(graph), size=2)
        start, goal = graph.ids(graph.points[first]), graph.base_position[last]
        best = Planner(graph).plan(start, goal).plan
        for limit in (8, 17, 10_000):
            cut = Planner(graph).plan(start, goal, inflation=factor, limit=limit).plan
            if cut is not None:
                bounds.append((limit, cut.statistics.bound))
                assert cut.cost <= bounds[-1][1] * best.cost * (1.0 + 1e-9)
    assert max(bound for limit, bound in bounds if limit > 17) <= factor
    assert factor < max(bound for _, bound in bounds) < 1.01 * factor  # the limit came first


def test_bad_arguments_are_named(graph):
    planner, start, goal = Planner(graph), ("D1a:4", "D1b:4"), (6.0, 0.0, 0.42)
    for error, words, change in (
        (SettingError, "regrasp_price", {"cost": "weighted"}),
        (SettingError, "regrasp_price", {"regrasp_price": 0.1}),
        (SettingError, "regrasp_price is -1", {"cost": "weighted", "regrasp_price": -1}),
        (SettingError, "greedy", {"method": "greedy", "heuristic": "zero"}),
        (SettingError, "heuristic is 'paper'", {"method": "dijkstra", "heuristic": "paper"}),
        (SettingError, "now called 'relaxed'", {"heuristic": "cost_to_go"}),
        (SettingError, "inflation is 0.5", {"inflation": 0.5}),
        (GoalError, "outside the cabin", {"goal": (60.0, 0.0, 0.0)}),
    ):
        with pytest.raises(error, match=words):
            planner.plan(**({"start": start, "goal": goal} | change))
    many = Planner(stance_graph(graph.grasp_map, "mlivr3", NO_COLLISIONS))
    with pytest.raises(SettingError, match="two limbs"):
        many.cost_to_go(goal)


def test_start_inside_the_goal_is_a_plan_without_steps(graph):
    start = graph.state(("D1a:4", "D1b:4"))
    here = graph.posture(start.stance).base_position[0]
    plan = Planner(graph).plan(start.stance, here).unwrap()
    assert plan.steps == ()
    assert plan.statistics.cost == 0.0
    assert plan.base_translation == 0.0
