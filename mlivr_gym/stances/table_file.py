"""Files of the tables of stance graphs.

In a compressed file all that can be derived is omitted, and different values are listed once: few
base positions and branch sets differ between nodes. To put a table together from it takes
seconds with three limbs and more, so the cache folder has it unpacked, and its arrays are mapped
into memory.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.compiled.bit_sets import ALL, BRANCHES
from mlivr_gym.compiled.limb_branch_sets import WORD, unpacked
from mlivr_gym.postures.base_poses import bases_at
from mlivr_gym.postures.postures import FIELDS, Postures
from mlivr_gym.postures.relabelling import is_symmetric_after_relabelling
from mlivr_gym.stances.checked_steps import CheckedSteps
from mlivr_gym.stances.graph_table import COUNTS, GraphTable, ListedStances
from mlivr_gym.stances.node_edges import EdgeSet, edges_of, with_edges
from mlivr_gym.stances.node_table import RESOLUTION, Nodes, NodeTable, is_exact, table_of
from mlivr_gym.stances.table_files import Arrays, TableFiles, check_arrays
from mlivr_gym.transitions.records import ReleaseRecord

MOST_BASE_POSES = 1 << 12
"""More than the candidate base poses of any stance."""


def encode(graph: CheckedSteps, table: GraphTable) -> Arrays:
    """Return a table in the arrays of a compressed file."""
    nodes = table.nodes
    branch_sets = [
        unpacked(one, nodes.limbs).astype(np.uint16)
        for one in (nodes.branch_sets, nodes.releasable, nodes.folds)
    ]
    branch_set, mask_index = _distinct(np.stack(branch_sets, axis=2).reshape(-1, 3))
    edges = edges_of(nodes)
    lost, lost_index = _distinct(edges.lost)
    increments = np.diff(nodes.points.astype(np.int32), axis=0, prepend=0)
    arrays: dict[str, NDArray[Any]] = {
        "point_increments": increments.astype(np.int16).T.copy(),
        "mask": branch_set,
        "mask_index": mask_index,
        "tried": nodes.pose_number,
        "pair_counts": np.array([len(edges.joined), len(edges.loses_branches)]),
        "joined": np.packbits(edges.joined),
        "loses_branches": np.packbits(edges.loses_branches),
        "lost": lost,
        "lost_index": lost_index,
    }
    if table.listed is not None:
        return arrays | _listed_arrays(table.listed)
    offsets = nodes.base_position - graph.grasp_map.positions[nodes.points].mean(axis=1)
    offset, offset_index = _distinct(np.rint(offsets / RESOLUTION).astype(np.int64))
    return arrays | {"base_offset": offset, "base_offset_index": offset_index}


def _listed_arrays(listed: ListedStances) -> dict[str, NDArray[Any]]:
    """Return the arrays of stances that are all listed."""
    postures, releases = listed.postures, listed.releases
    both = np.column_stack([postures.w_m, postures.w_b])
    manipulability, index = _distinct(both)
    released = np.zeros(releases.shape, releases.dtype)  # between fields, too
    for name in released.dtype.names:
        released[name] = releases[name]
    return {
        "counts": np.array([listed.counts[name] for name in COUNTS]),
        "branch": postures.branch.astype(np.int8),
        "manipulability": manipulability,
        "manipulability_index": index,
        "released": released,
    }


def _distinct(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.uint32]]:
    """Return the distinct ones of some values, and the index of each value among them."""
    distinct, index = np.unique(values, axis=0, return_inverse=True)
    return distinct, index.reshape(-1).astype(np.uint32)


def decode(graph: CheckedSteps, arrays: Arrays) -> GraphTable:
    """Check the arrays of a compressed file, which kernels use as indices, and return its table."""
    # By rows, as those that are built or mapped: compiled code serves one order.
    points = np.cumsum(arrays["point_increments"], axis=1, dtype=np.int64).T.copy()
    pose_number, n = arrays["tried"], len(arrays["tried"])
    check_arrays(
        (points, (n, graph.limbs), 0, len(graph.grasp_map)),
        (pose_number, (n,), 0, MOST_BASE_POSES),
    )
    branch_sets, releasable, folds = (
        arrays["mask"][arrays["mask_index"]].reshape(*points.shape, 3).transpose(2, 0, 1)
    )
    listed = None
    if is_exact(graph.limbs):
        listed = _listed(graph, arrays, points, branch_sets)
        base = listed.postures.base_position
    else:
        offsets = arrays["base_offset"][arrays["base_offset_index"]]
        base = graph.grasp_map.positions[points].mean(axis=1) + offsets * RESOLUTION
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
    full = with_edges(table, EdgeSet(joined, loses_branches, lost))
    return GraphTable(_checked_table(full), listed is not None, listed)


def _listed(
    graph: CheckedSteps, arrays: Arrays, points: NDArray[Any], branch_sets: NDArray[Any]
) -> ListedStances:
    """Return what is known of stances that are all listed."""
    n, folds = len(points), len(graph.robot.folds)
    manipulability, branch = arrays["manipulability"], arrays["branch"].astype(np.int64)
    index, pose_number = arrays["manipulability_index"], arrays["tried"].astype(np.int64)
    # NumPy writes this type without its alignment.
    releases = arrays["released"].copy().view(ReleaseRecord.dtype)
    shape = points.shape
    check_arrays(
        (branch, shape, 0, BRANCHES), (branch_sets, shape, 1, ALL + 1),
        (index, (n,), 0, len(manipulability)),
        (manipulability, (len(manipulability), graph.limbs + 1), 0.0, np.inf),
        (releases["root"], shape, 0, folds), (releases["via"], (*shape, BRANCHES), 0, folds),
        (releases["branches"], shape, 0, ALL + 1), (releases["known"], shape, 1, 2),
        (releases["folds"], shape, 0, 1 << folds),
    )  # fmt: skip
    w = manipulability[index]
    position, rotation = bases_at(graph.grasp_map, graph.robot, points, pose_number)
    postures = Postures(
        position, rotation, w[:, :-1].copy(), w[:, -1].copy(), branch,
        branch_sets.astype(np.int64), pose_number, np.zeros(n, dtype=np.int64),
    )  # fmt: skip
    counts = dict(zip(COUNTS, arrays["counts"].tolist(), strict=True))
    return ListedStances(postures, counts, releases)


def mapped_arrays(table: GraphTable) -> Arrays:
    """Return a table in the arrays of a file that is mapped."""
    nodes, listed = table.nodes._asdict(), table.listed
    if listed is None:
        return nodes
    known = {f"listed_{name}": getattr(listed.postures, name) for name in FIELDS}
    counts = np.array([listed.counts[name] for name in COUNTS])
    return {**nodes, **known, "listed_counts": counts, "listed_releases": listed.releases}


def table_of_mapped(arrays: Arrays) -> GraphTable:
    """Check types and shapes of mapped arrays, by their names, and return their table."""
    table = _checked_table(NodeTable(**{name: arrays[name] for name in NodeTable._fields}))
    if not is_exact(table.limbs):
        return GraphTable(table, False)
    postures = Postures(**{name: arrays[f"listed_{name}"] for name in FIELDS})
    n, limbs = table.points.shape
    releases = arrays["listed_releases"].view(ReleaseRecord.dtype)
    shapes = tuple(getattr(postures, name).shape for name in FIELDS)
    if shapes != _posture_shapes(n, limbs) or releases.shape != (n, limbs):
        raise ValueError
    counts = dict(zip(COUNTS, arrays["listed_counts"].tolist(), strict=True))
    return GraphTable(table, True, ListedStances(postures, counts, releases))


def _posture_shapes(n: int, limbs: int) -> tuple[tuple[int, ...], ...]:
    """Return the shapes of the arrays of n postures."""
    each, row = (n, limbs), (n,)
    return (n, 3), (n, 3, 3), each, row, each, each, row, row


def _checked_table(table: NodeTable) -> NodeTable:
    """Check types and shapes of the arrays of a table, and return it."""
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


TABLES = TableFiles(7, encode, decode, mapped_arrays, table_of_mapped)
"""Files of the tables of stance graphs."""
