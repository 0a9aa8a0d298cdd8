"""Files of the tables of nodes of three and four limbs.

In a compressed file all that can be derived is omitted, and different values are listed once: few
base positions and branch sets differ between nodes. To put a table together from it takes
seconds, so the cache folder has it unpacked, and its arrays are mapped into memory.
"""

from __future__ import annotations

import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.compiled.limb_branch_sets import WORD, unpacked
from mlivr_gym.postures.relabelling import is_symmetric_after_relabelling
from mlivr_gym.stances.node_edges import EdgeSet, edges_of, with_edges
from mlivr_gym.stances.node_table import RESOLUTION, Nodes, NodeTable, table_of
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_files import Arrays, TableFiles, check_arrays
from mlivr_gym.stances.two_limb_table_file import MOST_BASE_POSES


def encode(graph: StanceGraph, table: NodeTable) -> Arrays:
    """Return a table in the arrays of a compressed file."""
    branch_sets = [
        unpacked(one, table.limbs).astype(np.uint16)
        for one in (table.branch_sets, table.releasable, table.folds)
    ]
    offsets = table.base_position - graph.grasp_map.positions[table.points].mean(axis=1)
    offset, offset_index = _distinct(np.rint(offsets / RESOLUTION).astype(np.int64))
    branch_set, mask_index = _distinct(np.stack(branch_sets, axis=2).reshape(-1, 3))
    edges = edges_of(table)
    lost, lost_index = _distinct(edges.lost)
    increments = np.diff(table.points.astype(np.int32), axis=0, prepend=0)
    return {
        "point_increments": increments.astype(np.int16).T.copy(),
        "base_offset": offset,
        "base_offset_index": offset_index,
        "mask": branch_set,
        "mask_index": mask_index,
        "tried": table.pose_number,
        "pair_counts": np.array([len(edges.joined), len(edges.loses_branches)]),
        "joined": np.packbits(edges.joined),
        "loses_branches": np.packbits(edges.loses_branches),
        "lost": lost,
        "lost_index": lost_index,
    }


def _distinct(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.uint32]]:
    """Return the distinct ones of some values, and the index of each value among them."""
    distinct, index = np.unique(values, axis=0, return_inverse=True)
    return distinct, index.reshape(-1).astype(np.uint32)


def decode(graph: StanceGraph, arrays: Arrays) -> NodeTable:
    """Check the arrays of a compressed file and return its table."""
    points = np.cumsum(arrays["point_increments"].T, axis=0, dtype=np.int64)
    pose_number, n = arrays["tried"], len(arrays["tried"])
    check_arrays(
        (points, (n, graph.limbs), 0, len(graph.grasp_map)),
        (pose_number, (n,), 0, MOST_BASE_POSES),
    )
    offsets = arrays["base_offset"][arrays["base_offset_index"]]
    base = graph.grasp_map.positions[points].mean(axis=1) + offsets * RESOLUTION
    branch_sets, releasable, folds = (
        arrays["mask"][arrays["mask_index"]].reshape(*points.shape, 3).transpose(2, 0, 1)
    )
    table = table_of(
        Nodes(points, base, branch_sets, releasable, folds, pose_number),
        is_symmetric_after_relabelling(graph.robot),
    )
    joined, loses_branches = (
        np.unpackbits(arrays[name], count=count).view(np.bool_)
        for name, count in zip(
            ("joined", "loses_branches"), arrays["pair_counts"].tolist(), strict=True
        )
    )
    lost = arrays["lost"][arrays["lost_index"]]
    return table_of_arrays(with_edges(table, EdgeSet(joined, loses_branches, lost))._asdict())


def table_of_arrays(arrays: Arrays) -> NodeTable:
    """Check types and shapes of arrays, by their names, and return their table."""
    table = NodeTable(**arrays)
    (n, limbs), rows, words = table.points.shape, len(table.start), len(table.joined)
    expected: Any = (
        (np.uint16, (n, limbs)), (np.float64, (n, 3)), (np.uint64, (n,)), (np.uint64, (n,)),
        (np.uint64, (n,)), (np.uint16, (n,)), (np.int32, (n, limbs)), (np.int32, (rows,)),
        (np.int32, (table.start[-1],)), (np.int64, (rows,)), (np.uint64, (words,)),
        (np.uint64, (words,)), (np.int32, (words,)), (np.uint64, (len(table.lost),)),
    )  # fmt: skip
    types = tuple((one.dtype, one.shape) for one in table)
    if types != expected or words != table.offset[-1] // WORD + 1:
        raise ValueError
    return table


NODE_TABLES = TableFiles(
    "nodes",
    6,
    zipfile.ZIP_LZMA,
    encode,
    decode,
    (NodeTable._asdict, table_of_arrays),
    is_shared=True,
)
"""Files of tables of nodes."""
