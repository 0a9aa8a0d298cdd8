"""The stance graph of two limbs in networkx and rustworkx, with the searches of these libraries.

Nodes are stances and edges are valid steps. Branches are left out, because neither library supports
labels; their problem is therefore easier, and a path may cost less than any executable walk. A
virtual node that is joined to every stance in the goal region represents the goal.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import networkx as nx
import numpy as np
import rustworkx as rx
from reports import timed

from mlivr_gym.planners import Cost
from mlivr_gym.stances import StanceGraph
from mlivr_gym.stances.step_tables import step_tables

Path = list[int]


def edge_chunks(graph: StanceGraph, cost: Cost) -> Iterator[list[tuple[int, int, float]]]:
    """Yield every valid step once, in either direction, with its cost, in chunks."""
    tables = step_tables(graph)
    stances = np.repeat(np.arange(len(graph)), np.diff(tables.start[::2]))
    for chunk in np.array_split(np.flatnonzero(stances < tables.after), 64):
        i, j = stances[chunk], tables.after[chunk]
        length = np.linalg.norm(tables.base_position[i] - tables.base_position[j], axis=1)
        costs = cost.base_weight * length + cost.step_weight
        yield list(zip(i.tolist(), j.tolist(), costs.tolist(), strict=True))


class Networkx:
    """The stance graph in networkx."""

    def __init__(self, graph: StanceGraph, cost: Cost) -> None:
        """Add every stance and every step."""
        self.graph = nx.Graph()
        self.graph.add_nodes_from(range(len(graph)))
        for chunk in edge_chunks(graph, cost):
            self.graph.add_weighted_edges_from(chunk)

    def search(self, start: int, goals: Path, h: list[float] | None) -> tuple[float, Path]:
        """Run A*, or Dijkstra if `h` is None; return the duration [s] and the path."""
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
    """The stance graph in rustworkx."""

    def __init__(self, graph: StanceGraph, cost: Cost) -> None:
        """Add every stance and every step."""
        self.graph: Any = rx.PyGraph()
        self.graph.add_nodes_from(list(range(len(graph))))
        for chunk in edge_chunks(graph, cost):
            self.graph.add_edges_from(chunk)

    def search(self, start: int, goals: Path, h: list[float] | None) -> tuple[float, Path]:
        """Run A*, or Dijkstra if `h` is None; return the duration [s] and the path."""
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
