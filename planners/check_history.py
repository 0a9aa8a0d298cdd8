"""Where checks of edges failed and succeeded, which orders the search for a first path.

The paths that LazySP finds one after the other differ little: where one step touches an obstacle
many others do, and a new path has new edges to be checked all along. As in POMP (Choudhury, Dellin
and Srinivasa 2016) the results of earlier checks tell which edges are likely to be steps. Nodes
close to failures come later in the open queue, nodes at edges that are steps come earlier, and
these edges cost less, so that paths have few edges that are left to be checked. This changes the
order of a search alone, which must not prove anything.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.kinematics.batches import distances
from mlivr_gym.planners.checked_edges import CheckedEdges
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.label_search import SearchParameters
from mlivr_gym.planners.labels import CAPACITY, NodePath
from mlivr_gym.planners.lazy_table import LazyNodeTable, LazyTable
from mlivr_gym.planners.search_graph import Delays, SearchGraph
from mlivr_gym.stances.obstacles import CELL_EDGE

PENALTY = 0.5
"""Steps by which nodes at a failure come later."""

FAILURE_RADIUS = 0.25
"""Distance of base positions from a failure up to which nodes come later [m]."""

ADVANCE = 2.0
"""Steps by which nodes at edges that are steps come earlier."""

STEP_WEIGHT = 0.5
"""Factor on the cost of edges that are steps: most of the effort is that of edges not checked."""

STEP_LENGTH = 0.1
"""Base displacement of a typical step [m], by which base costs are compared with steps."""

LEAST_PENALTY = 0.5
"""Penalty in steps up to which a search that found no path gets more labels."""


class CheckHistory:
    """Results of the checks of one query, for n nodes."""

    def __init__(self, lazy_table: LazyTable) -> None:
        """Start without results for the nodes of a table among obstacles."""
        assert isinstance(lazy_table, LazyNodeTable)
        assert lazy_table.cells is not None
        base_position, cells = lazy_table.table.base_position, lazy_table.cells
        self._base_position = base_position
        self._centres = cells.low + CELL_EDGE / 2
        self._penalty, self._place = np.zeros(len(cells.low)), cells.cell.copy()
        self._labels = 1

    def add_failures(self, nodes: IntArray) -> None:
        """Add nodes at edges that are no steps: nodes come later, the closer the more."""
        for position in self._base_position[nodes]:
            distance = distances(self._centres, position)
            self._penalty += PENALTY * np.maximum(0.0, 1.0 - distance / FAILURE_RADIUS)

    def add_path(self, path: NodePath, checked_edges: CheckedEdges) -> None:
        """Add the edges of a path, all of which were checked."""
        is_step = checked_edges.kept_on(path.edges) != 0
        before, after = path.nodes[:-1], path.nodes[1:]
        self.add_failures(np.concatenate([before[~is_step], after[~is_step]]))
        for nodes in (before, after):
            self._place[nodes[is_step]] = len(self._penalty)

    def ordered(self, search_graph: SearchGraph, cost: Cost) -> SearchGraph:
        """Return the graph of a search for a path of least cost, with delays of nodes."""
        unit = cost.step_weight + STEP_LENGTH * cost.base_weight
        delays = Delays(self._place, unit * np.append(self._penalty, -ADVANCE), STEP_WEIGHT)
        return search_graph._replace(delays=delays)

    def limited(self, parameters: SearchParameters) -> SearchParameters:
        """Return search parameters with the limit of labels that applies now."""
        return parameters._replace(max_labels=min(self._labels * parameters.max_labels, CAPACITY))

    def relax(self) -> bool:
        """Halve what failures add, or double the limit of labels; return whether either is left."""
        if self._penalty.max(initial=0.0) > LEAST_PENALTY:
            self._penalty /= 2.0
        else:
            self._labels *= 2
        return self._labels <= CAPACITY
