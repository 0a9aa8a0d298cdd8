"""Nodes and edges of a table in the present world, evaluated when a walk uses them.

Obstacles and occupied points only remove branches, stances and steps, and do not change the posture
of a stance. So the table without obstacles is an upper bound of what is possible among them, and
edges are assumed free until a walk uses them: lazy edge evaluation (Dellin and Srinivasa, ICAPS
2016). Results are cached for further queries.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.limb_masks import clear_bits, packed, unpacked
from mlivr_gym.planners.checked_edges import CheckedEdges
from mlivr_gym.planners.labels import NodeWalk
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.turns import permuted_limbs
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_pairs import edge_ends
from mlivr_gym.stances.node_steps import node_stances
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State


class StatePath(NamedTuple):
    """A walk of K states whose steps were checked."""

    states: tuple[State, ...]
    """The states."""
    positions: Array
    """Base positions in them [m], shape (K, 3)."""


class LazyTable(ABC):
    """Nodes and edges of a table in the present world.

    Attributes
    ----------
    table
        The table; nodes and edges that were checked have the branches that remain in this world.
    checked_edges
        Edges that were checked.
    is_complete
        Whether the table holds every edge exactly, so that none needs a check.
    label_independent
        Whether the branches kept on an edge do not depend on the label of the walk.
    """

    is_complete: bool
    label_independent: bool

    def __init__(self, graph: StanceGraph, table: NodeTable) -> None:
        """Start with no edge checked."""
        self.version, self.table = graph.version, table
        self.checked_edges = CheckedEdges.empty(len(table.points))

    def unchecked(self, edges: IntArray) -> IntArray:
        """Return the edges of some that were not checked, each once."""
        return np.asarray(np.unique(edges[~self.checked_edges.contains(edges)]))

    def check_nodes(
        self, rows: IntArray, limit: int | None = None, centre: Array | None = None
    ) -> bool:
        """Check nodes against obstacles; return whether one of them loses branches.

        Parameters
        ----------
        rows
            Rows of nodes, shape (k,).
        limit
            Maximum number of nodes to check.
        centre
            Position [m], shape (3,); the nodes closest to it are checked first.
        """
        return False

    @abstractmethod
    def check_edges(self, edges: IntArray) -> None:
        """Check those edges that were not checked yet."""

    @abstractmethod
    def masks_after(self, edges: IntArray, masks: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Check edges; return the branches that limbs may be on after them, 0 for no step.

        Parameters
        ----------
        edges
            Bits of the edges, shape (k,).
        masks
            Branches that the limbs may be on before them, shape (k,).
        """

    @abstractmethod
    def state_path(self, start: StatePath, turn: int, node_walk: NodeWalk) -> StatePath | None:
        """Return the states of a walk whose edges were checked, or None if a step fails after all.

        Parameters
        ----------
        start
            Path to the first node of the walk.
        turn
            Cyclic relabelling of the limbs that makes its stance that of the table.
        node_walk
            The walk over nodes.
        """


class LazyPairTable(LazyTable):
    """Table of two limbs, whose stance graph stores the nodes and edges itself."""

    label_independent = True

    def __init__(self, graph: PairGraph) -> None:
        """Start with the nodes and edges that the graph knows."""
        super().__init__(graph, graph.table)
        self.graph, self.is_complete = graph, graph.table_complete
        if graph.obstacles or graph.occupied or not self.is_complete:
            masks = packed(graph.mask)
            released = self.table.released & masks
            bits = self.table.bits.copy()
            self.table = self.table._replace(masks=masks, released=released, bits=bits)
            if not self.is_complete and graph.settings.transitions:
                self._record_releases(np.flatnonzero(graph.steps.released["known"].all(axis=1)))

    def _record_releases(self, rows: IntArray) -> None:
        """Copy the branches on which limbs can be released from the graph."""
        self.table.released[rows] = packed(self.graph.releasable[rows].astype(np.int64))

    def check_edges(self, edges: IntArray) -> None:
        """Check those edges that were not checked yet, in both directions."""
        unchecked = self.unchecked(edges)
        if self.is_complete or not len(unchecked):
            return
        (before, limb), (after, _), reverse = edge_ends(self.table, unchecked)
        held = 1 - limb
        kept = self.graph.edge_masks(held, before, after).astype(np.uint64)
        self.checked_edges = self.checked_edges.with_edges(before, unchecked, kept).with_edges(
            after, reverse, kept
        )
        clear_bits(self.table.bits, np.concatenate([unchecked, reverse])[np.tile(kept == 0, 2)])
        self._record_releases(np.concatenate([before, after]))

    def masks_after(self, edges: IntArray, masks: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Check edges, see `LazyTable.masks_after`."""
        self.check_edges(edges)
        (before, limb), (end, _), _ = edge_ends(self.table, edges)
        rows = np.arange(len(edges))
        found, leaves, grasps = (
            unpacked(one, 2)
            for one in (masks, self.table.released[before], self.table.released[end])
        )
        can_leave = found[rows, limb] & leaves[rows, limb] != 0
        found[rows, 1 - limb] &= self.checked_edges.kept_on(edges).astype(np.int64)
        found[rows, limb] = grasps[rows, limb]
        after = packed(found)
        after[~can_leave | ~found.all(axis=1)] = 0
        return after

    def state_path(self, start: StatePath, turn: int, node_walk: NodeWalk) -> StatePath | None:
        """Return the states of a walk, see `LazyTable.state_path`."""
        points, masks = self.table.points[node_walk.nodes[1:]], unpacked(node_walk.masks[1:], 2)
        states = zip(map(tuple, points.tolist()), map(tuple, masks.tolist()), strict=True)
        positions = np.concatenate([start.positions, self.table.base_position[node_walk.nodes[1:]]])
        return StatePath((*start.states, *(State(*one) for one in states)), positions)


class LazyNodeTable(LazyTable):
    """Table of three or four limbs: postures, releases and steps are checked along walks."""

    is_complete = label_independent = False

    def __init__(self, graph: LazyGraph, table: NodeTable) -> None:
        """Start with no node and no edge checked."""
        super().__init__(graph, table)
        self.graph, self._free_table = graph, table
        self._unchecked = np.zeros(len(table.points), dtype=np.bool_)
        if graph.obstacles:
            masks, released = table.masks.copy(), table.released.copy()
            self.table = table._replace(masks=masks, released=released)
            reach = graph.robot.extent + graph.settings.clearance
            self._may_touch = graph.close_to_obstacles(table.base_position, reach)
            self._unchecked = self._may_touch.copy()

    def check_nodes(
        self, rows: IntArray, limit: int | None = None, centre: Array | None = None
    ) -> bool:
        """Check nodes against obstacles, see `LazyTable.check_nodes`."""
        rows = np.unique(rows[self._unchecked[rows]])
        if limit is not None and centre is not None and len(rows) > limit:
            offset = self._free_table.base_position[rows] - centre
            rows = rows[np.argpartition(np.einsum("ij,ij->i", offset, offset), limit)[:limit]]
        if not len(rows):
            return False
        self._unchecked[rows] = False
        graph, none = self.graph, np.zeros((len(rows), self.graph.limbs), dtype=np.int64)
        stances = node_stances(graph.grasp_map, graph.robot, self._free_table, rows, none[:, 0])
        postures = Postures(
            stances.base["position"], stances.base["rotation"], none.astype(float),
            none[:, 0].astype(float), none, stances.mask.copy(), none[:, 0], none[:, 0],
        )  # fmt: skip
        graph.clear_of_obstacles(np.arange(len(rows)), stances.points, postures)
        masks = packed(postures.mask)
        masks[~graph.is_node(postures)] = 0
        self.table.masks[rows] = masks
        self.table.released[rows] &= masks
        return bool((masks != self._free_table.masks[rows]).any())

    def check_edges(self, edges: IntArray) -> None:
        """Check those edges that were not checked yet, in both directions."""
        graph, unchecked = self.graph, self.unchecked(edges)
        if not len(unchecked):
            return
        (before, i), (after, j), reverse = edge_ends(self.table, unchecked)
        rows, turns = np.concatenate([before, after]), np.concatenate([np.zeros_like(i), j - i])
        stances = node_stances(graph.grasp_map, graph.robot, self.table, rows, turns)
        if graph.obstacles:
            stances.released["known"][self._may_touch[rows]] = False
        here = np.arange(len(unchecked))
        steps = graph.step_rows(stances, here, here + len(unchecked), stances.mask[here])
        found = graph.masks_of_steps(steps, stances)
        if graph.obstacles:
            self._record_releases(rows, permuted_limbs(stances.released, -turns))
        kept = packed(permuted_limbs(found, i + 1)[:, : graph.limbs - 1])
        kept[~found.all(axis=1)] = 0
        self.checked_edges = self.checked_edges.with_edges(before, unchecked, kept).with_edges(
            after, reverse, kept
        )

    def masks_after(self, edges: IntArray, masks: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Check edges for given labels, see `LazyTable.masks_after`."""
        graph, kept = self.graph, np.zeros(len(edges), dtype=np.uint64)
        (before, i), (after, j), _ = edge_ends(self.table, edges)
        self.check_nodes(np.concatenate([before, after]))
        some = np.flatnonzero(self.table.masks[after] != 0)
        if not len(some):
            return kept
        before, i, after, j = before[some], i[some], after[some], j[some]
        rows, turns = np.concatenate([before, after]), np.concatenate([np.zeros_like(i), j - i])
        stances = node_stances(graph.grasp_map, graph.robot, self.table, rows, turns)
        if graph.obstacles:
            stances.released["known"][self._may_touch[rows]] = False
        here = np.arange(len(some))
        masks_before = unpacked(masks[some], graph.limbs)
        steps = graph.step_rows(stances, here, here + len(some), masks_before)
        found = graph.masks_of_steps(steps, stances)
        found[~found.all(axis=1)] = 0
        kept[some] = packed(permuted_limbs(found, i - j))
        return kept

    def _record_releases(self, rows: IntArray, released: Array) -> None:
        """Store the branches on which limbs can be released, records of `Release`, shape (k, N)."""
        for row, one in zip(rows.tolist(), released, strict=True):
            before = unpacked(self.table.released[row : row + 1], self.graph.limbs)
            updated = np.where(one["known"], one["branches"].astype(np.int64), before)
            self.table.released[row] = packed(updated)[0]

    def state_path(self, start: StatePath, turn: int, node_walk: NodeWalk) -> StatePath | None:
        """Check every step for the labels of the walk, see `LazyTable.state_path`."""
        graph = self.graph
        (before, i), (after, j), reverse = edge_ends(self.table, node_walk.edges)
        turns = -np.cumsum([turn, *(i - j).tolist()])
        stances = permuted_limbs(self.table.points[node_walk.nodes].astype(np.int64), turns)
        masks = permuted_limbs(unpacked(node_walk.masks, graph.limbs), turns)
        followed = graph.nodes(stances[1:])
        postures = join(graph.posture_of(start.states[-1]), followed)
        after_steps = masks_along(graph, stances, masks, postures)
        impossible = np.flatnonzero(~after_steps.all(axis=1))
        if len(impossible):
            none = np.zeros(len(impossible), dtype=np.uint64)
            self.checked_edges = self.checked_edges.with_edges(
                before[impossible], node_walk.edges[impossible], none
            )
            self.checked_edges = self.checked_edges.with_edges(
                after[impossible], reverse[impossible], none
            )
            return None
        states = zip(map(tuple, stances[1:].tolist()), map(tuple, masks[1:].tolist()), strict=True)
        positions = np.concatenate([start.positions, followed.base_position])
        return StatePath((*start.states, *(State(*one) for one in states)), positions)


def masks_along(
    graph: LazyGraph, stances: IntArray, masks: IntArray, postures: Postures
) -> IntArray:
    """Return the masks after the steps of a walk, 0 for no step, shape (k, N).

    The table may have them for the robot after a cyclic relabelling of its limbs, for which a few
    steps differ. From the first step with other masks on, the steps are checked anew.

    Parameters
    ----------
    graph
        The stance graph.
    stances
        The k + 1 stances.
    masks
        Their masks by the table, shape (k + 1, N); replaced by the checked ones.
    postures
        Their postures.
    """
    begin, count = 0, len(stances) - 1
    found = np.zeros_like(masks[1:])
    while begin < count:
        rows = np.arange(begin, count)
        states = [
            State(tuple(s), tuple(m))
            for s, m in zip(stances[rows].tolist(), masks[rows].tolist(), strict=True)
        ]
        found[begin:] = graph.masks_after(
            states, postures.take(rows), np.arange(len(rows)), stances[rows + 1],
            postures.take(rows + 1),
        )  # fmt: skip
        other = np.flatnonzero((found[begin:] != masks[begin + 1 :]).any(axis=1))
        if not len(other) or not found[begin:].all():
            break
        begin += int(other[0]) + 1
        masks[begin] = found[begin - 1]
    return found


def make_lazy_table(graph: StanceGraph) -> LazyTable | None:
    """Return the nodes of a graph in the present world, or None if the graph has no table."""
    if isinstance(graph, PairGraph):
        return LazyPairTable(graph)
    if isinstance(graph, LazyGraph) and graph.table is not None:
        return LazyNodeTable(graph, graph.table)
    return None
