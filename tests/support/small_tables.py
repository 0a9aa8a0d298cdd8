"""Tables of all nodes of robots with two, three and four limbs on a few points."""

from functools import cache

import numpy as np
from shared_graphs import shared
from time_limit import AGES
from unequal_robots import unequal

from mlivr_gym import jem_map, stance_graph
from mlivr_gym.planners import SearchOptions
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.planners.table_search import TableSearch
from mlivr_gym.stances.node_table_build import build

COSTS = [("steps", None), ("base", None), ("weighted", 0.3)]
"""Costs by name and price of a regrasp [m]."""


def small_map():
    """Some points of the JEM close to each other."""
    jem = jem_map()
    near = np.flatnonzero(np.abs(jem.positions[:, 0] - 2.3) < 0.45)
    chosen = np.random.default_rng(3).choice(near, 13, replace=False)
    return jem.subset(np.isin(np.arange(len(jem)), chosen), "part")


@cache
def small_table(limbs, is_unequal=False):
    """A graph on these points of limbs that are alike or not, and the table of its nodes."""
    graph = shared(stance_graph(small_map(), unequal(limbs) if is_unequal else f"mlivr{limbs}"))
    graph.graph_table = build(graph)
    return graph, graph.table


def searching(bounds, goal, start, **options):
    """A search over the table of a graph, with a time limit that it does not reach."""
    given = SearchOptions(**{"inflation": 1.0} | options)
    search = SearchQuery.from_options(bounds.graph, goal, given, AGES)
    return TableSearch(bounds, search, start)


def every_pair(table):
    """Nodes that a step may join, and the limb of each that moves, by bits."""
    rows = []
    for rest in range(len(table.offset) - 1):
        begin, end = int(table.start[rest]), int(table.start[rest + 1])
        for k in range(end - begin):
            for m in range(end - begin):
                bit = int(table.offset[rest]) + k * (end - begin) + m
                if int(table.joined[bit // 64]) >> bit % 64 & 1:
                    a, b = (divmod(int(table.members[begin + x]), table.limbs) for x in (k, m))
                    rows.append((*a, *b, bit))
    return np.array(rows)


def goal_at(graph, table, row, cost, tolerance=0.05):
    """A goal at a node of a table; the cost is one of `COSTS`."""
    return Goal.from_arguments(graph, table.base_position[row].astype(float), *cost, tolerance)


def stop_at(share):
    """Return what interrupts a build that has come so far."""

    def progress(done):
        if done >= share:
            raise KeyboardInterrupt

    return progress
