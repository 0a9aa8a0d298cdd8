"""Every step of a stance graph of two limbs in plain arrays, for environments and experts."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.errors import SettingError
from mlivr_gym.sharing import locked
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_build import build_table, fill_rows
from mlivr_gym.stances.table_steps import steps_of_state
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_steps import gather_steps
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
        """Return the steps that leave a state of stance `s`, as `TwoLimbGraph.successors` does."""
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


_on_all_points: WeakKeyDictionary[TwoLimbGraph, StepTables] = WeakKeyDictionary()
"""Steps of graphs without obstacles and occupied points."""


@locked
def step_tables(graph: StanceGraph) -> StepTables:
    """Return the steps of a graph of two limbs among the present obstacles and occupied points.

    Steps that are not known are checked, and stored in the cache folder, see `table_build`.
    Raises a `SettingError` if the robot has more than two limbs.
    """
    if not isinstance(graph, TwoLimbGraph):
        raise SettingError(
            f"exact tables need two limbs; robot {graph.robot.name!r} has {graph.limbs}"
        )
    known = None if graph.obstacles else _on_all_points.get(graph)
    if known is not None:
        occupied = np.zeros(len(graph.grasp_map), dtype=np.bool_)
        occupied[list(graph.occupied)] = True
        return without_points(known, occupied) if graph.occupied else known
    if graph.obstacles or graph.occupied:
        fill_rows(graph)
    elif not graph.is_complete:
        build_table(graph)
    start = np.zeros(2 * len(graph) + 1, dtype=np.int64)
    most = int((graph.steps.degree**2).sum())
    after, kept = np.empty(most, dtype=np.int32), np.empty(most, dtype=np.uint16)
    gather_steps(graph.steps, start, after, kept)
    after, kept = after[: start[-1]].copy(), kept[: start[-1]].copy()
    branch_sets, releasable = (
        one.astype(np.int32) for one in (graph.branch_sets, graph.releasable)
    )
    points = graph.points.astype(np.int32)
    moving = np.repeat(np.tile([0, 1], len(points)), np.diff(start))
    to_point = points[after, moving].astype(np.uint16)
    found = StepTables(
        points, graph.base_position, branch_sets, releasable, start, after, to_point, kept
    )
    if not (graph.obstacles or graph.occupied):
        _on_all_points[graph] = found
    return found


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
