"""Work out all nodes of the stance graph of three or four limbs, with what a step asks of them."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import workers
from mlivr_gym.compiled.limb_masks import packed
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.turns import same_after_turns, turned, turned_frames
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_pairs import Joined, Pair, count_pairs, list_pairs, spread
from mlivr_gym.stances.node_table import Nodes, NodeTable, NodeTableError, codes, table_of
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


def build(graph: LazyGraph, progress: Progress | None = None) -> NodeTable:
    """Work out every stance that holds one of the sets of points, in processes.

    Args:
        graph: The stance graph, without obstacles and occupied points.
        progress: Called now and then with the share of the work that is done.

    Raises:
        NodeTableError: If the sets of points are not known, which are those of three or four
            limbs; if steps are not checked, or there are obstacles or occupied points.
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
    world = graph.grasp_map, graph.robot, graph.settings
    count = workers(len(sets), FEW)
    with Workers(count, STAGES, progress) as processes:
        found = processes.run(_nodes, [(world, sets.points[k::count]) for k in range(count)])
        *found, rotation = map(np.concatenate, zip(*found, strict=True))
        order = np.argsort(codes(found[0]))
        nodes = Nodes(*(one[order] for one in found))
        table = table_of(nodes)
        joined = processes.run(_joined, _shared(world, nodes, rotation[order], table, count))
    return spread(table, Joined.joint(joined))


def _shared(
    world: World, nodes: Nodes, rotation: Array, table: NodeTable, count: int
) -> list[tuple[Any, ...]]:
    """What each of some workers checks: rests with about as many pairs."""
    cuts = np.searchsorted(table.offset, table.offset[-1] * np.arange(count + 1) // count)
    return [(world, nodes, rotation, table, cuts[k], cuts[k + 1]) for k in range(count)]


def _nodes(worker: int, world: World, sets: NDArray[np.uint16]) -> tuple[Any, ...]:
    """What `Nodes` lists of those that hold some sets of points, and base rotations."""
    limbs = sets.shape[1]
    # Sets are ascending: of what turns make alike the lowest point comes first.
    alike = same_after_turns(limbs)
    orders = np.array([one for one in permutations(range(limbs)) if not (alike and one[0])])
    none = np.zeros((0, limbs), dtype=np.int64)
    found = [(none, np.zeros((0, 3)), none, none, none, none[:, 0], np.zeros((0, 3, 3)))]
    each = AT_ONCE // len(orders)
    for at in range(0, len(sets), each):
        stances = sets[at : at + each].astype(np.int64)[:, orders].reshape(-1, limbs)
        graph = _graph(world)
        postures = graph.nodes(stances)
        nodes = np.flatnonzero(graph.is_node(postures))
        stances, postures = stances[nodes], postures.take(nodes)
        released = graph.all_released(stances, postures)
        base, rotation = postures.base_position, postures.base_rotation
        folds = released["folds"].astype(np.int64)
        branches = released["branches"].astype(np.int64)
        found.append((stances, base, postures.mask, branches, folds, postures.tried, rotation))
        tell(worker, min((at + each) / len(sets), 1.0))
    return tuple(map(np.concatenate, zip(*found, strict=True)))


def _joined(
    worker: int, world: World, nodes: Nodes, rotation: Array, table: NodeTable, *rests: int
) -> Joined:
    """What steps keep at most between the pairs of `list_pairs` of rests, first to last."""
    first, last = rests
    found, at, start = [Joined.of(*np.zeros((2, 0), dtype=np.uint64))], first, table.start
    while at < last:
        end = max(int(np.searchsorted(table.offset, table.offset[at] + PAIRS, "right")) - 1, at + 1)
        end = min(end, last)
        pairs = np.empty((count_pairs(table, Pair.before(table, at), end), 2), dtype=np.int64)
        list_pairs(table, Pair.before(table, at), end, pairs)
        members = table.members[start[at] : start[end]].astype(np.int64)
        found.append(_kept(_graph(world), nodes, rotation, members, pairs - start[at]))
        at = end
        done, every = (int(table.offset[k] - table.offset[first]) for k in (at, last))
        tell(worker, done / max(every, 1))
    return Joined.joint(found)


def _kept(
    graph: LazyGraph, nodes: Nodes, rotation: Array, members: IntArray, pairs: IntArray
) -> Joined:
    """What steps between pairs of some members, shape (p, 2), keep at most: see `relaxed_steps`.

    It is what is kept on the step there or that back, in which the lines that are tried may differ.
    """
    limbs = graph.limbs
    rows, moved = np.divmod(members, limbs)
    turns = moved if same_after_turns(limbs) else np.zeros_like(moved)
    points, masks = turned(nodes.points[rows], turns), turned(nodes.masks[rows], turns)
    frames, none = turned_frames(rotation[rows], turns, limbs), np.zeros_like(points)
    postures = Postures(
        nodes.base_position[rows], frames, none.astype(float), none[:, 0].astype(float), none,
        masks, none[:, 0], none[:, 0],
    )  # fmt: skip
    stances, world = graph.checks.stances(points, postures), graph.checks.world(None)
    for name, values in (("branches", nodes.released), ("folds", nodes.folds)):
        stances.released[name] = turned(values[rows], turns)
    stances.released["known"] = True
    first = moved - turns + 1  # the limb after the one that moves

    def at_most(one: IntArray, other: IntArray) -> NDArray[np.uint64]:
        steps = graph.step_rows(stances, one, other, masks[one])
        graph.checks.may_keep(steps, stances, world)
        held = turned(steps["kept"][:, :limbs], first[one])[:, :-1]
        kept = packed(held)
        kept[~held.all(axis=1)] = 0
        return kept

    one, other = pairs.T
    shared = packed(turned(masks[one] & masks[other], first[one])[:, :-1])
    kept = at_most(one, other)
    less = np.flatnonzero(kept != shared)
    kept[less] |= at_most(other[less], one[less])
    return Joined.of(shared, kept)


def _graph(world: World) -> LazyGraph:
    """A graph that knows nothing yet: what it remembers takes memory."""
    graph = stance_graph(*world)
    assert isinstance(graph, LazyGraph)
    return graph
