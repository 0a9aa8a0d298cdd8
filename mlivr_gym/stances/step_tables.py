"""Every step of a stance graph of two limbs in plain arrays, for environments and experts."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.limb_branch_sets import unpacked
from mlivr_gym.sharing import locked
from mlivr_gym.stances.node_edges import edge_ends, every_edge, kept_by_table
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_build import build_table
from mlivr_gym.stances.table_steps import steps_of_state
from mlivr_gym.transitions.rule import kept_on_edge
from mlivr_gym.transitions.state import State, Successors


class StepTables(NamedTuple):
    """The steps between n stances on m points; limb j moves while limb 1 - j holds.

    The steps of stance s that move limb j are the entries from `start[2 s + j]` to `start[2 s + j +
    1]`, in the order of the points that they lead to.
    """

    points: NDArray[np.int32]
    """Point that each limb of a stance holds, shape (n, 2)."""
    base_position: Array
    """Base positions [m], shape (n, 3)."""
    branch_sets: NDArray[np.int32]
    """Branches and flips on which each limb may hold, shape (n, 2)."""
    releasable: NDArray[np.int32]
    """Those on which it can be released, and may be once it has grasped, shape (n, 2)."""
    start: IntArray
    """First step of each stance and limb, shape (2 n + 1,)."""
    after: NDArray[np.int32]
    """Stance after each step, shape (e,)."""
    to_point: NDArray[np.uint16]
    """Point that the swing limb grasps, shape (e,)."""
    kept: NDArray[np.uint16]
    """Branches and flips that the support limb keeps on a step, never 0, shape (e,)."""

    def branch_sets_after(
        self, step: int, limb: int, branch_sets: tuple[int, ...]
    ) -> tuple[int, int]:
        """Return the branch sets of both limbs after a step, by its index, that moves a limb."""
        kept = int(kept_on_edge(branch_sets[1 - limb], int(self.kept[step])))
        grasped = int(self.releasable[self.after[step], limb])
        return (grasped, kept) if limb == 0 else (kept, grasped)

    def successors(self, s: int, branch_sets: tuple[int, ...]) -> Successors:
        """Return the steps that leave a state of stance `s`, as `StanceGraph.successors` does."""
        most = int(self.start[2 * s + 2] - self.start[2 * s])
        steps, kept = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
        first, count = steps_of_state(s, (branch_sets[0], branch_sets[1]), self, steps, kept)
        after, kept = self.after[steps[:count]].astype(np.int64), kept[:count]
        moving = np.zeros(count, dtype=np.int64)
        moving[first:] = 1
        both = self.releasable[after].astype(np.int64)
        both[np.arange(count), 1 - moving] = kept
        return Successors(
            moving, self.points[after, moving].astype(np.int64), self.base_position[after], both
        )


_on_all_points: WeakKeyDictionary[StanceGraph, StepTables] = WeakKeyDictionary()
"""Steps of graphs without obstacles and occupied points."""


@locked
def step_tables(graph: StanceGraph) -> StepTables:
    """Return the steps of a graph of two limbs among the present obstacles and occupied points.

    Steps that are not known are checked, and stored in the cache folder, see `table_build`.
    Raises a `SettingError` if the robot has more than two limbs.
    """
    assert graph.listed is not None
    known = None if graph.obstacles else _on_all_points.get(graph)
    occupied = np.zeros(len(graph.grasp_map), dtype=np.bool_)
    occupied[list(graph.occupied)] = True
    if known is None:
        if not (graph.obstacles or graph.occupied or graph.is_complete):
            build_table(graph)
        known = _gathered(graph.present.completed(), graph.base_position)
        if not (graph.obstacles or graph.occupied):
            _on_all_points[graph] = known
    return without_points(known, occupied) if graph.occupied else known


def _gathered(table: NodeTable, base_position: Array) -> StepTables:
    """Return the steps of a complete table of two limbs."""
    edges = every_edge(table)
    (before, moving), (after, _), _ = edge_ends(table, edges)
    kept, points = kept_by_table(table, edges), table.points.astype(np.int32)
    can_grasp = unpacked(table.branch_sets[after], 2)[np.arange(len(edges)), moving] != 0
    order = np.lexsort((points[after, moving], moving, before))
    order = order[(kept[order] != 0) & can_grasp[order]]
    counts = np.bincount(2 * before[order] + moving[order], minlength=2 * len(points))
    start = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(counts)])
    branch_sets, releasable = (
        unpacked(one, 2).astype(np.int32) for one in (table.branch_sets, table.releasable)
    )
    after, moving = after[order], moving[order]
    return StepTables(
        points, base_position, branch_sets, releasable, start, after.astype(np.int32),
        points[after, moving].astype(np.uint16), kept[order].astype(np.uint16),
    )  # fmt: skip


def without_points(tables: StepTables, occupied: BoolArray) -> StepTables:
    """Return tables without the occupied points, shape (m,); stances keep their indices."""
    gone: BoolArray = np.any(occupied[tables.points], axis=1)
    steps = np.diff(tables.start)
    keep = ~np.repeat(np.repeat(gone, 2), steps) & ~gone[tables.after]
    start = np.concatenate([[0], np.cumsum(keep)])[tables.start]
    branch_sets, releasable = (
        np.where(gone[:, None], 0, branch_set).astype(np.int32)
        for branch_set in (tables.branch_sets, tables.releasable)
    )
    return tables._replace(
        branch_sets=branch_sets,
        releasable=releasable,
        start=start,
        after=tables.after[keep],
        to_point=tables.to_point[keep],
        kept=tables.kept[keep],
    )


def state_of(tables: StepTables, s: int, branch_sets: NDArray[np.integer]) -> State:
    """Return the state of a stance index and its branch sets."""
    a, b = tables.points[s].tolist()
    return State((a, b), (int(branch_sets[0]), int(branch_sets[1])))
