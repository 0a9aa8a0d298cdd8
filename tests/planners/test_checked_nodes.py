"""Nodes that a search checks among obstacles."""

import numpy as np
import pytest
from small_tables import small_table_with_box

from mlivr_gym.planners.backward_search import MIN_COST_OUTSIDE_GOAL
from mlivr_gym.planners.costs import Cost, cost_weights
from mlivr_gym.planners.label_search import SearchGraph, SearchParameters, cheapest_path
from mlivr_gym.planners.labels import Labels, NodeOrigins
from mlivr_gym.stances.node_steps import candidate_steps
from mlivr_gym.stances.present_table import PresentTable
from mlivr_gym.transitions.records import ReleaseRecord
from mlivr_gym.world.boxes import Box


@pytest.fixture(params=[3, 4])
def graph(request):
    """A graph on a few points with a box, which goes after the test."""
    with small_table_with_box(request.param, 0.04) as found:
        yield found


def test_nodes_are_checked_when_they_are_popped(graph):
    """The cheapest path costs what it does if every node is checked before the search."""
    rng, count, solved, checks = np.random.default_rng(1), len(graph.table.points), 0, 0
    weights, labels = cost_weights(Cost.named("base"), graph.table.points), Labels.allocate(count)
    every = PresentTable(graph, graph.graph_table)
    every.check_nodes(np.arange(count))
    losing = np.flatnonzero(every.table.branch_sets != graph.table.branch_sets)
    goals = np.concatenate([rng.choice(count, 60), rng.choice(losing, 60)])
    for start, goal in zip(rng.choice(count, 120), goals, strict=True):
        h, found = np.full(count, MIN_COST_OUTSIDE_GOAL), []
        h[goal] = 0.0
        for first in ([start], np.arange(count)):
            present = PresentTable(graph, graph.graph_table)
            present.check_nodes(np.array(first))
            table, checked = present.table, present.checked_edges
            left = present.unchecked.sum()
            origins = NodeOrigins(np.array([start]), table.branch_sets[[start]], np.zeros(1))
            outcome = cheapest_path(
                SearchGraph(table, checked, weights, unchecked=present.unchecked), h, origins,
                labels, SearchParameters(), check_nodes=present.check_nodes,
            )  # fmt: skip
            checks += left - present.unchecked.sum()
            found.append(outcome)
        one, other = found
        assert (one.path is None) == (other.path is None)
        assert one.lower_bound == pytest.approx(other.lower_bound)
        if one.path is not None and other.path is not None:
            solved += one.path.cost > 0.0
            assert one.path.cost == pytest.approx(other.path.cost)
            assert (one.path.branch_sets & ~table.branch_sets[one.path.nodes] == 0).all()
    assert solved > 1
    assert checks > 10


def branches_after_checks(present, rows):
    """Check nodes, and edges from them; return the branches of all nodes."""
    present.check_nodes(rows)
    table, some = present.table, rows[present.table.branch_sets[rows] != 0]
    edges = [candidate_steps(table, int(row), 0).edges[:40] for row in some[:20]]
    present.kept(np.concatenate(edges).astype(np.int64))
    return np.stack([table.branch_sets, table.releasable]).copy()


def test_nothing_that_was_checked_among_other_obstacles_lasts(graph):
    """Though the arrays of one world serve the next."""
    rng = np.random.default_rng(3)
    rows = np.sort(rng.choice(len(graph.table.points), len(graph.table.points) // 2, replace=False))
    before, (first, *_) = graph.obstacles, graph.obstacles
    centre = np.array(first.centre) + np.array([0.3, 0.2, 0.1])
    moved = Box("moved", "obstacle", tuple(centre.tolist()), first.half)
    found = []
    try:
        for boxes in (before, (moved,), (), before):
            graph.remove_obstacles()
            graph.add_obstacles(boxes)
            if boxes:
                found.append(branches_after_checks(graph.present, rows))
                fresh = branches_after_checks(PresentTable(graph, graph.graph_table), rows)
                np.testing.assert_array_equal(found[-1], fresh)
                # No limb can be released at a node, as may be found when an edge to it is checked.
                none = ReleaseRecord.rows(1, graph.limbs)
                none["known"] = True
                graph.present._record_releases(np.setdiff1d(np.arange(9), rows)[:1], none)
            else:
                assert graph.present.table is graph.table
        assert (found[0] != found[1]).any()
        np.testing.assert_array_equal(found[0], found[2])
    finally:
        graph.remove_obstacles()
        graph.add_obstacles(before)
