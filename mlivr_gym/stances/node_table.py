"""All nodes of the stance graph of three or four limbs, once and for all.

With four limbs a node stands for those of the robot after turns, see `postures.turns`: limb 0 holds
its lowest point. Each has what a step asks before it is checked: where the base is, on which
branches the limbs may hold and be released, and which nodes are a move away. So a walk that no step
forbids is found without a posture worked out, and what is no walk there is none on the graph.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_masks import packed
from mlivr_gym.postures.turns import lowest_first, permuted_limbs, same_after_turns

RESOLUTION = 1e-12
"""Base positions are kept from the grasps' centroid as whole multiples of it [m]."""

ROUNDED = RESOLUTION
"""Farthest that a kept base position lies from the true one [m]: half a diagonal, and the rounding
of the numbers."""


class Nodes(NamedTuple):
    """What is worked out of n nodes, in the order of their codes."""

    points: IntArray
    """Point index of each limb, shape (n, N)."""
    base_position: Array
    """Base positions in the world [m], shape (n, 3)."""
    masks: IntArray
    """On which branches the limbs may hold, shape (n, N)."""
    released: IntArray
    """On which of them they can be released, shape (n, N)."""
    folds: IntArray
    """Folds among which they can change, see `Release`, shape (n, N)."""
    tried: IntArray
    """Which of the base poses tried it is, see `tried_poses`, shape (n,)."""


class NodeTable(NamedTuple):
    """The n nodes of a graph, in the order of `codes`, as compiled code reads them."""

    points: NDArray[np.uint16]
    """Point index of each limb, of four the lowest first, shape (n, N)."""
    base_position: NDArray[np.float64]
    """Base positions in the world [m], within `ROUNDED`, shape (n, 3)."""
    masks: NDArray[np.uint64]
    """On which branches the limbs may hold, see `limb_masks`, shape (n,)."""
    released: NDArray[np.uint64]
    """On which of them they can be released, shape (n,)."""
    folds: NDArray[np.uint64]
    """Folds among which they can change, shape (n,)."""
    tried: NDArray[np.uint16]
    """Which of the base poses tried it is, shape (n,)."""
    supports: NDArray[np.int32]
    """What the others hold beside each limb, in turn from it on, by number, shape (n, N).

    Where turns make a difference it is part of the number which limb that is."""
    start: NDArray[np.int32]
    """First of `members` of each such rest, and their number, shape (r + 1,)."""
    members: NDArray[np.int32]
    """Nodes that have a rest in common, which are a move apart: `row * N + limb` of those whose
    limb can be released, those of a rest one after the other, shape (m,)."""
    offset: IntArray
    """First of the bits of each rest, and their number, shape (r + 1,)."""
    bits: NDArray[np.uint64]
    """Which members of a rest a step may join, see `node_pairs`; a bit for each two of them."""
    loses_branches: NDArray[np.uint64]
    """On which of these steps limbs lose branches that both nodes have; a bit for each two."""
    ranks: NDArray[np.int32]
    """How many of those bits come before each number of `loses_branches`, shape (len(losing),)."""
    lost: NDArray[np.uint64]
    """What is lost, as `held_beside`, in the order of these bits, shape (l,)."""

    @property
    def limbs(self) -> int:
        """Number of limbs."""
        return int(self.points.shape[1])

    def find(self, stances: IntArray) -> tuple[IntArray, IntArray]:
        """Rows of stances, and the turns after which they are those of the table.

        Parameters
        ----------
        stances
            Point indices, shape (k, N).

        Returns
        -------
        tuple[IntArray, IntArray]
            Rows, -1 for what is no node, and turns, each of shape (k,).
        """
        turns = np.zeros(len(stances), dtype=np.int64)
        if same_after_turns(self.limbs):
            turns = lowest_first(stances)
        rows = np.empty(len(stances), dtype=np.int64)
        find_rows(self.points, permuted_limbs(stances, turns), rows)
        return rows, turns


@entry
def find_rows(points: NDArray[np.uint16], wanted: IntArray, rows: IntArray) -> None:
    """Rows of stances among some that are in the order of their codes, -1 for what is not there.

    Parameters
    ----------
    points
        Point indices, shape (n, N).
    wanted
        The same of what is looked for, shape (k, N).
    rows
        Filled, shape (k,).
    """
    for k in range(len(wanted)):
        low, high = 0, len(points)
        while low < high:
            middle = (low + high) // 2
            if _before(points[middle], wanted[k]):
                low = middle + 1
            else:
                high = middle
        there = low < len(points) and not _before(wanted[k], points[low])
        rows[k] = low if there else -1


@kernel
def _before(a: IntArray, b: IntArray) -> bool:
    """Whether a stance comes before another one."""
    for limb in range(len(a)):
        if a[limb] != b[limb]:
            return bool(a[limb] < b[limb])
    return False


def codes(stances: NDArray[np.uint16] | IntArray) -> NDArray[np.uint64]:
    """One number for each stance, in the order of its points from limb 0 on, (k, N) -> (k,)."""
    # Points of 16 bits each: four limbs fill a number.
    code = np.zeros(len(stances), dtype=np.uint64)
    for column in stances.T:
        code = (code << np.uint64(16)) | column.astype(np.uint64)
    return code


def table_of(nodes: Nodes) -> NodeTable:
    """The table of some nodes, of which no steps are known yet, see `node_pairs.spread`."""
    points, released = nodes.points, nodes.released
    limbs = points.shape[1]
    beside: Any = np.stack(
        [codes(np.roll(points, -k, axis=1)[:, 1:]) for k in range(limbs)], axis=1
    )
    if not same_after_turns(limbs):
        beside = beside * np.uint64(limbs) + np.arange(limbs, dtype=np.uint64)
    known, supports = np.unique(beside, return_inverse=True)
    numbers = supports.reshape(-1).astype(np.int32)
    members = np.argsort(numbers, kind="stable").astype(np.int32)
    members = members[released.reshape(-1)[members] != 0]
    start = np.searchsorted(numbers[members], np.arange(len(known) + 1)).astype(np.int32)
    sizes = np.diff(start).astype(np.int64)
    offset = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(sizes * sizes)])
    none = np.zeros(int(offset[-1]) // 64 + 1, dtype=np.uint64)
    return NodeTable(
        points=points.astype(np.uint16),
        base_position=nodes.base_position,
        masks=packed(nodes.masks),
        released=packed(released),
        folds=packed(nodes.folds),
        tried=nodes.tried.astype(np.uint16),
        supports=numbers.reshape(points.shape),
        start=start,
        members=members,
        offset=offset,
        bits=none,
        loses_branches=none,
        ranks=none[:0].astype(np.int32),
        lost=none[:0],
    )
