"""Nodes of a table among obstacles: which branches are left, looked at when a walk comes there.

Obstacles only take branches, stances and steps away, and a stance keeps its posture. So the table
without obstacles bounds what is possible among them, and what a search has not yet looked at is
taken to be free.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.limb_masks import packed, unpacked
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.turns import turned
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_steps import node_stances
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.transitions.records import StanceSet


class NodesAmongObstacles:
    """The nodes of a table in the world as it is now.

    Attributes:
        table: The table; of nodes that were looked at it has the branches that obstacles leave.
    """

    def __init__(self, graph: LazyGraph, table: NodeTable) -> None:
        """Look at nothing yet."""
        self.graph, self._free, self.table = graph, table, table
        self.version = graph.version
        self._unseen = np.zeros(len(table.points), dtype=np.bool_)
        if graph.obstacles:
            masks, released = table.masks.copy(), table.released.copy()
            self.table = table._replace(masks=masks, released=released)
            self._unseen = self._close()

    def _close(self) -> BoolArray:
        """Nodes whose robot may touch an obstacle, shape (n,)."""
        reach = self.graph.robot.extent + self.graph.settings.clearance
        positions, close = self._free.base_position, self._unseen
        for box in self.graph.obstacles:
            low, high = box.bounds
            away = positions - np.clip(positions, low, high)
            close = close | (np.einsum("ij,ij->i", away, away) <= reach**2)
        return close

    def look_at(self, rows: IntArray, most: int | None = None, about: Array | None = None) -> bool:
        """Work out what obstacles leave of nodes; whether they take something of one.

        Args:
            rows: Rows of nodes, shape (k,).
            most: Most nodes that are looked at.
            about: Position to which those that are looked at are the closest [m], shape (3,).
        """
        rows = np.unique(rows[self._unseen[rows]])
        if most is not None and about is not None and len(rows) > most:
            away = self._free.base_position[rows] - about
            nearest = np.einsum("ij,ij->i", away, away)
            rows = rows[np.argpartition(nearest, most)[:most]]
        if not len(rows):
            return False
        self._unseen[rows] = False
        graph = self.graph
        stances = node_stances(
            graph.grasp_map, graph.robot, self._free, rows, np.zeros(len(rows), dtype=np.int64)
        )
        none = np.zeros((len(rows), graph.limbs), dtype=np.int64)
        postures = Postures(
            stances.base["position"], stances.base["rotation"], none.astype(float),
            none[:, 0].astype(float), none, stances.mask.copy(), none[:, 0], none[:, 0],
        )  # fmt: skip
        graph.clear_of_obstacles(np.arange(len(rows)), stances.points, postures)
        left = packed(postures.mask)
        left[~graph.is_node(postures)] = 0
        changed = left != self._free.masks[rows]
        self.table.masks[rows] = left
        self.table.released[rows] &= left
        return bool(changed.any())

    def stances(self, rows: IntArray, turns: IntArray) -> StanceSet:
        """Nodes that were looked at, the robot turned, as the checks of steps read them.

        What can be released there among obstacles is not told: the checks work it out.
        """
        graph = self.graph
        stances = node_stances(graph.grasp_map, graph.robot, self.table, rows, turns)
        if graph.obstacles:
            stances.released["known"] = False
        return stances

    def learn_released(self, rows: IntArray, turns: IntArray, stances: StanceSet) -> None:
        """Keep what the checks of steps have worked out of releases at `stances`."""
        if not self.graph.obstacles:
            return
        limbs = self.graph.limbs
        known = turned(stances.released["known"].astype(np.int64), -turns) > 0
        found = turned(stances.released["branches"].astype(np.int64), -turns)
        for row, told, branches in zip(rows.tolist(), known, found, strict=True):
            before = unpacked(self.table.released[row : row + 1], limbs)
            self.table.released[row] = packed(np.where(told, branches, before))[0]
