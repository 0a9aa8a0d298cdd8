"""The table of stances and steps in networkx and rustworkx, and the same searches there.

A node is a stance, an edge a step that is legal. Branches are left aside, which neither library has
a place for, so that what they solve is easier: a path may cost less than any walk that can be put
together. The goal region is a virtual node that is joined to every stance in it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import networkx as nx
import numpy as np
import rustworkx as rx
from reports import timed

from mlivr_gym.stances.pair_graph import PairGraph

Path = list[int]


def edge_chunks(graph: PairGraph) -> Iterator[list[tuple[int, int, float]]]:
    """Every legal step once, whichever way, with its length [m], a row at a time."""
    table = graph.steps
    for held, point in np.ndindex(*table.degree.shape):
        row = table.rows[held, table.row_start[held, point] : table.row_start[held, point + 1]]
        first, size = table.offset[held, point], len(row)
        kept = table.edges["kept"][first : first + size**2].reshape(size, size)
        i, j = np.nonzero(np.triu(kept))
        length = np.linalg.norm(table.base[row[i]] - table.base[row[j]], axis=1)
        yield list(zip(row[i].tolist(), row[j].tolist(), length.tolist(), strict=True))


class Networkx:
    """The table in networkx."""

    def __init__(self, graph: PairGraph) -> None:
        """Take every stance and step."""
        self.graph = nx.Graph()
        self.graph.add_nodes_from(range(len(graph)))
        for chunk in edge_chunks(graph):
            self.graph.add_weighted_edges_from(chunk)

    def search(self, start: int, goals: Path, h: list[float] | None) -> tuple[float, Path]:
        """Seconds of A*, or of Dijkstra without a heuristic, and the stances passed."""
        end = self.graph.number_of_nodes()
        self.graph.add_weighted_edges_from((s, end, 0.0) for s in goals)
        seconds, path = timed(
            lambda: (
                nx.dijkstra_path(self.graph, start, end)
                if h is None
                else nx.astar_path(self.graph, start, end, heuristic=lambda s, _: h[s])
            )
        )
        self.graph.remove_node(end)
        return seconds, path[:-1]


class Rustworkx:
    """The table in rustworkx."""

    def __init__(self, graph: PairGraph) -> None:
        """Take every stance and step."""
        self.graph: Any = rx.PyGraph()
        self.graph.add_nodes_from(list(range(len(graph))))
        for chunk in edge_chunks(graph):
            self.graph.add_edges_from(chunk)

    def search(self, start: int, goals: Path, h: list[float] | None) -> tuple[float, Path]:
        """Seconds of A*, or of Dijkstra without a heuristic, and the stances passed."""
        end = self.graph.add_node(self.graph.num_nodes())
        self.graph.add_edges_from([(s, end, 0.0) for s in goals])
        seconds, path = timed(
            lambda: (
                rx.dijkstra_shortest_paths(self.graph, start, end, weight_fn=float)[end]
                if h is None
                else rx.astar_shortest_path(self.graph, start, end.__eq__, float, h.__getitem__)
            )
        )
        self.graph.remove_node(end)
        return seconds, list(path)[:-1]


LIBRARIES = {"networkx": Networkx, "rustworkx": Rustworkx}
"""The libraries by name."""
