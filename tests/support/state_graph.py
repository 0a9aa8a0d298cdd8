"""All states that steps lead to, as a graph of NetworkX."""

import networkx as nx
import numpy as np


def reachable(graph, *starts, known=None):
    """States that `successors` leads to from some starts, added to those that are known.

    Nodes have the attribute `base`, where the base is [m]; edges have `base`, its displacement [m],
    and `steps`, 1.
    """
    net = nx.DiGraph() if known is None else known
    todo = [start for start in starts if start not in net]
    for start in todo:
        net.add_node(start, base=graph.posture_of(start).base_position[0])
    while todo:
        state = todo.pop()
        steps, here = graph.successors(state), net.nodes[state]["base"]
        for k, base in enumerate(steps.base_position):
            after = steps.after(state, k)
            if after not in net:
                net.add_node(after, base=base)
                todo.append(after)
            net.add_edge(state, after, base=float(np.linalg.norm(base - here)), steps=1)
    return net


def within(net, goal, radius):
    """States whose base is no farther from a goal [m]."""
    return [
        state for state, base in net.nodes(data="base") if np.linalg.norm(base - goal) <= radius
    ]


def least_cost(net, start, ends, weight="steps"):
    """Least cost from a start to one of some states by NetworkX; infinite where none is reached."""
    if weight == "steps":
        costs = nx.single_source_shortest_path_length(net, start)
    else:
        costs = nx.single_source_dijkstra_path_length(net, start, weight=weight)
    return min((costs[end] for end in ends if end in costs), default=np.inf)
