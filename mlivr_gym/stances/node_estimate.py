"""Estimate the time that building a table of nodes takes, from a sample of them."""

from __future__ import annotations

import time

import numpy as np

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.kernels import workers
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.node_edges import EdgeSet, NodePair, count_node_pairs, list_node_pairs
from mlivr_gym.stances.node_table import Nodes, NodeTable, codes, table_of
from mlivr_gym.stances.node_table_build import (
    FEW_SETS,
    kept_at_most,
    nodes_of_sets,
    parts_of_nodes,
    sets_of,
)
from mlivr_gym.stances.stance_sets import StanceSets
from mlivr_gym.stances.two_limb_build import Estimate

SAMPLE = 300
"""Number of sets of points in the sample, if there are as many."""

PAIRS = 3000
"""Largest number of pairs of nodes in the sample."""


def estimate_nodes(graph: ImplicitGraph) -> Estimate:
    """Estimate what building the table of a graph takes.

    Every node one step from another has a support set in common with it, so all sets with some
    support sets show how many such pairs there are.

    Raises
    ------
    TableError
        If robots with this number of limbs have no table, or the map has too many points.
    """
    sets = sets_of(graph)
    candidates = f"{len(sets):,} sets of points"
    if not len(sets):
        return Estimate(candidates, 0.0, 0.0)
    chosen, pose_number = _some(sets)
    world = graph.grasp_map, graph.robot, graph.settings
    nodes_of_sets(0, sets.points[pose_number[:1]], world)  # compiles
    began = time.perf_counter()
    *columns, rotation = nodes_of_sets(0, sets.points[pose_number], world)
    seconds = (time.perf_counter() - began) * len(sets) / len(pose_number)
    order = np.argsort(codes(columns[0]))
    nodes = Nodes(*(one[order] for one in columns))
    table = table_of(nodes)
    every, begun = len(chosen), np.flatnonzero(_in_sample(table, sets, chosen))
    members = table.members.astype(np.int64)
    pairs, more = _pairs(table, begun), sets.support_set_count / every
    some = pairs[:: max(1, len(pairs) // PAIRS)]
    kept_at_most(graph, nodes, rotation[order], members, some[:1])
    began = time.perf_counter()
    found = EdgeSet(*kept_at_most(graph, nodes, rotation[order], members, some))
    spent = time.perf_counter() - began
    seconds += spent * more * len(pairs) / max(len(some), 1)
    each = sum(one.itemsize * one[:1].size for one in table[:7]) + members.itemsize * graph.limbs
    squares = float((np.diff(table.start)[begun].astype(float) ** 2).sum()) * more
    lost = 16.0 * len(found.lost) * more * len(pairs) / max(len(some), 1)
    size = each * len(nodes.points) * len(sets) / len(pose_number) + squares * 20 / 64 + lost
    seconds /= workers(len(sets), FEW_SETS)
    return Estimate(candidates, seconds, size, parts_of_nodes(graph).count())


def _some(sets: StanceSets) -> tuple[IntArray, IntArray]:
    """Return some support sets, and the rows of all sets that have one of them."""
    order = np.random.default_rng(0).permutation(sets.support_set_count)
    sizes = np.bincount(sets.support_sets.ravel(), minlength=sets.support_set_count)
    count = 1 + int(np.searchsorted(np.cumsum(sizes[order]), SAMPLE))
    chosen = order[:count]
    return chosen, np.flatnonzero(np.isin(sets.support_sets, chosen).any(axis=1))


def _in_sample(table: NodeTable, sets: StanceSets, chosen: IntArray) -> BoolArray:
    """Return which support sets of a table are among some of those of the sets, shape (r,).

    The order of the limbs does not matter.
    """
    points = table.points.astype(np.int64)
    rank = np.argsort(np.argsort(points, axis=1), axis=1)
    others = np.take_along_axis(sets.support_sets[sets.find(points)], rank, axis=1)
    found = np.zeros(len(table.start) - 1, dtype=np.bool_)
    found[table.support_sets[np.isin(others, chosen)]] = True
    return found


def _pairs(table: NodeTable, support_sets: IntArray) -> IntArray:
    """Return pairs of members of some support sets that share branches, shape (p, 2)."""
    found = [np.zeros((0, 2), dtype=np.int64)]
    for support_set in support_sets.tolist():
        before = NodePair.before(table, support_set)
        pairs = np.empty(
            (count_node_pairs(table, before.copy(), support_set + 1), 2), dtype=np.int64
        )
        list_node_pairs(table, before, support_set + 1, pairs)
        found.append(pairs)
    return np.concatenate(found)
