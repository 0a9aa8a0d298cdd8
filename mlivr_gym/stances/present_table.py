"""The table of a graph in the present world, whose nodes and edges are evaluated lazily.

Obstacles and occupied points only remove branches, stances and steps, and do not change the posture
of a stance. So the table without obstacles is an upper bound of what is possible among them. A
node keeps this bound until a search pops a label of it, an edge until a search pops its label (Lazy
Weighted A*: Cohen, Phillips and Likhachev 2014) or finds a path over it (LazySP: Dellin and
Srinivasa 2016). While the world only gains obstacles, what was found far from the new ones is kept.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.collisions.box_grid import BoxGrid, box_grid
from mlivr_gym.compiled.limb_branch_sets import clear_bits, packed, unpacked
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.relabelling import relabelled
from mlivr_gym.stances.checked_edges import CheckedEdges
from mlivr_gym.stances.checked_steps import CheckedSteps
from mlivr_gym.stances.graph_table import GraphTable
from mlivr_gym.stances.node_edges import (
    edge_ends,
    every_edge,
    kept_by_table,
    with_kept,
)
from mlivr_gym.stances.node_steps import node_stances
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.obstacles import OBSTACLE_CELL_EDGE, PositionCells
from mlivr_gym.transitions.steps import KEPT_CLEAR

EDGE_EFFORT, NODE_EFFORT = 250, 4
"""Expansions that take about as long as to check an edge, and a node (four limbs, obstacles)."""

NO_NODES = np.empty(0, dtype=np.bool_)
"""No nodes that a search checks."""

AT_ONCE = 4096
"""Number of edges that are checked at once where all are."""


class PresentTable:
    """Nodes and edges of a graph among the present obstacles; occupied points are left to callers.

    Attributes
    ----------
    table
        The table; nodes and edges that were checked have the branches that remain in this world.
    checked_edges
        Edges that were looked at or checked, with the branches that their supports keep at most.
    unsure
        Whether an edge from or to each node may not be known in this world before it was looked at
        or checked, shape (n,), or (0,) if every edge is known.
    is_complete
        Whether the table holds every edge exactly, so that none needs a check.
    unchecked
        Whether each node may lose branches to obstacles in a check, (n,), or (0,) if none may. A
        check of nodes changes it.
    check_effort
        Effort of all checks so far, see `EDGE_EFFORT`.
    """

    def __init__(
        self, graph: CheckedSteps, known: GraphTable, previous: PresentTable | None = None
    ) -> None:
        """Start with what is known in the present world.

        A table of an earlier world of the graph, which is not used any more then, saves time.
        """
        self.graph, self.version, self._known = graph, graph.version, known
        self._boxes = graph.obstacles
        self.table, self.check_effort, self.unchecked = known.nodes, 0, NO_NODES
        self.is_complete = known.is_exact and not graph.obstacles
        self.checked_edges = CheckedEdges.empty(len(self.table.points))
        count = 0 if known.is_exact else len(self.table.points)
        self.unsure = np.ones(count, dtype=np.bool_)
        self._changed: list[IntArray] = []
        self._cells: PositionCells | None = None
        self._is_close = self._is_at_step = np.zeros(len(self.table.points), dtype=np.bool_)
        if previous is not None and previous._known is not known:
            previous = None
        if not (graph.obstacles or not known.is_built):
            return
        if previous is not None and graph.has_all_since(previous.version):
            self._continue(previous)
        else:
            self._begin(previous)

    @property
    def is_known(self) -> bool:
        """Whether every edge is known without obstacles."""
        return self._known.is_exact

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy the graph alone, and no results of checks."""
        return type(self), (self.graph, self._known)

    def is_of(self, known: GraphTable | None) -> bool:
        """Return whether it is made from a table."""
        return self._known is known

    def _begin(self, previous: PresentTable | None) -> None:
        """Start from the world without obstacles.

        To copy the branches of all nodes takes longer than many a search, so those of another world
        are taken and those that it changed restored.
        """
        free = self._known.nodes
        names = ("branch_sets", "releasable", *(("joined",) if self._known.listed else ()))
        if previous is not None and previous.table is not free:
            self.table, self._cells = previous.table, previous._cells
            self._restore(np.concatenate([np.zeros(0, dtype=np.int64), *previous._changed]))
        else:
            self.table = free._replace(**{name: getattr(free, name).copy() for name in names})
        if self._boxes:
            self._is_close, self._is_at_step = self._around(self.graph.obstacle_grid)
            self.unchecked = self._is_close.copy()
            self.unsure = self._is_at_step if self._known.is_exact else self.unsure

    def _continue(self, previous: PresentTable) -> None:
        """Start from what was found before some obstacles were added.

        What is close to these starts anew: of two branches that a limb cannot change between, more
        obstacles may leave the other one.
        """
        if previous.table is self._known.nodes:
            self._begin(None)
        else:
            self.table, self._cells = previous.table, previous._cells
            self._changed = previous._changed
            added = box_grid(self._boxes[len(previous._boxes) :], OBSTACLE_CELL_EDGE)
            close, at_step = self._around(added)
            unchecked = previous.unchecked if len(previous.unchecked) else previous._is_close
            self._is_close, self._is_at_step = (
                previous._is_close | close,
                previous._is_at_step | at_step,
            )
            self.unchecked = unchecked | close
            self.unsure = self._is_at_step if self._known.is_exact else self.unsure
            self._restore(np.flatnonzero(close))
        self.checked_edges = previous.checked_edges.without_nodes(self.table, self._is_at_step)
        edges, kept = self.checked_edges.all_edges()
        self._block(edges, edges, kept)

    def _restore(self, rows: IntArray) -> None:
        """Let nodes have the branches, and the table the edges, of the world without obstacles."""
        free = self._known.nodes
        self.table.branch_sets[rows] = free.branch_sets[rows]
        self.table.releasable[rows] = free.releasable[rows]
        if self.table.joined is not free.joined:
            self.table.joined[...] = free.joined

    def _around(self, grid: BoxGrid | None) -> tuple[BoolArray, BoolArray]:
        """Return which nodes, and which ends of steps, may be close to obstacles, shape (n,) each.

        On a step the base is on a straight line, so half a step at most from the nearer end.
        """
        graph = self.graph
        self._cells = self._cells or PositionCells.of(self._known.nodes.base_position)
        reach = graph.robot.extent + graph.settings.clearance + KEPT_CLEAR
        for_steps = reach + 0.5 * graph.max_displacement
        return (
            graph.close_to_obstacles(self._cells, reach, grid),
            graph.close_to_obstacles(self._cells, for_steps, grid),
        )

    def check_nodes(self, rows: IntArray) -> None:
        """Remove the branches of nodes that touch obstacles, once, shape (k,)."""
        rows = np.unique(rows[self.unchecked[rows]]) if len(self.unchecked) else rows[:0]
        if not len(rows):
            return
        self.check_effort += NODE_EFFORT * len(rows)
        self.unchecked[rows] = False
        self._changed.append(rows)
        graph, none = self.graph, np.zeros((len(rows), self.graph.limbs), dtype=np.int64)
        stances = self._stances(self._known.nodes, rows, none[:, 0])
        postures = Postures(
            stances.base["position"], stances.base["rotation"], none.astype(float),
            none[:, 0].astype(float), none, stances.branch_sets.copy(), none[:, 0], none[:, 0],
        )  # fmt: skip
        graph.remove_branches_at_obstacles(stances.points, postures)
        branch_sets = packed(postures.branch_sets)
        branch_sets[~graph.is_node(postures)] = 0
        self.table.branch_sets[rows] = branch_sets
        self.table.releasable[rows] &= branch_sets

    def _stances(self, table: NodeTable, rows: IntArray, relabellings: IntArray) -> Any:
        """Return nodes as the step check reads them, see `node_stances`."""
        return node_stances(self.graph.grasp_map, self.graph.robot, table, rows, relabellings)

    def undecided(self, edges: IntArray) -> IntArray:
        """Return the edges that take time to check, ascending, each once."""
        edges = np.unique(edges[~self.checked_edges.are_exact(edges)])
        (before, _), (after, _), _ = edge_ends(self.table, edges)
        return edges[self.unsure[before] | self.unsure[after]] if len(self.unsure) else edges[:0]

    def kept(self, edges: IntArray) -> NDArray[np.uint64]:
        """Check edges once; return the branches that supports keep, as `supports_of`, shape (k,).

        What is found of their nodes is recorded in the table. No branches are kept on what is no
        step.
        """
        if self.is_complete:
            return kept_by_table(self.table, edges)
        unchecked = np.unique(edges[~self.checked_edges.are_exact(edges)])
        if len(unchecked):
            self._check(unchecked)
        return self.checked_edges.kept_on(edges)

    def look(self, edges: IntArray) -> None:
        """Look at edges that are known without obstacles, once, in a few places each."""
        edges = np.unique(edges[~self.checked_edges.contains(edges)])
        if not len(edges):
            return
        graph, (ends, back) = self.graph, self._checked_ends(edges)
        kept = kept_by_table(self.table, edges)
        at_obstacles = np.flatnonzero(self._is_at_step[ends].any(axis=0) & (kept != 0))
        steps, stances, _ = self._steps(edges[at_obstacles], kept[at_obstacles])
        world = graph.checks.world(graph.obstacle_grid, obstacles_only=True)
        graph.checks.look(steps, stances, world)
        self.check_effort += EDGE_EFFORT * len(at_obstacles)
        kept[at_obstacles] = _of_supports(steps["kept"][:, : graph.limbs], steps["limb"])
        self._record(ends, edges, back, kept, is_exact=False)

    def _check(self, edges: IntArray) -> None:
        """Check edges, shape (k,), and store the results; far from obstacles they may be known."""
        graph, (ends, back) = self.graph, self._checked_ends(edges)
        kept, some, free = kept_by_table(self.table, edges), np.arange(len(edges)), None
        if self._known.is_exact:
            some = np.flatnonzero(self._is_at_step[ends].any(axis=0) & (kept != 0))
            free = kept[some]
        steps, stances, relabellings = self._steps(edges[some], free)
        rows = np.concatenate(ends[:, some])
        known = stances.releases["known"]
        known[self._is_close[rows] | (not self._known.is_built)] = False
        before = stances.branch_sets[: len(some)]
        found = graph.branch_sets_of_steps(steps, stances, before, are_free=free is not None)
        self.check_effort += EDGE_EFFORT * len(some)
        if self.table is not self._known.nodes:
            self._record_releases(rows, relabelled(stances.releases, -relabellings))
        kept[some] &= _of_supports(found, steps["limb"])
        kept[~_is_step(kept, graph.limbs)] = 0
        self._record(ends, edges, back, kept, is_exact=True)

    def _checked_ends(self, edges: IntArray) -> tuple[IntArray, IntArray]:
        """Check the nodes of edges; return them, before and after, shape (2, k), and those back."""
        (before, _), (after, _), back = edge_ends(self.table, edges)
        self.check_nodes(np.concatenate([before, after]))
        return np.stack([before, after]), back

    def _steps(self, edges: IntArray, free: NDArray[np.uint64] | None) -> tuple[Any, Any, IntArray]:
        """Return the steps along edges, their stances and the relabellings of these, (2 k,).

        `free` has what supports keep without obstacles, if it is known.
        """
        (before, i), (after, j), _ = edge_ends(self.table, edges)
        relabellings = np.concatenate([np.zeros_like(i), j - i])
        stances = self._stances(self.table, np.concatenate([before, after]), relabellings)
        here, limbs = np.arange(len(edges)), self.graph.limbs
        steps = self.graph.checks.steps(stances, here, here + len(here))
        if free is not None:
            supports = unpacked(free, limbs - 1)
            for k in range(limbs - 1):
                steps["kept"][here, (steps["limb"] + 1 + k) % limbs] = supports[:, k]
        return steps, stances, relabellings

    def _record(
        self,
        ends: IntArray,
        edges: IntArray,
        back: IntArray,
        kept: NDArray[np.uint64],
        *,
        is_exact: bool,
    ) -> None:
        """Store what supports keep on edges and those back, exactly or at most."""
        flags = np.full(len(edges), is_exact)
        for rows, numbers in zip(ends, (edges, back), strict=True):
            self.checked_edges = self.checked_edges.with_edges(rows, numbers, kept, flags)
        self._block(edges, back, kept)

    def _record_releases(self, rows: IntArray, releases: Any) -> None:
        """Store the branches of releases that are known, rows of `ReleaseRecord`, shape (k, N)."""
        self._changed.append(rows)
        releasable = self.table.releasable
        before = unpacked(releasable[rows], self.graph.limbs)
        able = np.where(releases["known"], releases["branches"], before)
        np.bitwise_and.at(releasable, rows, packed(able))

    def _block(self, edges: IntArray, back: IntArray, kept: NDArray[np.uint64]) -> None:
        """Clear the bits of edges that are no steps, if the bits are not those of all worlds."""
        if self.table.joined is not self._known.nodes.joined:
            clear_bits(self.table.joined, np.concatenate([edges[kept == 0], back[kept == 0]]))

    def branch_sets_after(
        self, edges: IntArray, branch_sets: NDArray[np.uint64], kept: NDArray[np.uint64]
    ) -> NDArray[np.uint64]:
        """Return the branches after edges by those before them and those kept, shape (k,).

        They are 0 where there is no step.
        """
        after, limbs = np.zeros_like(branch_sets), self.table.limbs
        (start, i), (end, j), _ = edge_ends(self.table, edges)
        leaves, grasps = (unpacked(self.table.releasable[rows], limbs) for rows in (start, end))
        before, rows = unpacked(branch_sets, limbs), np.arange(len(edges))
        of_supports = relabelled(before, i + 1)[:, :-1] & unpacked(kept, limbs - 1)
        found = np.column_stack([of_supports, grasps[rows, j]])
        steps = found.all(axis=1) & (before[rows, i] & leaves[rows, i] != 0)
        after[steps] = packed(relabelled(found, -j - 1)[steps])
        return after

    def completed(self) -> NodeTable:
        """Check every edge once; return the table of this world with all of them."""
        if self.is_complete:
            return self.table
        self.check_nodes(np.arange(len(self.table.points)))
        edges = every_edge(self.table)
        for first in range(0, len(edges), AT_ONCE):
            self.kept(edges[first : first + AT_ONCE])
        return with_kept(self.table, edges, self.checked_edges.kept_on(edges))


def _of_supports(branch_sets: IntArray, limb: IntArray) -> NDArray[np.uint64]:
    """Return branch sets of all limbs, shape (k, N), as those of supports if limbs (k,) move."""
    return packed(relabelled(branch_sets, limb + 1)[:, :-1])


def _is_step(kept: NDArray[np.uint64], limbs: int) -> BoolArray:
    """Return whether each support keeps a branch, shape (k,)."""
    return np.asarray(unpacked(kept, limbs - 1).all(axis=1))
