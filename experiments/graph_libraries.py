"""A finished roadmap in networkx and rustworkx; the goal region is a virtual node there."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import networkx as nx
import numpy as np
import rustworkx as rx
from stopwatch import timed

from mlivr_gym.stances.pair_graph import PairGraph


def edge_chunks(graph: PairGraph) -> Iterator[list[tuple[int, int, float]]]:
    """Every undirected edge once with its length [m], a row at a time."""
    for rows, starts in zip(graph.rows, graph.row_start, strict=True):
        for begin, end in pairwise(starts):
            i, j = np.triu_indices(end - begin, 1)
            u, v = rows[begin:end][i], rows[begin:end][j]
            length = np.linalg.norm(graph.base_in_world[u] - graph.base_in_world[v], axis=1)
            yield list(zip(u.tolist(), v.tolist(), length.tolist(), strict=True))


def networkx_build(graph: PairGraph) -> nx.Graph:
    """The roadmap in networkx."""
    roadmap = nx.Graph()
    roadmap.add_nodes_from(range(len(graph)))
    for chunk in edge_chunks(graph):
        roadmap.add_weighted_edges_from(chunk)
    return roadmap


def rustworkx_build(graph: PairGraph) -> rx.PyGraph:
    """The roadmap in rustworkx."""
    roadmap = rx.PyGraph()
    roadmap.add_nodes_from(list(range(len(graph))))
    for chunk in edge_chunks(graph):
        roadmap.add_edges_from(chunk)
    return roadmap


def networkx_query(
    roadmap: nx.Graph, start: int, goals: list[int], h: list[float]
) -> tuple[float, list[int]]:
    """Seconds of the search alone, and the path without the virtual goal."""
    end = len(h) - 1
    roadmap.add_weighted_edges_from((s, end, 0.0) for s in goals)
    seconds, path = timed(lambda: nx.astar_path(roadmap, start, end, heuristic=lambda s, _: h[s]))
    roadmap.remove_node(end)
    return seconds, path[:-1]


def rustworkx_query(
    roadmap: rx.PyGraph, start: int, goals: list[int], h: list[float]
) -> tuple[float, list[int]]:
    """Seconds of the search alone, and the path without the virtual goal."""
    end = len(h) - 1
    node = roadmap.add_node(end)
    roadmap.add_edges_from([(s, node, 0.0) for s in goals])
    seconds, path = timed(
        lambda: rx.astar_shortest_path(roadmap, start, lambda s: s == end, float, h.__getitem__)
    )
    roadmap.remove_node(node)
    return seconds, list(path)[:-1]
