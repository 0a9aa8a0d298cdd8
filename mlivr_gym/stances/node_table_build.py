"""Work out all nodes of the stance graph of three or four limbs, with what a step asks of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import workers
from mlivr_gym.compiled.limb_masks import packed
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.turns import permuted_limbs, same_after_turns, turned_frames
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_pairs import EdgeSet, Pair, count_pairs, list_pairs, spread
from mlivr_gym.stances.node_table import Nodes, NodeTable, NodeTableError, codes, table_of
from mlivr_gym.stances.parts import Arrays, Parts
from mlivr_gym.stances.stance_sets import StanceSets
from mlivr_gym.stances.workers import Progress, Workers, tell
from mlivr_gym.world.grasp_map import GraspMap

FEW = 1000
"""Sets of points for which it is not worth while to start processes."""

AT_ONCE = 4000
"""Stances that are worked out at once; what a graph remembers of them takes memory."""

PAIRS = 100_000
"""Bits of rests whose pairs are checked at once, unless one rest has more."""

STAGES = 2
"""The nodes, and the steps between them."""

World = tuple[GraspMap, RobotSpec, Settings]
"""What a graph is made of."""


def build(
    graph: LazyGraph, progress: Progress | None = None, parts: Parts | None = None
) -> NodeTable:
    """Work out every stance that holds one of the sets of points, in processes.

    Parameters
    ----------
    graph
        The stance graph, without obstacles and occupied points.
    progress
        Called now and then with the share of the work that is done.
    parts
        Where what is done is kept until all is.

    Raises
    ------
    NodeTableError
        If limbs differ or are not mounted evenly; if the sets of points are not known, which are
        those of three or four limbs; if steps are not checked, or there are obstacles or occupied
        points.
    """
    if not graph.robot.is_symmetric:
        raise NodeTableError(
            "tables of nodes are built for robots whose limbs are equal and mounted evenly round a "
            f"cube; robot {graph.robot.name!r} plans without one"
        )
    sets = sets_of(graph)
    world, limbs = (graph.grasp_map, graph.robot, graph.settings), graph.limbs
    each, parts = AT_ONCE // len(_orders(limbs)), parts or Parts(None)
    sets_of_blocks = [(at, sets.points[at : at + each]) for at in range(0, len(sets), each)]
    with Workers(workers(len(sets), FEW), STAGES, progress) as processes:
        found = _in_blocks(processes, nodes_of_sets, sets_of_blocks, parts, (world,))
        none = np.zeros((0, limbs), dtype=np.int64)
        *columns, rotation = map(np.concatenate, zip(_no_node(none), *found, strict=True))
        order = np.argsort(codes(columns[0]))
        nodes = Nodes(*(one[order] for one in columns))
        table = table_of(nodes)
        shared = world, nodes, rotation[order], table
        steps = _in_blocks(processes, _joined, _rests(table), parts, shared)
    nothing = EdgeSet.of(*np.zeros((2, 0), dtype=np.uint64))
    return spread(table, EdgeSet.joint([nothing, *(EdgeSet(*one) for one in steps)]))


def sets_of(graph: LazyGraph) -> StanceSets:
    """The sets of points that nodes of a graph hold.

    Raises
    ------
    NodeTableError
        See `build`.
    """
    if not graph.settings.transitions or graph.obstacles or graph.occupied:
        raise NodeTableError(
            "nodes are worked out where steps are checked, without obstacles and occupied points"
        )
    sets = graph.sets()
    if sets is None:
        raise NodeTableError(
            f"robot {graph.robot.name!r} has {graph.limbs} limbs on {len(graph.grasp_map)} points: "
            f"nodes are worked out for three or four limbs and at most 40 million sets of points"
        )
    return sets


def parts_of_nodes(graph: LazyGraph) -> Parts:
    """What is done of the table of a graph."""
    return Parts.of(graph, __file__)


Block = tuple[int, Any]
"""A number, and sets of points or the rest at which to end."""


def _in_blocks(
    processes: Workers,
    work: Callable[..., Arrays],
    blocks: list[Block],
    parts: Parts,
    shared: tuple[Any, ...],
) -> list[Arrays]:
    """What `work` finds of each of some blocks and what they share; processes take turns."""
    count = processes.count
    given = [(work, blocks[k::count], parts, shared) for k in range(count)]
    found = processes.run(_each, given)
    return [found[k % count][k // count] for k in range(len(blocks))]


def _each(
    worker: int,
    work: Callable[..., Arrays],
    blocks: list[Block],
    parts: Parts,
    shared: tuple[Any, ...],
) -> list[Arrays]:
    """What one process finds of its blocks, each of which is a part."""
    found = []
    tell(worker, float(not blocks))  # of a process for which there is none all is done
    for k, block in enumerate(blocks, 1):
        name = f"{work.__name__.strip('_')}-{block[0]}"
        found.append(parts.get(name, partial(work, *block, *shared)))
        tell(worker, k / len(blocks))
    return found


def _orders(limbs: int) -> IntArray:
    """In which orders limbs may hold ascending points, shape (k, N)."""
    # Of what turns make alike the lowest point comes first.
    alike = same_after_turns(limbs)
    return np.array([one for one in permutations(range(limbs)) if not (alike and one[0])])


def _no_node(none: IntArray) -> tuple[NDArray[Any], ...]:
    """What `nodes_of_sets` finds of no sets of points, shape (0, N)."""
    return none, np.zeros((0, 3)), none, none, none, none[:, 0], np.zeros((0, 3, 3))


def nodes_of_sets(_: int, sets: NDArray[np.uint16], world: World) -> Arrays:
    """What `Nodes` lists of those that hold some sets of points, and base rotations."""
    limbs = sets.shape[1]
    stances = sets.astype(np.int64)[:, _orders(limbs)].reshape(-1, limbs)
    graph = _graph(world)
    postures = graph.nodes(stances)
    nodes = np.flatnonzero(graph.is_node(postures))
    stances, postures = stances[nodes], postures.take(nodes)
    released = graph.all_released(stances, postures)
    base, rotation = postures.base_position, postures.base_rotation
    folds = released["folds"].astype(np.int64)
    branches = released["branches"].astype(np.int64)
    return stances, base, postures.mask, branches, folds, postures.tried, rotation


def _rests(table: NodeTable) -> list[Block]:
    """First and last of rests that are checked at once."""
    blocks: list[Block] = []
    at, last = 0, len(table.offset) - 1
    while at < last:
        end = int(np.searchsorted(table.offset, table.offset[at] + PAIRS, "right")) - 1
        end = min(max(end, at + 1), last)
        blocks.append((at, end))
        at = end
    return blocks


def _joined(
    first: int, last: int, world: World, nodes: Nodes, rotation: Array, table: NodeTable
) -> Arrays:
    """What steps keep at most between the pairs of `list_pairs` of rests, first to last."""
    before = Pair.before(table, first)
    pairs = np.empty((count_pairs(table, before.copy(), last), 2), dtype=np.int64)
    list_pairs(table, before, last, pairs)
    begin, end = table.start[first], table.start[last]
    members = table.members[begin:end].astype(np.int64)
    return kept_at_most(_graph(world), nodes, rotation, members, pairs - begin)


def kept_at_most(
    graph: LazyGraph, nodes: Nodes, rotation: Array, members: IntArray, pairs: IntArray
) -> EdgeSet:
    """What steps between pairs of some members, shape (p, 2), keep at most: see `relaxed_steps`.

    It is what is kept on the step there or that back, in which the lines that are tried may differ.
    """
    limbs = graph.limbs
    rows, moved = np.divmod(members, limbs)
    turns = moved if same_after_turns(limbs) else np.zeros_like(moved)
    points, masks = (
        permuted_limbs(nodes.points[rows], turns),
        permuted_limbs(nodes.masks[rows], turns),
    )
    frames, none = turned_frames(rotation[rows], turns, limbs), np.zeros_like(points)
    postures = Postures(
        nodes.base_position[rows], frames, none.astype(float), none[:, 0].astype(float), none,
        masks, none[:, 0], none[:, 0],
    )  # fmt: skip
    stances, world = graph.checks.stances(points, postures), graph.checks.world(None)
    for name, values in (("branches", nodes.released), ("folds", nodes.folds)):
        stances.released[name] = permuted_limbs(values[rows], turns)
    stances.released["known"] = True
    first = moved - turns + 1  # the limb after the one that moves

    def at_most(one: IntArray, other: IntArray) -> NDArray[np.uint64]:
        steps = graph.step_rows(stances, one, other, masks[one])
        graph.checks.may_keep(steps, stances, world)
        held = permuted_limbs(steps["kept"][:, :limbs], first[one])[:, :-1]
        kept = packed(held)
        kept[~held.all(axis=1)] = 0
        return kept

    one, other = pairs.T
    shared = packed(permuted_limbs(masks[one] & masks[other], first[one])[:, :-1])
    kept = at_most(one, other)
    less = np.flatnonzero(kept != shared)
    kept[less] |= at_most(other[less], one[less])
    return EdgeSet.of(shared, kept)


def _graph(world: World) -> LazyGraph:
    """A graph that knows nothing yet: what it remembers takes memory."""
    graph = stance_graph(*world)
    assert isinstance(graph, LazyGraph)
    return graph
