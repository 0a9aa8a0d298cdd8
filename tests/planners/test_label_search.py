"""The label-setting search against NetworkX; its queue and checked edges against Python's own."""

import heapq
import time

import networkx as nx
import numpy as np
import pytest
from compiled import called
from hypothesis import given
from hypothesis import strategies as st
from small_tables import COSTS, every_pair, goal_at, small_table

from mlivr_gym.compiled.limb_branch_sets import packed, unpacked
from mlivr_gym.planners import label_search
from mlivr_gym.planners.backward_search import costs_to_goal
from mlivr_gym.planners.clock import Clock
from mlivr_gym.planners.costs import cost_weights
from mlivr_gym.planners.label_search import (
    SearchGraph,
    SearchParameters,
    cheapest_path,
)
from mlivr_gym.planners.labels import Labels, NodeOrigins
from mlivr_gym.planners.open_queue import (
    NO_ENTRY,
    NodeQueue,
    least_estimate,
    pop,
    push,
    requeue,
)
from mlivr_gym.postures.relabelling import relabelled
from mlivr_gym.stances.checked_edges import CheckedEdges
from mlivr_gym.stances.node_edges import (
    EdgeSet,
    NodePair,
    branches_lost,
    count_node_pairs,
    list_node_pairs,
    with_edges,
)


@given(st.lists(st.none() | st.floats(0.0, 1e3) | st.integers(0, 3).map(float)))
def test_what_is_taken_has_the_least_estimate(actions):
    """Nothing takes a node; a number is put in, and there is always room."""
    queue, plain, estimate_of, node = NodeQueue.allocate(1), [], {}, 0
    for action in (*actions, *[None] * len(actions), None):
        if action is not None:
            if queue.status["entry_count"] == len(queue.node):
                queue = queue.doubled()
            called(push)(queue, action, node)
            heapq.heappush(plain, action)
            estimate_of[node] = action
            node += 1
        elif plain:
            assert called(least_estimate)(queue) == queue.lower_bound == plain[0]
            entry = int(called(pop)(queue))
            assert estimate_of[entry] == plain[0]
            called(requeue)(queue, estimate_of[entry], entry)
            again = int(called(pop)(queue))
            assert estimate_of.pop(int(queue.node[again])) == heapq.heappop(plain)
        else:
            assert called(pop)(queue) == NO_ENTRY
            assert called(least_estimate)(queue) == queue.lower_bound == float("inf")
            return
    assert not plain
    assert not estimate_of


BIT = st.integers(0, 40) | st.integers(0, 1 << 40)
EDGE = st.tuples(BIT, st.tuples(st.integers(0, 1 << 48), st.booleans()))


@given(st.lists(st.lists(EDGE, max_size=20), max_size=6))
def test_it_holds_what_was_put_in_last(groups):
    known, plain = CheckedEdges.empty(50, capacity=4), {}
    for group in groups:
        nodes = np.array([bit % 50 for bit, _ in group], dtype=np.int64)
        bits = np.array([bit for bit, _ in group], dtype=np.int64)
        kept = np.array([branch_sets for _, (branch_sets, _) in group], dtype=np.uint64)
        is_exact = np.array([exact for _, (_, exact) in group], dtype=np.bool_)
        known = known.with_edges(nodes, bits, kept, is_exact)
        plain.update(group)
        assert len(known.keys) >= 2 * len(plain)
    assert np.flatnonzero(known.has_edges).tolist() == sorted({bit % 50 for bit in plain})
    asked = np.array([*plain, 7, 1 << 41], dtype=np.int64)
    assert known.contains(asked).tolist() == [True] * len(plain) + [7 in plain, False]
    bits = np.array([*plain], dtype=np.int64)
    assert known.kept_on(bits).tolist() == [kept for kept, _ in plain.values()]
    assert known.are_exact(asked).tolist()[: len(plain)] == [exact for _, exact in plain.values()]
    assert not known.are_exact(asked[-1:]).any()


EXACT = SearchParameters(1.0, 1 << 30, 1 << 30, 1 << 30)


@pytest.fixture(scope="module", params=[2, 3, 4])
def known(request):
    return small_table(request.param)


def losing_some(table, rng):
    """The table with random branches lost between the pairs that share some."""
    support_sets, limbs = len(table.offset) - 1, table.limbs
    first = NodePair.before(table, 0)
    pairs = np.empty((count_node_pairs(table, first.copy(), support_sets), 2), dtype=np.int64)
    list_node_pairs(table, first.copy(), support_sets, pairs)
    (a, i), (b, j) = (np.divmod(table.members[column], limbs) for column in pairs.T)
    branch_sets = unpacked(table.branch_sets, limbs)
    shared = relabelled(branch_sets[a], i + 1)[:, :-1] & relabelled(branch_sets[b], j + 1)[:, :-1]
    kept = shared & rng.integers(0, 8, shared.shape) | shared & rng.integers(0, 8, shared.shape)
    kept[~kept.all(axis=1)] = 0
    return with_edges(table, EdgeSet.of(packed(shared), packed(kept)))


def price(table, rows, cost):
    """Least costs of steps."""
    away = np.linalg.norm(table.base_position[rows[:, 0]] - table.base_position[rows[:, 2]], axis=1)
    return cost.base_weight * away + cost.step_weight


def exact_costs(table, goals, weights, start):
    """Least costs to the goals over pairs of nodes."""
    start_bounds = np.zeros(len(goals))
    return costs_to_goal(table, goals, weights, np.array([start]), start_bounds, (0.0, np.inf))[0]


def test_a_walk_costs_what_the_shortest_path_over_all_states_does(known, monkeypatch):
    """With some steps known to keep less than their nodes share, or nothing.

    Branch sets are random, so that nodes are come to on many, and so is what steps lose."""
    monkeypatch.setattr(label_search, "CLOCK_INTERVAL", 7)
    graph, table = known
    rng, limbs, count = np.random.default_rng(1), table.limbs, len(table.points)
    drawn = rng.integers(1, 8, (count, limbs))
    some = drawn & rng.integers(1, 8, (count, limbs))
    table = table._replace(
        branch_sets=packed(drawn), releasable=packed(np.where(some > 0, some, drawn))
    )
    table = losing_some(table, rng)
    pairs, branch_sets = every_pair(table), unpacked(table.branch_sets, limbs)
    releasable, kept = unpacked(table.releasable, limbs), {}
    for a, i, b, j, bit in pairs.tolist():
        lost = unpacked(np.array([called(branches_lost)(table, bit)], dtype=np.uint64), limbs - 1)[
            0
        ]
        kept[bit] = (
            np.roll(branch_sets[a], -i - 1)[:-1] & np.roll(branch_sets[b], -j - 1)[:-1] & ~lost
        )
    steps = CheckedEdges.empty(count)
    for row in pairs[rng.random(len(pairs)) < 0.3].tolist():
        kept[row[4]] = kept[row[4]] & rng.integers(0, 1 << 16, limbs - 1) * (rng.random() < 0.8)
        number = sum(int(branch_set) << 16 * k for k, branch_set in enumerate(kept[row[4]]))
        one = np.array([number], dtype=np.uint64), np.ones(1, dtype=np.bool_)
        steps = steps.with_edges(np.array(row[:1]), np.array(row[4:]), *one)
    leaving = [np.flatnonzero(pairs[:, 0] == s).tolist() for s in range(count)]
    for _ in range(8):
        start = int(rng.integers(count))
        states, first = nx.DiGraph(), (start, tuple(branch_sets[start].tolist()))
        queue = [first]
        states.add_node(first)
        while queue:
            here = queue.pop()
            for e in leaving[here[0]]:
                _, i, b, j, bit = pairs[e].tolist()
                held = np.roll(here[1], -i - 1)[:-1] & kept[bit]
                if here[1][i] & releasable[here[0], i] and held.all():
                    after = np.roll(np.append(held, releasable[b, j]), j + 1)
                    there = b, tuple(after.tolist())
                    if there not in states:
                        queue.append(there)
                    states.add_edge(here, there, pair=e)
        row = int(rng.integers(count))
        for cost in COSTS:
            goal, ends = goal_at(graph, table, row, cost), (states, first)
            search_graph = SearchGraph(table, steps, cost_weights(goal.cost, table.points))
            assert_cheapest(search_graph, goal, pairs, ends)


def assert_cheapest(search_graph, goal, pairs, ends):
    """Compare the cheapest path to a goal with the states to which steps lead from the first."""
    table, weights, (states, first) = search_graph.table, search_graph.weights, ends
    goals = goal.distance(table.base_position.astype(float)) <= goal.tolerance
    charged = price(table, pairs, goal.cost)
    costs = nx.single_source_dijkstra_path_length(
        states, first, weight=lambda _, __, edge: charged[edge["pair"]]
    )
    least = min((c for (s, _), c in costs.items() if goals[s]), default=np.inf)
    h = exact_costs(table, goals, weights, first[0])
    origins = NodeOrigins(np.array(first[:1]), table.branch_sets[[first[0]]], np.zeros(1))

    def cheapest(**limits):
        labels = Labels.allocate(len(goals))
        return cheapest_path(search_graph, h, origins, labels, EXACT, **limits)[:2]

    path, lower_bound = cheapest()
    assert lower_bound == pytest.approx(least, abs=1e-9)
    for cost_limit in (1.001 * least + 1e-9, 0.999 * least) if least > 0.0 else ():
        found, bound = cheapest(cost_limit=cost_limit)
        assert (found is not None) == (least < cost_limit)
        assert bound == pytest.approx(min(least, cost_limit), abs=1e-9)
    assert cheapest(clock=Clock(time.perf_counter() - 1.0)) == (None, 0.0)
    hasty = EXACT._replace(cost_weight=0.3, labels_per_node=1)
    found = cheapest_path(search_graph, h, origins, Labels.allocate(len(goals)), hasty)
    # An exhausted queue proves that there is no path, unless labels were dropped on the way.
    assert found.path is not None or found.has_dropped or least == np.inf
    if path is not None:
        assert path.cost == pytest.approx(least, abs=1e-9)
        assert goals[path.nodes[-1]]
        held = unpacked(path.branch_sets, table.limbs).tolist()
        for node, branch_sets in zip(path.nodes.tolist(), held, strict=True):
            assert (node, tuple(branch_sets)) in states
