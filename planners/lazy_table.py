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
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.node_edges import edge_ends
from mlivr_gym.stances.node_steps import node_stances
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.obstacles import PositionCells
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.transitions.state import State

Members = tuple[IntArray, IntArray]
"""Rows of nodes and the limb of each that moves, shape (k,)."""


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
    label_independent
        Whether the branches kept on an edge do not depend on the label of the path.
    check_effort
        Effort of all checks so far, see `PathSearch.effort`.
    """

    is_complete: bool
    label_independent: bool

    def __init__(self, graph: StanceGraph, table: NodeTable) -> None:
        """Start with no edge checked."""
        self.version, self.table, self.check_effort = graph.version, table, 0
        self.checked_edges = CheckedEdges.empty(len(table.points))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy the graph alone, and no results of checks."""
        return make_lazy_table, (vars(self)["graph"],)

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
    def branch_sets_after(
        self, edges: IntArray, branch_sets: NDArray[np.uint64]
    ) -> NDArray[np.uint64]:
        """Check edges; return the branches that limbs may be on after them, 0 for no step.

        The numbers of the edges, the branches before them and those after have shape (k,).
        """

    def checked_branch_sets(self, path: NodePath, clock: Clock) -> NDArray[np.uint64] | None:
        """Check the edges of a path; return the branches that limbs may be on along it.

        The branch sets, see `limb_branch_sets`, have shape (k + 1,); they are None if a limb keeps
        no branch.
        """
        return path.branch_sets

    @abstractmethod
    def state_path(
        self, start: StatePath, relabelling: int, node_path: NodePath
    ) -> StatePath | None:
        """Return the states of a path whose edges were checked, or None if a step fails after all.

        `start` is a path to the first node of `node_path`, and `relabelling` the cyclic relabelling
        of the limbs that makes its stance that of the table.
        """


class LazyTwoLimbTable(LazyTable):
    """Table of two limbs, whose stance graph stores what was checked."""

    label_independent = True

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

    def branch_sets_after(
        self, edges: IntArray, branch_sets: NDArray[np.uint64]
    ) -> NDArray[np.uint64]:
        """Check edges, see `LazyTable.branch_sets_after`."""
        self.check_effort += EDGE_EFFORT * len(edges)
        (before, limb), (end, _), reverse = edge_ends(self.table, edges)
        kept, rows = self.graph.kept_branches(1 - limb, before, end), np.arange(len(edges))
        clear_bits(self.table.joined, np.concatenate([edges[kept == 0], reverse[kept == 0]]))
        self._record_nodes(np.concatenate([before, end]))
        found, leaves, grasps = (
            unpacked(one, 2)
            for one in (branch_sets, self.table.releasable[before], self.table.releasable[end])
        )
        can_leave = found[rows, limb] & leaves[rows, limb] != 0
        found[rows, 1 - limb] &= kept
        found[rows, limb] = grasps[rows, limb]
        after = packed(found)
        after[~can_leave | ~found.all(axis=1)] = 0
        return after

    def state_path(
        self, start: StatePath, relabelling: int, node_path: NodePath
    ) -> StatePath | None:
        """Return the states of a path, see `LazyTable.state_path`."""
        points, branch_sets = (
            self.table.points[node_path.nodes[1:]],
            unpacked(node_path.branch_sets[1:], 2),
        )
        states = zip(map(tuple, points.tolist()), map(tuple, branch_sets.tolist()), strict=True)
        positions = np.concatenate([start.positions, self.table.base_position[node_path.nodes[1:]]])
        return StatePath((*start.states, *(State(*one) for one in states)), positions)


class LazyNodeTable(LazyTable):
    """Table of three or four limbs: postures, releases and steps are checked along paths."""

    is_complete = label_independent = False

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

    def check_edges(self, edges: IntArray) -> None:
        """Check those edges that were not checked yet, in both directions."""
        unchecked = np.unique(edges[~self.checked_edges.contains(edges)])
        if not len(unchecked):
            return
        (before, i), (after, j), reverse = edge_ends(self.table, unchecked)
        found = self._check((before, i), (after, j), self.table.branch_sets[before], True)
        kept = packed(relabelled(found, i + 1)[:, : self.graph.limbs - 1])
        kept[~found.all(axis=1)] = 0
        self.checked_edges = self.checked_edges.with_edges(before, unchecked, kept).with_edges(
            after, reverse, kept
        )

    def checked_branch_sets(self, path: NodePath, clock: Clock) -> NDArray[np.uint64] | None:
        """Check the edges of a path, see `LazyTable.checked_branch_sets`."""
        for piece in clock.pieces("edges", len(path.edges)):
            self.check_edges(path.edges[piece])
        table, limbs = self.table, self.table.limbs
        (before, i), (after, j), _ = edge_ends(table, path.edges)
        kept = unpacked(self.checked_edges.kept_on(path.edges), limbs - 1)
        leaves, grasps = (unpacked(table.releasable[rows], limbs) for rows in (before, after))
        branch_sets = [unpacked(path.branch_sets[:1], limbs)[0]]
        for k in range(len(path.edges)):
            of_supports = np.roll(branch_sets[-1], -i[k] - 1)[:-1] & kept[k]
            if not of_supports.all() or not branch_sets[-1][i[k]] & leaves[k, i[k]]:
                return None
            branch_sets.append(np.roll(np.append(of_supports, grasps[k, j[k]]), j[k] + 1))
        return packed(np.array(branch_sets)) if branch_sets[-1].all() else None

    def branch_sets_after(
        self, edges: IntArray, branch_sets: NDArray[np.uint64]
    ) -> NDArray[np.uint64]:
        """Check edges for given labels, see `LazyTable.branch_sets_after`."""
        kept = np.zeros(len(edges), dtype=np.uint64)
        (before, i), (after, j), _ = edge_ends(self.table, edges)
        self.check_nodes(np.concatenate([before, after]))
        some = np.flatnonzero(self.table.branch_sets[after] != 0)
        if len(some):
            ends = (before[some], i[some]), (after[some], j[some])
            found = self._check(*ends, branch_sets[some], False)
            found[~found.all(axis=1)] = 0
            kept[some] = packed(relabelled(found, (i - j)[some]))
        return kept

    def _check(
        self, start: Members, end: Members, branch_sets: NDArray[np.uint64], record: bool
    ) -> IntArray:
        """Return the branch sets after edges with those before them, shape (k, N); 0 for no step.

        The limbs are those of the nodes before the edges. With `record`, releases that are computed
        among obstacles are stored.
        """
        self.check_effort += EDGE_EFFORT * len(branch_sets)
        graph, (before, i), (after, j) = self.graph, start, end
        rows = np.concatenate([before, after])
        relabellings = np.concatenate([np.zeros_like(i), j - i])
        stances = node_stances(graph.grasp_map, graph.robot, self.table, rows, relabellings)
        if graph.obstacles:
            stances.releases["known"][self._may_touch(rows)] = False
        here = np.arange(len(before))
        limbs_before = unpacked(branch_sets, graph.limbs)
        steps = graph.checks.steps(stances, here, here + len(here), limbs_before)
        found = graph.branch_sets_of_steps(steps, stances)
        if graph.obstacles and record:
            self._record_releases(rows, relabelled(stances.releases, -relabellings))
        return found

    def _record_releases(self, rows: IntArray, releases: Array) -> None:
        """Store the branches of releases, rows of `ReleaseRecord`, shape (k, N)."""
        self._changed.append(rows)
        for row, one in zip(rows.tolist(), releases, strict=True):
            before = unpacked(self.table.releasable[row : row + 1], self.graph.limbs)
            updated = np.where(one["known"], one["branches"].astype(np.int64), before)
            self.table.releasable[row] = packed(updated)[0]

    def state_path(
        self, start: StatePath, relabelling: int, node_path: NodePath
    ) -> StatePath | None:
        """Check every step for the labels of the path, see `LazyTable.state_path`."""
        graph = self.graph
        (before, i), (after, j), reverse = edge_ends(self.table, node_path.edges)
        relabellings = -np.cumsum([relabelling, *(i - j).tolist()])
        stances = relabelled(self.table.points[node_path.nodes].astype(np.int64), relabellings)
        branch_sets = relabelled(unpacked(node_path.branch_sets, graph.limbs), relabellings)
        followed = graph.nodes(stances[1:])
        postures = join(graph.posture_of(start.states[-1]), followed)
        after_steps = branch_sets_along(graph, stances, branch_sets, postures)
        impossible = np.flatnonzero(~after_steps.all(axis=1))
        if len(impossible):
            none = np.zeros(len(impossible), dtype=np.uint64)
            self.checked_edges = self.checked_edges.with_edges(
                before[impossible], node_path.edges[impossible], none
            )
            self.checked_edges = self.checked_edges.with_edges(
                after[impossible], reverse[impossible], none
            )
            return None
        states = zip(
            map(tuple, stances[1:].tolist()), map(tuple, branch_sets[1:].tolist()), strict=True
        )
        positions = np.concatenate([start.positions, followed.base_position])
        return StatePath((*start.states, *(State(*one) for one in states)), positions)


def branch_sets_along(
    graph: ImplicitGraph, stances: IntArray, branch_sets: IntArray, postures: Postures
) -> IntArray:
    """Return the branch sets after the k steps of a path, 0 for no step, shape (k, N).

    The table may have them for the robot after a cyclic relabelling of its limbs, for which a few
    steps keep other branches, see `relabelling`. From the first step with other branch sets on, the
    steps are checked anew, and `branch_sets`, shape (k + 1, N), is changed to those found.
    """
    begin, count = 0, len(stances) - 1
    found = np.zeros_like(branch_sets[1:])
    while begin < count:
        rows = np.arange(begin, count)
        states = [
            State(tuple(s), tuple(m))
            for s, m in zip(stances[rows].tolist(), branch_sets[rows].tolist(), strict=True)
        ]
        found[begin:] = graph.branch_sets_after(
            states, postures.take(rows), np.arange(len(rows)), stances[rows + 1],
            postures.take(rows + 1),
        )  # fmt: skip
        other = np.flatnonzero((found[begin:] != branch_sets[begin + 1 :]).any(axis=1))
        if not len(other) or not found[begin:].all():
            break
        begin += int(other[0]) + 1
        branch_sets[begin] = found[begin - 1]
    return found


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
