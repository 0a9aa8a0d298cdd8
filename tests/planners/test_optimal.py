"""Plans, costs-to-go and goals that name a face, against NetworkX and SciPy over all states."""

from types import FunctionType
from typing import NamedTuple

import numpy as np
import pytest
from paper import NO_COLLISIONS
from remembered import STEPS, StepsAskedOnce
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from state_graph import least_cost, reachable, within

from mlivr_gym import Box, Settings, State, stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners import Cost, Planner, SearchOptions, table_search
from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.outcome import GOAL_REACHED, LIMIT_REACHED, SEARCH_EXHAUSTED
from mlivr_gym.planners.query import Goal

NAMED_COSTS = [("base", None), ("steps", None), ("weighted", 0.1)]


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
    graph = StepsAskedOnce(stance_graph(tiny_map, f"mlivr{limbs}", how))
    rng = np.random.default_rng(0)
    drawn = rng.permuted(np.tile(np.arange(len(tiny_map)), (400, 1)), axis=1)[:, :limbs].tolist()
    starts = [stance for stance in drawn if graph.is_node(graph.posture(stance))[0]]
    states = [graph.state(stance) for stance in starts[: 4 - limbs]]
    yield graph, [(start, reachable(graph, start)) for start in states]
    STEPS.clear()


@pytest.mark.parametrize(("name", "price"), NAMED_COSTS)
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


@pytest.fixture(scope="module")
def corner(jem):
    """Points of the deck and the forward wall that lie near each other."""
    keep = (jem.positions[:, 0] < 2.6) & np.isin(jem.faces, ["deck", "forward"])
    return jem.subset(keep & (np.arange(len(jem)) % 3 == 0), "corner")


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3"])
def test_walks_end_on_the_face_with_the_fewest_steps(corner, robot):
    settings = Settings(collisions=False)
    if robot == "mlivr3":
        settings = Settings(manipulability=False, transitions=False, collisions=False)
        corner = corner.subset(np.arange(len(corner)) % 2 == 0, "fewer points")
    graph, rng = stance_graph(corner, robot, settings), np.random.default_rng(2)
    planner, limbs, faces = Planner(graph), graph.limbs, np.array(corner.faces)
    drawn = rng.permuted(np.tile(np.arange(len(corner)), (600, 1)), axis=1)[:, :limbs]
    stances = [s for s in drawn.tolist() if graph.is_node(graph.posture(s))[0]]
    net, fewest, longer, ended = reachable(graph), {}, 0, 0
    for stance, other in zip(stances[:8], stances[8:16], strict=True):
        start, goal = graph.state(stance), graph.posture(other).base_position[0]
        goal = np.clip(goal, *corner.cabin)
        near = within(reachable(graph, start, known=net), goal, 0.4)
        for face in (None, "deck", "forward"):
            ends = [s for s in near if face is None or (faces[[*s.stance]] == face).all()]
            fewest[face] = least_cost(net, start, ends)
            for method in ("astar", "algorithm1"):
                options = SearchOptions(method=method, inflation=1.0)
                found = planner.plan(
                    stance, goal, "steps", goal_tolerance=0.4, goal_face=face, options=options
                )
                assert bool(found) == np.isfinite(fewest[face])
                if found and face is not None:
                    assert len(found.plan.steps) == fewest[face]
                    held = {corner.faces[corner.index(point)] for point in found.plan.stances[-1]}
                    assert held == {face}
                    longer, ended = longer + (fewest[face] > fewest[None]), ended + 1
    assert ended > 6
    assert longer


def test_the_exact_cost_counts_goals_on_the_face_alone(corner):
    graph = stance_graph(corner, settings=Settings(collisions=False))
    planner, goal = Planner(graph), corner.cabin.mean(axis=0)
    goal[0] = 2.0
    how = {"cost": "steps", "goal_tolerance": 0.6, "goal_face": "deck"}
    exact = planner.cost_to_go(goal, **how)
    faces = np.array(corner.faces)[graph.points]
    near = np.linalg.norm(graph.base_position - goal, axis=1) <= 0.6
    np.testing.assert_array_equal(exact.values == 0.0, near & (faces == "deck").all(axis=1))
    assert 0 < exact.is_goal.sum() < near.sum()
    for s in np.random.default_rng(0).choice(len(graph), 20):
        found = planner.plan(graph.points[s].tolist(), goal, **how)
        assert (found.plan.cost if found else np.inf) == exact.values[s]


def test_the_command_takes_a_face_and_the_file_keeps_it(tmp_path):
    file = tmp_path / "plan.json"
    task = ["--start", "D2a:4", "D2b:4", "--goal", "5.9", "0", "0.4", "--cost", "steps"]
    assert main(["plan", *task, "--goal-face", "overhead", "--out", str(file)]) == 0
    plan = Plan.load(file)
    assert plan.query.goal_face == "overhead"
    assert all(point.startswith("O") for point in plan.stances[-1])


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
