"""The graph that a search over a table sees: nodes, edges checked so far, cost and order."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.planners.backward_search import MIN_COST_OUTSIDE_GOAL
from mlivr_gym.planners.checked_edges import CheckedEdges
from mlivr_gym.planners.costs import CostWeights
from mlivr_gym.planners.labels import NO_NODES
from mlivr_gym.stances.node_table import NodeTable


class Delays(NamedTuple):
    """By how much nodes come later in the open queue than `f` tells, see `check_history`.

    Costs of a search with another weight than 1 are those of its order.
    """

    place: NDArray[np.int32]
    """Place of each node, shape (n,), or (0,) if there are no delays."""
    of_place: Array
    """What is added to `h` at each place, negative for nodes that come earlier, shape (p,)."""
    weight_of_checked: float = 1.0
    """Factor on the cost of an edge that was checked."""

    def added_to(self, h: Array, nodes: IntArray) -> Array:
        """Return `h` with the delays at some nodes, shapes (n,) and (k,) -> (k,)."""
        if not len(self.place):
            return np.asarray(h[nodes])
        late = np.maximum(h[nodes] + self.of_place[self.place[nodes]], MIN_COST_OUTSIDE_GOAL)
        return np.where(h[nodes] == 0.0, 0.0, late)


NO_DELAYS = Delays(np.empty(0, dtype=np.int32), np.empty(0))
"""Delays of a search in the order of `f`."""


class SearchGraph(NamedTuple):
    """The graph of a search: nodes, edges checked so far, and the cost to minimise."""

    table: NodeTable
    """The nodes, with an upper bound of the branches kept on each edge."""
    checked_edges: CheckedEdges
    """Edges that were checked, with the branches that they keep."""
    weights: CostWeights
    """Weights of the cost."""
    delays: Delays = NO_DELAYS
    """Delays of nodes in the open queue; a search with delays proves nothing."""
    unchecked: BoolArray = NO_NODES
    """Nodes to be checked when a label of them is popped, shape (n,), or (0,) if there are none."""
