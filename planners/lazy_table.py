"""Nodes and edges of a table in the present world, evaluated lazily.

Obstacles and occupied points only remove branches, stances and steps, and do not change the posture
of a stance. So the table without obstacles is an upper bound of what is possible among them. A
node keeps this bound until a search pops a label of it, an edge until a search pops its label (Lazy
Weighted A*: Cohen, Phillips and Likhachev 2014) or finds a path over it (LazySP: Dellin and
Srinivasa 2016).
Results are cached for further queries.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.compiled.limb_branch_sets import clear_bits, packed, unpacked
from mlivr_gym.planners.checked_edges import CheckedEdges
from mlivr_gym.planners.clock import UNLIMITED, Clock
from mlivr_gym.planners.labels import NO_NODES, NodePath
from mlivr_gym.planners.path_search import EDGE_EFFORT, NODE_EFFORT, StatePath
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.relabelling import relabelled
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.node_edges import edge_ends
from mlivr_gym.stances.node_steps import node_stances
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.obstacles import PositionCells
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph


class LazyTable(ABC):
    """Nodes and edges of a table in the present world.

    Attributes
    ----------
    table
        The table; nodes and edges that were checked have the branches that remain in this world.
    checked_edges
        Edges that were checked and keep other branches than the table tells.
    is_complete
        Whether the table holds every edge exactly, so that none needs a check.
    check_effort
        Effort of all checks so far, see `PathSearch.effort`.
    """

    is_complete: bool

    def __init__(self, graph: StanceGraph, table: NodeTable) -> None:
        """Start with no edge checked."""
        self.graph: StanceGraph = graph
        self.version, self.table, self.check_effort = graph.version, table, 0
        self.checked_edges = CheckedEdges.empty(len(table.points))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy the graph alone, and no results of checks."""
        return make_lazy_table, (self.graph,)

    @property
    def unchecked(self) -> BoolArray:
        """Whether each node may lose branches to obstacles in a check, (n,), or (0,) if none may.

        A check of nodes changes it.
        """
        return NO_NODES

    def check_nodes(self, rows: IntArray, clock: Clock = UNLIMITED) -> None:
        """Check nodes against obstacles, (k,)."""
        for piece in clock.pieces("nodes", len(rows)):
            self._check_nodes(rows[piece])

    @abstractmethod
    def _check_nodes(self, rows: IntArray) -> None:
        """Check some of these nodes at once, (k,)."""

    @abstractmethod
    def _kept(self, edges: IntArray) -> NDArray[np.uint64]:
        """Check edges once; return the branches that supports keep, as `supports_of`, shape (k,).

        What is found of their nodes is recorded in the table. No branches are kept on what is no
        step.
        """

    def _kept_at_most(self, edges: IntArray) -> NDArray[np.uint64]:
        """Return an upper bound of `_kept` that is quick to see, and `_kept` where it is known."""
        return self._kept(edges)

    def branch_sets_at_most(
        self, edges: IntArray, branch_sets: NDArray[np.uint64]
    ) -> NDArray[np.uint64]:
        """Return an upper bound of the branches that limbs may be on after edges, 0 for no step.

        The numbers of the edges, the branches before them and those after have shape (k,).
        """
        return self._after(edges, branch_sets, self._kept_at_most(edges))

    def _after(
        self, edges: IntArray, branch_sets: NDArray[np.uint64], kept: NDArray[np.uint64]
    ) -> NDArray[np.uint64]:
        """Return the branches after edges by those before them and those kept, shape (k,)."""
        after, limbs = np.zeros_like(branch_sets), self.table.limbs
        (start, i), (end, j), _ = edge_ends(self.table, edges)
        leaves, grasps = (unpacked(self.table.releasable[rows], limbs) for rows in (start, end))
        before, rows = unpacked(branch_sets, limbs), np.arange(len(edges))
        of_supports = relabelled(before, i + 1)[:, :-1] & unpacked(kept, limbs - 1)
        found = np.column_stack([of_supports, grasps[rows, j]])
        steps = found.all(axis=1) & (before[rows, i] & leaves[rows, i] != 0)
        after[steps] = packed(relabelled(found, -j - 1)[steps])
        return after

    def checked_branch_sets(self, path: NodePath, clock: Clock) -> NDArray[np.uint64] | None:
        """Check the edges of a path; return the branches that limbs may be on along it.

        The branch sets, see `limb_branch_sets`, have shape (k + 1,); they are None if a limb keeps
        no branch.
        """
        for piece in clock.pieces("edges", len(path.edges)):
            self._kept(path.edges[piece])
        found = [path.branch_sets[:1]]
        for k in range(len(path.edges)):
            edge = path.edges[k : k + 1]
            found.append(self._after(edge, found[-1], self._kept(edge)))
            if not found[-1][0]:
                return None
        return np.concatenate(found)

    def state_path(self, start: StatePath, relabelling: int, path: NodePath) -> StatePath | None:
        """Return the states of a path whose edges were checked, or None if a step fails after all.

        `start` is a path to its first node, and `relabelling` the cyclic relabelling of the limbs
        that makes its stance that of the table, whose numbers are rounded.
        """
        graph = self.graph
        (before, i), (after, j), back = edge_ends(self.table, path.edges)
        relabellings = -np.cumsum([relabelling, *(i - j).tolist()])
        points = relabelled(self.table.points[path.nodes].astype(np.int64), relabellings)
        states = graph.states_along(start.states[-1], [*map(tuple, points[1:].tolist())])
        if len(states) < len(points):
            k, none = slice(len(states) - 1, len(states)), np.zeros(1, dtype=np.uint64)
            edges = self.checked_edges.with_edges(before[k], path.edges[k], none)
            self.checked_edges = edges.with_edges(after[k], back[k], none)
            return None
        positions = graph.postures_of(states[1:]).base_position if len(states) > 1 else ()
        every = np.concatenate([start.positions, np.reshape(positions, (-1, 3))])
        return StatePath((*start.states, *states[1:]), every)


class LazyTwoLimbTable(LazyTable):
    """Table of two limbs, whose stance graph stores what was checked."""

    graph: TwoLimbGraph

    def __init__(self, graph: TwoLimbGraph) -> None:
        """Start with the nodes and edges that the graph knows."""
        super().__init__(graph, graph.table)
        self.graph, self.is_complete = graph, graph.is_table_complete
        if graph.obstacles or graph.occupied or not self.is_complete:
            joined, releasable = self.table.joined.copy(), self.table.releasable.copy()
            clear_bits(joined, graph.blocked_edges)
            self.table = self.table._replace(
                branch_sets=np.empty_like(releasable), releasable=releasable, joined=joined
            )
            self._record_nodes(slice(None))

    def _record_nodes(self, rows: slice | IntArray) -> None:
        """Copy the branches of nodes, and those on which limbs can be released if it is known."""
        steps, table = self.graph.steps, self.table
        able = np.where(steps.releases["known"][rows], steps.releases["branches"][rows], ALL)
        table.branch_sets[rows] = packed(steps.branch_sets[rows])
        table.releasable[rows] &= packed(able) & table.branch_sets[rows]

    def _check_nodes(self, rows: IntArray) -> None:
        """Check nodes against obstacles, see `LazyTable.check_nodes`."""
        self.check_effort += NODE_EFFORT * len(rows)
        if not self.is_complete:
            self.graph.node_postures(rows)
            self._record_nodes(rows)

    def _kept(self, edges: IntArray) -> NDArray[np.uint64]:
        """Check edges, see `LazyTable`."""
        self.check_effort += EDGE_EFFORT * len(edges)
        (before, limb), (end, _), back = edge_ends(self.table, edges)
        kept = self.graph.kept_branches(1 - limb, before, end).astype(np.uint64)
        self._record(before, end, edges, back, kept)
        return kept

    def _record(
        self,
        before: IntArray,
        end: IntArray,
        edges: IntArray,
        back: IntArray,
        kept: NDArray[np.uint64],
    ) -> None:
        """Record what edges and those back keep, and what was found of their nodes, shape (k,)."""
        clear_bits(self.table.joined, np.concatenate([edges[kept == 0], back[kept == 0]]))
        checked = self.checked_edges.with_edges(before, edges, kept)
        self.checked_edges = checked.with_edges(end, back, kept)
        if not self.is_complete:
            self._record_nodes(np.concatenate([before, end]))

    def _kept_at_most(self, edges: IntArray) -> NDArray[np.uint64]:
        """Look at edges once, see `LazyTable`."""
        unseen = np.unique(edges[~self.checked_edges.contains(edges)])
        if len(unseen):
            self.check_effort += EDGE_EFFORT * len(unseen)
            (before, limb), (end, _), back = edge_ends(self.table, unseen)
            kept = self.graph.kept_at_most(1 - limb, before, end).astype(np.uint64)
            self._record(before, end, unseen, back, kept)
        return self.checked_edges.kept_on(edges)


class LazyNodeTable(LazyTable):
    """Table of three or four limbs: postures, releases and steps are checked along paths."""

    graph: ImplicitGraph

    is_complete = False

    def __init__(
        self, graph: ImplicitGraph, table: NodeTable, previous: LazyNodeTable | None = None
    ) -> None:
        """Start with no node and no edge checked, with the arrays of an earlier world if given."""
        super().__init__(graph, table)
        self.graph, self._free_table, self._reduced = graph, table, table
        self.cells: PositionCells | None = None
        if previous is not None and previous._free_table is table:
            self._reduced, self.cells = previous._restored(), previous.cells
        self._changed: list[IntArray] = []
        if graph.obstacles:
            if self._reduced is table:
                branch_sets, releasable = table.branch_sets.copy(), table.releasable.copy()
                self._reduced = table._replace(branch_sets=branch_sets, releasable=releasable)
            self.table, reach = self._reduced, graph.robot.extent + graph.settings.clearance
            self.cells = self.cells or PositionCells.of(table.base_position)
            self._is_close = graph.close_cells(self.cells, reach)

    def _restored(self) -> NodeTable:
        """Return the table of another world, whose nodes have all branches again.

        To copy the branches of all nodes takes longer than many a search.
        """
        for rows in self._changed:
            self._reduced.branch_sets[rows] = self._free_table.branch_sets[rows]
            self._reduced.releasable[rows] = self._free_table.releasable[rows]
        return self._reduced

    def _may_touch(self, rows: IntArray | slice) -> BoolArray:
        """Return whether nodes are within reach of an obstacle, shape (k,)."""
        assert self.cells is not None
        return np.asarray(self._is_close[self.cells.cell[rows]])

    @cached_property
    def unchecked(self) -> BoolArray:
        """The nodes that may lose branches in a check, see `LazyTable.unchecked`."""
        return self._may_touch(slice(None)) if self.graph.obstacles else NO_NODES

    def _check_nodes(self, rows: IntArray) -> None:
        """Check nodes against obstacles, see `LazyTable.check_nodes`."""
        if not self.graph.obstacles:
            return
        rows = np.unique(rows[self.unchecked[rows]])
        if not len(rows):
            return
        self.check_effort += NODE_EFFORT * len(rows)
        self.unchecked[rows] = False
        self._changed.append(rows)
        graph, none = self.graph, np.zeros((len(rows), self.graph.limbs), dtype=np.int64)
        stances = node_stances(graph.grasp_map, graph.robot, self._free_table, rows, none[:, 0])
        postures = Postures(
            stances.base["position"], stances.base["rotation"], none.astype(float),
            none[:, 0].astype(float), none, stances.branch_sets.copy(), none[:, 0], none[:, 0],
        )  # fmt: skip
        graph.remove_branches_at_obstacles(stances.points, postures)
        branch_sets = packed(postures.branch_sets)
        branch_sets[~graph.is_node(postures)] = 0
        self.table.branch_sets[rows] = branch_sets
        self.table.releasable[rows] &= branch_sets

    def _kept(self, edges: IntArray) -> NDArray[np.uint64]:
        """Check edges in both directions, see `LazyTable`."""
        unchecked = np.unique(edges[~self.checked_edges.contains(edges)])
        if len(unchecked):
            self._check_edges(unchecked)
        return self.checked_edges.kept_on(edges)

    def _check_edges(self, edges: IntArray) -> None:
        """Check edges, shape (k,), and store the results."""
        self.check_effort += EDGE_EFFORT * len(edges)
        graph, ((before, i), (after, j), back) = self.graph, edge_ends(self.table, edges)
        rows = np.concatenate([before, after])
        self.check_nodes(rows)
        relabellings = np.concatenate([np.zeros_like(i), j - i])
        stances = node_stances(graph.grasp_map, graph.robot, self.table, rows, relabellings)
        if graph.obstacles:
            stances.releases["known"][self._may_touch(rows)] = False
        here = np.arange(len(before))
        steps = graph.checks.steps(stances, here, here + len(here))
        found = graph.branch_sets_of_steps(steps, stances, stances.branch_sets[here])
        if graph.obstacles:
            self._record_releases(rows, relabelled(stances.releases, -relabellings))
        kept = packed(relabelled(found, i + 1)[:, : graph.limbs - 1])
        self.checked_edges = self.checked_edges.with_edges(before, edges, kept).with_edges(
            after, back, kept
        )

    def _record_releases(self, rows: IntArray, releases: Array) -> None:
        """Store the branches of releases, rows of `ReleaseRecord`, shape (k, N)."""
        self._changed.append(rows)
        for row, one in zip(rows.tolist(), releases, strict=True):
            before = unpacked(self.table.releasable[row : row + 1], self.graph.limbs)
            updated = np.where(one["known"], one["branches"].astype(np.int64), before)
            self.table.releasable[row] = packed(updated)[0]


def make_lazy_table(graph: StanceGraph, previous: LazyTable | None = None) -> LazyTable | None:
    """Return the nodes of a graph in the present world, or None if the graph has no table.

    Those of an earlier world with the same table, which are not used any more then, save time.
    """
    if isinstance(graph, TwoLimbGraph):
        return LazyTwoLimbTable(graph)
    if isinstance(graph, ImplicitGraph) and graph.table is not None:
        earlier = previous if isinstance(previous, LazyNodeTable) else None
        return LazyNodeTable(graph, graph.table, earlier)
    return None
