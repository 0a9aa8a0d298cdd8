"""Table of the nodes and edges of a stance graph, as searches read it, for two to four limbs.

With four limbs that are alike a node stands for all cyclic relabellings of them, see
`postures.relabelling`: limb 0 holds its lowest point. Each node has what the search needs before it
checks an edge: the base position, the branches on which limbs may hold and be released, and the
edges to other nodes with an upper bound of the branches kept along each. So a path is searched
without computing postures, and every path of the graph is one over the table.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_branch_sets import packed
from mlivr_gym.postures.relabelling import is_symmetric_after_relabelling, lowest_first, relabelled
from mlivr_gym.robot.specification import RobotSpec

RESOLUTION = 1e-12
"""Unit in which files have base positions, from the centroid of the grasps [m]."""

ROUNDED = RESOLUTION
"""Largest distance of a base position of a table from the true one [m]: half a diagonal of the
unit, and rounding."""


EXACT = 2
"""Largest number of limbs for which all stances of a map are listed, and each edge is checked; with
more limbs there are too many, and tables have upper bounds."""


def is_exact(limbs: int) -> bool:
    """Return whether the tables of robots with some number of limbs are exact, see `EXACT`."""
    return limbs <= EXACT


class Nodes(NamedTuple):
    """Results for n nodes, in the order of their codes."""

    points: IntArray
    """Point index of each limb, shape (n, N)."""
    base_position: Array
    """Base positions in the world [m], shape (n, 3)."""
    branch_sets: IntArray
    """Branches on which the limbs may hold, shape (n, N)."""
    releasable: IntArray
    """Branches on which they can be released, shape (n, N)."""
    folds: IntArray
    """Folds between which they can change, see `ReleaseRecord`, shape (n, N)."""
    pose_number: IntArray
    """Number of the candidate base pose, see `candidate_poses`, shape (n,)."""


class NodeTable(NamedTuple):
    """The n nodes of a graph, in the order of `codes`, as compiled code reads them.

    A support set is the points that the other limbs hold while one moves; nodes with a common
    support set differ by one move.
    """

    points: NDArray[np.uint16]
    """Point index of each limb, with four that are alike the lowest first, shape (n, N)."""
    base_position: NDArray[np.float64]
    """Base positions in the world [m], within `ROUNDED` if stances are not listed, shape (n, 3)."""
    branch_sets: NDArray[np.uint64]
    """Branches on which the limbs may hold, see `limb_branch_sets`, shape (n,)."""
    releasable: NDArray[np.uint64]
    """Branches on which they can be released, shape (n,)."""
    folds: NDArray[np.uint64]
    """Folds between which they can change, shape (n,)."""
    pose_number: NDArray[np.uint16]
    """Number of the candidate base pose, shape (n,)."""
    support_sets: NDArray[np.int32]
    """Number of the support set if each limb moves, shape (n, N). Its points are in cyclic order of
    the limbs from that limb on; if relabelling makes a difference, the limb is part of the
    number."""
    start: NDArray[np.int32]
    """Start of each support set in `members`, and the end of all, shape (r + 1,)."""
    members: NDArray[np.int32]
    """Nodes by support set, `row * N + limb`, shape (start[-1],); only if the limb can be
    released."""
    offset: IntArray
    """Start of each support set in the bits of `joined`, and the end of all, shape (r + 1,)."""
    joined: NDArray[np.uint64]
    """Whether an edge leads from one member of a support set to another, a bit for each ordered
    pair, see `node_edges`."""
    loses_branches: NDArray[np.uint64]
    """Whether limbs lose on the edge some of the branches that both nodes have, a bit for each
    ordered pair."""
    ranks: NDArray[np.int32]
    """Number of bits set before each word of `loses_branches`, shape (len(loses_branches),)."""
    lost: NDArray[np.uint64]
    """Branches that are lost, as `supports_of`, in the order of the bits set, shape (l,)."""

    @property
    def limbs(self) -> int:
        """Number of limbs."""
        return int(self.points.shape[1])

    def find(self, stances: IntArray, robot: RobotSpec) -> tuple[IntArray, IntArray]:
        """Find the rows of stances, and the relabellings that lead to the nodes of the table.

        Stances have shape (k, N). The rows, -1 for a stance that is no node, and the cyclic
        relabellings have shape (k,) each.
        """
        relabellings = np.zeros(len(stances), dtype=np.int64)
        if is_symmetric_after_relabelling(robot):
            relabellings = lowest_first(stances)
        rows = np.empty(len(stances), dtype=np.int64)
        find_rows(self.points, relabelled(stances, relabellings), rows)
        return rows, relabellings


@entry
def find_rows(points: NDArray[np.uint16], stances: IntArray, rows: IntArray) -> None:
    """Find the rows of stances (k, N) in points (n, N), in the order of codes; -1 for none."""
    for k in range(len(stances)):
        low, high = 0, len(points)
        while low < high:
            middle = (low + high) // 2
            if _before(points[middle], stances[k]):
                low = middle + 1
            else:
                high = middle
        found = low < len(points) and not _before(stances[k], points[low])
        rows[k] = low if found else -1


@kernel
def _before(a: IntArray, b: IntArray) -> bool:
    """Return whether a stance comes before another one."""
    for limb in range(len(a)):
        if a[limb] != b[limb]:
            return bool(a[limb] < b[limb])
    return False


def codes(stances: NDArray[np.uint16] | IntArray) -> NDArray[np.uint64]:
    """Return one number for each stance, in the order of its points, shape (k, N) -> (k,)."""
    # With 16 bits for each point, four limbs fill a number.
    code = np.zeros(len(stances), dtype=np.uint64)
    for column in stances.T:
        code = (code << np.uint64(16)) | column.astype(np.uint64)
    return code


def longest_step(table: NodeTable) -> float:
    """Return the largest base displacement between two nodes with a common support set [m]."""
    longest = 0.0
    for column in table.support_sets.T:
        order = np.argsort(column, kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(column[order])) + 1):
            base = table.base_position[group]
            away = base[:, None] - base
            longest = max(longest, float(np.einsum("ijk,ijk->ij", away, away).max()))
    return float(np.sqrt(longest))


def connected_parts(table: NodeTable) -> IntArray:
    """Return the connected component of each node if all steps were possible, shape (n,)."""
    n, limbs = table.points.shape
    rows = np.repeat(np.arange(n), limbs)
    sets = n + table.support_sets.ravel()
    size = n + int(table.support_sets.max(initial=0)) + 1
    pairs = scipy.sparse.coo_array((np.ones(len(rows)), (rows, sets)), shape=(size, size))
    _, component = scipy.sparse.csgraph.connected_components(pairs, directed=False)
    return np.asarray(component[:n])


def table_of(nodes: Nodes, is_symmetric: bool) -> NodeTable:
    """Return the table of some nodes without edges, which `node_edges.with_edges` adds.

    Whether nodes stand for all cyclic relabellings is `is_symmetric_after_relabelling`.
    """
    points, releasable = nodes.points, nodes.releasable
    limbs = points.shape[1]
    after_move: Any = np.stack(
        [codes(np.roll(points, -k, axis=1)[:, 1:]) for k in range(limbs)], axis=1
    )
    if not is_symmetric:
        after_move = after_move * np.uint64(limbs) + np.arange(limbs, dtype=np.uint64)
    known, support_sets = np.unique(after_move, return_inverse=True)
    numbers = support_sets.reshape(-1).astype(np.int32)
    members = np.argsort(numbers, kind="stable").astype(np.int32)
    members = members[releasable.reshape(-1)[members] != 0]
    start = np.searchsorted(numbers[members], np.arange(len(known) + 1)).astype(np.int32)
    sizes = np.diff(start).astype(np.int64)
    offset = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(sizes * sizes)])
    none = np.zeros(int(offset[-1]) // 64 + 1, dtype=np.uint64)
    return NodeTable(
        points=points.astype(np.uint16),
        base_position=nodes.base_position,
        branch_sets=packed(nodes.branch_sets),
        releasable=packed(releasable),
        folds=packed(nodes.folds),
        pose_number=nodes.pose_number.astype(np.uint16),
        support_sets=numbers.reshape(points.shape),
        start=start,
        members=members,
        offset=offset,
        joined=none,
        loses_branches=none,
        ranks=none[:0].astype(np.int32),
        lost=none[:0],
    )
