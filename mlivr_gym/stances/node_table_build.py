"""Build the table of a stance graph."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.kernels import workers
from mlivr_gym.compiled.limb_branch_sets import packed
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.relabelling import is_symmetric_after_relabelling, relabelled
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.graph_table import GraphTable, ListedStances
from mlivr_gym.stances.node_edges import (
    EdgeSet,
    NodePair,
    count_node_pairs,
    list_node_pairs,
    with_edges,
)
from mlivr_gym.stances.node_steps import node_stances
from mlivr_gym.stances.node_table import Nodes, NodeTable, codes, is_exact, table_of
from mlivr_gym.stances.parts import Block, PartArrays, Parts, Progress
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.stance_sets import stance_sets
from mlivr_gym.stances.table_files import TableError
from mlivr_gym.transitions.records import ReleaseRecord
from mlivr_gym.world.grasp_map import GraspMap

STANCES_AT_ONCE = 4000
"""Number of stances that are computed at once; what a graph stores of them takes memory."""

PAIRS_AT_ONCE = 100_000
"""Number of bits whose pairs are checked at once, unless a single support set has more."""

World = tuple[GraspMap, RobotSpec, Settings]
"""Map, robot and settings, from which a graph is made."""


def build(
    graph: StanceGraph, progress: Progress | None = None, parts: Parts | None = None
) -> GraphTable:
    """Compute all nodes of a graph and the steps between them.

    It has no obstacles and no occupied points. Raises a `TableError` if the robot has more than
    four limbs, or the map too many points, and with three and four limbs if steps are not checked.
    """
    world, parts = (graph.grasp_map, graph.robot, graph.settings), parts or Parts(None)
    listed = None
    half = progress and (lambda share: progress(share / 2.0))
    if graph.lists_all:
        listed, table = _with_releases(graph, parts)
    else:
        table = _nodes(graph, world, parts, half)
    half = progress and (lambda share: progress(0.5 + share / 2.0))
    blocks = _support_set_blocks(table)
    threads = workers(len(blocks), 2)
    steps = parts.of_blocks(joined, blocks, (world, table), threads, half)
    nodes = with_edges(table, EdgeSet(*map(np.concatenate, zip(*steps, strict=True))))
    return GraphTable(nodes, listed is not None, listed)


def _with_releases(graph: StanceGraph, parts: Parts) -> tuple[ListedStances, NodeTable]:
    """Return the listed stances of a graph with their releases, and their table without edges."""
    known, points = graph.listed, graph.points
    releases = ReleaseRecord.rows(*points.shape)
    releases["branches"], releases["known"] = known.postures.branch_sets, True
    if graph.settings.transitions:
        found = parts.get("released", lambda: [graph.all_releases(points, known.postures)])
        releases = np.asarray(found[0]).view(ReleaseRecord.dtype)
    return known._replace(releases=releases), table_of_listed(
        points, known.postures, releases["branches"], releases["folds"]
    )


def table_of_listed(
    points: IntArray, postures: Postures, releasable: IntArray, folds: IntArray
) -> NodeTable:
    """Return the table of listed stances, shape (n, N), without edges."""
    nodes = Nodes(
        points, postures.base_position, postures.branch_sets, releasable, folds,
        postures.pose_number,
    )  # fmt: skip
    return table_of(nodes, is_symmetric=False)


def _nodes(graph: StanceGraph, world: World, parts: Parts, progress: Progress | None) -> NodeTable:
    """Compute all nodes that hold one of the sets of points; return their table without edges."""
    (sets,) = parts.get("sets", lambda: [_sets_of(graph)])
    each = STANCES_AT_ONCE // len(_orders(graph.robot))
    blocks = [(at, sets[at : at + each]) for at in range(0, len(sets) or 1, each)]
    threads = workers(len(blocks), 2)
    found = parts.of_blocks(nodes_of_sets, blocks, (world,), threads, progress)
    columns = [np.concatenate(column) for column in zip(*found, strict=True)]
    order = np.argsort(codes(columns[0]))
    nodes = Nodes(*(one[order] for one in columns))
    return table_of(nodes, is_symmetric_after_relabelling(graph.robot))


def _sets_of(graph: StanceGraph) -> NDArray[np.uint16]:
    """Return the sets of points that nodes of a graph hold; a `TableError` as in `build`."""
    if not graph.settings.transitions:
        raise TableError("a table of three or four limbs needs transitions=True: steps are checked")
    sets = stance_sets(graph)
    if sets is None:
        raise TableError(
            f"robot {graph.robot.name!r} has {graph.limbs} limbs on {len(graph.grasp_map)} points: "
            f"a table of nodes can be built for three or four limbs and at most 40 million sets "
            f"of points"
        )
    return sets


def _orders(robot: RobotSpec) -> IntArray:
    """Return the orders in which limbs may hold ascending points, shape (k, N)."""
    # Of cyclic relabellings the one with the lowest point first stands for all.
    alike, every = is_symmetric_after_relabelling(robot), permutations(range(robot.limbs))
    return np.array([one for one in every if not (alike and one[0])])


def nodes_of_sets(_: int, sets: NDArray[np.uint16], world: World) -> PartArrays:
    """Compute the nodes that hold some sets of points: columns of `Nodes`."""
    limbs = sets.shape[1]
    stances = sets.astype(np.int64)[:, _orders(world[1])].reshape(-1, limbs)
    graph = StanceGraph(*world)  # an empty one, since what graphs store takes memory
    postures = graph.nodes(stances)
    nodes = np.flatnonzero(graph.is_node(postures))
    stances, postures = stances[nodes], postures.take(nodes)
    releases = graph.all_releases(stances, postures)
    branches, folds = (releases[name].astype(np.int64) for name in ("branches", "folds"))
    base, branch_sets = postures.base_position, postures.branch_sets
    return stances, base, branch_sets, branches, folds, postures.pose_number


def _support_set_blocks(table: NodeTable) -> list[Block]:
    """Return the blocks of support sets whose pairs are checked at once, by first and last."""
    blocks: list[Block] = []
    at, last = 0, len(table.offset) - 1
    while at < last or not blocks:
        end = int(np.searchsorted(table.offset, table.offset[at] + PAIRS_AT_ONCE, "right")) - 1
        end = min(max(end, at + 1), last)
        blocks.append((at, end))
        at = end
    return blocks


def joined(first: int, last: int, world: World, table: NodeTable) -> PartArrays:
    """Compute the branches that steps keep for the pairs of some support sets, see `is_exact`."""
    before = NodePair.before(table, first)
    pairs = np.empty((count_node_pairs(table, before.copy(), last), 2), dtype=np.int64)
    list_node_pairs(table, before, last, pairs)
    begin, end = table.start[first], table.start[last]
    members = table.members[begin:end].astype(np.int64)
    return kept_on_pairs(StanceGraph(*world), table, members, pairs - begin)


def kept_on_pairs(
    graph: StanceGraph, table: NodeTable, members: IntArray, pairs: IntArray
) -> EdgeSet:
    """Compute the branches that steps between pairs of members, shape (p, 2), keep.

    With more limbs than `EXACT` they are what is kept at most, see `relaxed_steps`. They are the
    same on the step back.
    """
    rows, moved = np.divmod(members, graph.limbs)
    relabellings = moved if is_symmetric_after_relabelling(graph.robot) else np.zeros_like(moved)
    stances = node_stances(graph.grasp_map, graph.robot, table, rows, relabellings)
    branch_sets, (one, other) = stances.branch_sets, pairs.T
    first = (moved - relabellings + 1)[one]  # the limb after the swing limb
    shared = branch_sets[one] & branch_sets[other]
    if graph.settings.transitions:
        steps, world = graph.checks.steps(stances, one, other), graph.checks.world(None)
        work = graph.checks.check if is_exact(graph.limbs) else graph.checks.relax
        work(steps, stances, world)
        kept_by_limbs = steps["kept"][:, : graph.limbs]
    else:
        kept_by_limbs = shared
    of_supports = relabelled(kept_by_limbs, first)[:, :-1]
    kept = packed(of_supports)
    kept[~of_supports.all(axis=1)] = 0
    return EdgeSet.of(packed(relabelled(shared, first)[:, :-1]), kept)
