"""Files of the complete table of two limbs.

A table has every stance that two limbs can hold on a map and, if steps are checked, the result of
the check of every edge: the holds that it keeps, and their swings.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import ALL, BRANCHES
from mlivr_gym.compiled.kernels import threads
from mlivr_gym.postures.base_poses import bases_at
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_files import Arrays, TableFiles, check_arrays
from mlivr_gym.stances.two_limb_steps import TwoLimbEdge
from mlivr_gym.transitions.records import ReleaseRecord

COUNTS = ("considered", "reachable", "no_departure", "self", "cabin", "handrail")
"""Names of the counts of pairs of points, see `TwoLimbGraph`."""

MOST_BASE_POSES = 1 << 12
"""More than the candidate base poses of any stance."""


AT_ONCE = 1 << 16
"""Number of edges that are looked up at once."""


class TwoLimbStances(NamedTuple):
    """The n stances of a graph of two limbs."""

    points: IntArray
    """Point of each limb, in lexical order, shape (n, 2)."""
    postures: Postures
    """Their postures."""
    counts: Mapping[str, int]
    """Numbers of `COUNTS`."""
    releases: Any = None
    """What can be released, rows of `ReleaseRecord`, shape (n, 2); None if it is not known."""
    edges: Any = None
    """All steps, rows of `TwoLimbEdge` in the order of `TwoLimbTable.offset`; None if not known."""


def encode(graph: StanceGraph, stances: TwoLimbStances) -> Arrays:
    """Return a table in the arrays of a file."""
    postures = stances.postures
    both = np.column_stack([postures.w_m, postures.w_b])
    manipulability, index = np.unique(both, axis=0, return_inverse=True)
    arrays = {
        "counts": np.array([stances.counts[name] for name in COUNTS]),
        "points": stances.points.astype(np.uint16),
        "tried": postures.pose_number.astype(np.int16),
        "branch": postures.branch.astype(np.int8),
        "mask": postures.branch_sets.astype(np.uint16),
        "manipulability": manipulability,
        "manipulability_index": index.reshape(-1).astype(np.int32),
    }
    if stances.edges is not None:
        released = np.zeros(stances.releases.shape, stances.releases.dtype)  # between fields, too
        for name in released.dtype.names:
            released[name] = stances.releases[name]
        edges, edge_index = np.unique(stances.edges.view(np.uint32), return_inverse=True)
        arrays |= {
            "edges": edges.view(TwoLimbEdge.dtype),
            "edge_index": edge_index.astype(np.min_scalar_type(len(edges))),
            "released": released,
        }
    return arrays


def decode(graph: StanceGraph, arrays: Arrays) -> TwoLimbStances:
    """Check the arrays of a file, which compiled code uses as indices, and return its table."""
    points, pose_number, branch, branch_sets = (
        arrays[name].astype(np.int64) for name in ("points", "tried", "branch", "mask")
    )
    index, manipulability = arrays["manipulability_index"], arrays["manipulability"]
    n, folds = len(points), len(graph.robot.folds)
    check_arrays(
        (points, (n, 2), 0, len(graph.grasp_map)), (pose_number, (n,), 0, MOST_BASE_POSES),
        (branch, (n, 2), 0, BRANCHES), (branch_sets, (n, 2), 1, ALL + 1),
        (index, (n,), 0, len(manipulability)),
        (manipulability, (len(manipulability), 3), 0.0, np.inf),
    )  # fmt: skip
    bases = threads().submit(bases_at, graph.grasp_map, graph.robot, points, pose_number)
    edges, releases = None, arrays.get("released")
    if releases is not None:
        edges, edge_index = arrays["edges"], arrays["edge_index"]
        # NumPy writes these types without their alignment, and some files have another field name.
        edges, releases = edges.view(TwoLimbEdge.dtype), releases.copy().view(ReleaseRecord.dtype)
        check_arrays(
            (releases["root"], (n, 2), 0, folds), (releases["via"], (n, 2, BRANCHES), 0, folds),
            (releases["branches"], (n, 2), 0, ALL + 1), (releases["known"], (n, 2), 1, 2),
            (releases["folds"], (n, 2), 0, 1 << folds),
        )  # fmt: skip
        # No step leads from a stance to itself in either of its rows.
        (unknown,) = np.flatnonzero(edges["known"] != 1)
        if np.count_nonzero(edge_index == unknown) != 2 * n:
            raise ValueError
        edges = _each(edges, edge_index)
    both: Array = manipulability[index]
    position, rotation = bases.result()
    cause = np.zeros(n, dtype=np.int64)
    postures = Postures(
        position,
        rotation,
        both[:, :2].copy(),
        both[:, 2].copy(),
        branch,
        branch_sets,
        pose_number,
        cause,
    )
    counts = dict(zip(COUNTS, arrays["counts"].tolist(), strict=True))
    return TwoLimbStances(points, postures, counts, releases, edges)


def _each(edges: Any, index: NDArray[np.unsignedinteger]) -> Any:
    """Return the edges of an index, shape (e,), rows of `TwoLimbEdge`.

    As numbers, since NumPy copies records field by field, and some at a time, since it converts the
    index to numbers of 64 bits.
    """
    if index.dtype.kind != "u" or index.max(initial=0) >= len(edges):
        raise ValueError
    values, out = edges.view(np.uint32), np.empty(len(index), dtype=np.uint32)
    for first in range(0, len(index), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        np.take(values, index[some], out=out[some], mode="clip")
    return out.view(TwoLimbEdge.dtype)


TWO_LIMB_TABLES = TableFiles("pairs", 9, zipfile.ZIP_DEFLATED, encode, decode)
"""Files of complete tables of two limbs."""
