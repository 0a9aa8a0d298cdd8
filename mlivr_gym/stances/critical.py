"""Critical points and rails of a map: those without which stances are cut off from the others."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph


class Loss(NamedTuple):
    """What a stance graph loses with a point, or with all points of a rail."""

    id: str
    """Id of the point or of the rail."""
    points: tuple[str, ...]
    """The points that are lost."""
    stances: int
    """Number of stances that hold one of them."""
    cut_off: int
    """Number of other stances that are no longer connected with most of their part."""

    @property
    def is_critical(self) -> bool:
        """Whether the loss cuts other stances off."""
        return self.cut_off > 0


@checked()
def point_losses(
    graph: TwoLimbGraph, progress: Callable[[float], None] | None = None
) -> tuple[Loss, ...]:
    """Return what the loss of each single point costs, the worst first.

    Two stances are connected by an edge of the graph, on whatever branches. If not all steps of
    the graph have been checked (see `table_build.build_table`), each unchecked one counts as an
    edge.

    Stances that obstacles or occupied points block do not count. `progress` is called with the
    finished share. The losses of all m points are ordered by the stances cut off, then by those
    lost, then in the order of the map.


    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> worst = point_losses(stance_graph("uslab"))[0]
    >>> worst.id, worst.stances, worst.is_critical
    ('deck_4:0', 214, False)
    """
    ids = graph.grasp_map.ids
    return _losses(graph, {point: [k] for k, point in enumerate(ids)}, progress)


@checked()
def rail_losses(
    graph: TwoLimbGraph, progress: Callable[[float], None] | None = None
) -> tuple[Loss, ...]:
    """Return what the loss of each rail costs, with all of its points; see `point_losses`."""
    rails: dict[str, list[int]] = {segment.id: [] for segment in graph.grasp_map.segments}
    for k, point in enumerate(graph.grasp_map.ids):
        rail = point.rpartition(":")[0]
        if rail in rails:
            rails[rail].append(k)
    return _losses(graph, {rail: points for rail, points in rails.items() if points}, progress)


def _losses(
    graph: TwoLimbGraph, lost: dict[str, list[int]], progress: Callable[[float], None] | None
) -> tuple[Loss, ...]:
    """Return the losses of sets of points, the worst first."""
    edges, free = edges_of(graph), np.asarray((graph.branch_sets > 0).all(axis=1))
    part = parts_of(edges, free)
    found = []
    for k, (name, points) in enumerate(lost.items()):
        held = free & np.isin(graph.points, points).any(axis=1)
        rest = free & ~held
        now = parts_of(edges, rest)
        # Each rest lies in one part; of the rests of a part the largest stays, the others are cut.
        _, first, size = np.unique(now[rest], return_index=True, return_counts=True)
        largest = np.zeros(part.max(initial=0) + 1, dtype=np.int64)
        np.maximum.at(largest, part[rest][first], size)
        ids = tuple(graph.grasp_map.ids[p] for p in points)
        found.append(Loss(name, ids, int(held.sum()), int(rest.sum() - largest.sum())))
        if progress is not None:
            progress((k + 1) / len(lost))
    return tuple(sorted(found, key=lambda loss: (-loss.cut_off, -loss.stances)))


def edges_of(graph: TwoLimbGraph) -> IntArray:
    """Return the edges between stances, each once, shape (2, e).

    Where all members of a support set are joined, they have edges to a row from n on instead.
    """
    table, hub = graph.table, len(graph)
    edges = [np.zeros((2, 0), dtype=np.int32)]
    bits = np.unpackbits(table.joined.view(np.uint8), bitorder="little")
    for k in range(len(table.start) - 1):
        members = table.members[table.start[k] : table.start[k + 1]] // 2
        joined = bits[table.offset[k] : table.offset[k] + len(members) ** 2]
        if joined.sum() == len(members) * (len(members) - 1):
            edges.append(np.stack([members, np.full_like(members, hub)]))
            hub += 1
        else:
            edges.append(members[np.stack(np.nonzero(np.tril(joined.reshape(len(members), -1))))])
    return np.concatenate(edges, axis=1)


def parts_of(edges: IntArray, kept: BoolArray) -> IntArray:
    """Return the connected part of each stance, shape (n,), if only those of `kept` remain."""
    size = max(len(kept), int(edges.max(initial=0)) + 1)
    stays = np.ones(size, dtype=np.bool_)
    stays[: len(kept)] = kept
    remain = edges[:, stays[edges[0]] & stays[edges[1]]]
    ones = np.ones(remain.shape[1], dtype=np.int8)
    rest = scipy.sparse.coo_array((ones, tuple(remain)), shape=(size, size))
    part: IntArray = scipy.sparse.csgraph.connected_components(rest, directed=False)[1]
    return part[: len(kept)]
