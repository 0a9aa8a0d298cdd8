"""Walks over all nodes of many limbs on which every limb that holds keeps a branch (compiled).

Steps that were checked keep what was found; the others are taken to keep what the table says they
keep at most. Without the former the least cost of such a walk never exceeds that of a plan.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_masks import (
    NO_LIMB,
    all_keep_one,
    beside,
    has_bit,
    held_beside,
    mask_of,
)
from mlivr_gym.compiled.records import Record
from mlivr_gym.planners.known_steps import KnownSteps, place_of
from mlivr_gym.planners.label_search import NO_LABEL, NO_ROOM
from mlivr_gym.planners.node_costs import degree, least_cost
from mlivr_gym.planners.pair_search import Weights
from mlivr_gym.planners.queue import Queue, first, has_room, pop, push, queue
from mlivr_gym.stances.node_pairs import lost_on, row_of
from mlivr_gym.stances.node_table import NodeTable

ROOM = 1 << 20
"""Most labels of a search."""


PAUSE = 1 << 14
"""Labels that are taken before a search looks at the clock."""

PAUSED = -3
"""In place of a label: the search is to go on."""

Steps = tuple[NodeTable, KnownSteps, Weights]
"""The nodes, the steps known of them, and what is minimised."""


class Manner(Record):
    """How walks are looked for."""

    factor: float
    """Weight of what is left, at least 1."""
    most: int
    """Most labels of a node."""
    room: int
    """Labels after which it gives up."""
    below: float
    """Cost that a walk must not reach."""
    pause: int
    """Labels that are taken before the search looks at the clock."""
    seeded: bool
    """Whether the origins are in the queue."""


class Labels(NamedTuple):
    """Labels of a search, with its queue: which nodes are reached on which branches."""

    entries: Queue
    """Cost, node, label before and bit of the step of each, see `node_pairs`."""
    masks: NDArray[np.uint64]
    """Branches that the limbs may be on, see `limb_masks`, shape (room,)."""
    previous: NDArray[np.int32]
    """Label before at the same node, shape (room,)."""
    last: NDArray[np.int32]
    """Last label of each node, shape (n,)."""

    @classmethod
    def of(cls, nodes: int) -> Labels:
        """Room for the labels of some number of nodes."""
        return cls(
            queue(ROOM),
            np.empty(ROOM, dtype=np.uint64),
            np.empty(ROOM, dtype=np.int32),
            np.empty(nodes, dtype=np.int32),
        )


class NodeWalk(NamedTuple):
    """A walk over nodes."""

    cost: float
    """What it costs."""
    origin: int
    """Which origin it begins at."""
    nodes: IntArray
    """Rows of the nodes, shape (k + 1,)."""
    bits: IntArray
    """Bits of the steps between them, shape (k,)."""
    masks: NDArray[np.uint64]
    """Branches that the limbs may be on at the nodes, shape (k + 1,)."""


class NodeOrigins(NamedTuple):
    """Where walks begin, k nodes."""

    nodes: IntArray
    """Rows, shape (k,)."""
    masks: NDArray[np.uint64]
    """Branches that the limbs may be on, shape (k,)."""
    cost: Array
    """What it cost to get there, shape (k,)."""


def cheapest_walk(
    steps: Steps,
    h: Array,
    origins: NodeOrigins,
    labels: Labels,
    manner: tuple[float, int, int],
    *,
    below: float = np.inf,
    until: float = np.inf,
) -> tuple[NodeWalk | None, float]:
    """A walk to a node of which `h` is 0.

    With factor 1 and any number of labels it is one of least cost.

    Args:
        steps: The nodes, the steps known of them, and what is minimised.
        h: Consistent lower bounds of the cost from each node, shape (n,).
        origins: Where it may begin.
        labels: Room.
        manner: The first three that `Manner` lists.
        below: Cost that it must not reach.
        until: When to give up, on the clock of `time.perf_counter`.

    Returns:
        The walk, None if none is found; and the least cost of any, as far as it was looked for
        with factor 1: infinite if there is none.
    """
    how = Manner.row()
    how["factor"], how["most"], how["room"] = manner
    how["below"], how["pause"] = below, PAUSE
    entries = labels.entries
    entries.filled["used"], entries.filled["size"] = 0, 0
    labels.last[:] = NO_LABEL
    item = PAUSED
    while item == PAUSED and time.perf_counter() < until:
        item = int(_cheapest(steps, h, how, origins, labels))
    if item == PAUSED and not how["seeded"]:
        return None, 0.0
    if item in (NO_ROOM, PAUSED):
        return None, float(entries.f[entries.heap[0]])
    if item == NO_LABEL:
        return None, below
    chain = [item]
    while entries.link[chain[-1]] >= 0:
        chain.append(int(entries.link[chain[-1]]))
    chain.reverse()
    origin, cost = -1 - int(entries.link[chain[0]]), float(entries.f[item])
    nodes, bits = entries.node[chain], entries.bits[chain[1:]]
    return NodeWalk(cost, origin, nodes, bits, labels.masks[chain]), cost


@entry
def _cheapest(
    steps: Steps,
    h: Array,
    manner: Manner,
    origins: NodeOrigins,
    labels: Labels,
) -> int:
    """The first label taken of a node of which `h` is 0, see `cheapest_walk`; or `PAUSED`."""
    table, _, _ = steps
    entries, count = labels.entries, 0
    if not manner.seeded:
        manner.seeded = True
        for k in range(len(origins.nodes)):
            s, cost = origins.nodes[k], origins.cost[k]
            if h[s] < np.inf:
                if not has_room(entries, 1):
                    return NO_ROOM
                _note(labels, s, origins.masks[k])
                push(entries, cost + manner.factor * h[s], cost, cost, s, -1 - k, -1)
    while entries.filled.size > 0:
        if count == manner.pause:
            return PAUSED
        count += 1
        here = first(entries)
        s = entries.node[here]
        if h[s] == 0.0:
            return int(here)
        if entries.filled.used >= manner.room or not has_room(entries, degree(table, s)):
            return NO_ROOM
        pop(entries)
        if not _covered(labels, s, labels.masks[here], entries.g[here], here, manner.most):
            _expand(steps, h, manner, here, labels)
    return NO_LABEL


@kernel
def _expand(
    steps: Steps,
    h: Array,
    manner: Manner,
    here: int,
    labels: Labels,
) -> None:
    """Note what steps lead to from a label."""
    table, known, weights = steps
    entries, limbs = labels.entries, table.points.shape[1]
    s, masks = entries.node[here], labels.masks[here]
    for limb in range(limbs):
        row = row_of(table, s, limb)
        if row < 0 or mask_of(masks & table.released[s], limb) == NO_LIMB:
            continue
        rest, held = table.rests[s, limb], held_beside(masks, limb, limbs)
        begin, end = int(table.start[rest]), int(table.start[rest + 1])
        for k in range(end - begin):
            if not has_bit(table.bits, row + k):
                continue
            other, moved = divmod(int(table.members[begin + k]), limbs)
            if h[other] == np.inf:
                continue
            kept = held & held_beside(table.masks[other], moved, limbs) & ~lost_on(table, row + k)
            if known.at[s]:
                place = place_of(known, row + k)
                if known.keys[place] == row + k:
                    kept &= known.kept[place]
            if not all_keep_one(kept, limbs):
                continue
            g = entries.g[here] + least_cost(table, s, other, weights)
            if not g + h[other] < manner.below:
                continue
            after = beside(kept, mask_of(table.released[other], moved), moved, limbs)
            if not _covered(labels, other, after, g, -1, manner.most):
                _note(labels, other, after)
                push(entries, g + manner.factor * h[other], g, g, other, here, row + k)


@kernel
def _note(labels: Labels, s: int, masks: np.uint64) -> None:
    """Note a label as the last of its node; its entry is made next."""
    item = labels.entries.filled.used
    labels.masks[item], labels.previous[item], labels.last[s] = masks, labels.last[s], item


@kernel
def _covered(labels: Labels, s: int, masks: np.uint64, g: float, item: int, most: int) -> bool:
    """Whether another label of a node costs no more and has all branches of a label.

    Also whether the node has its most labels, if `item`, the number of the label, is -1 for a new
    one. Of two that are equal the earlier one covers the other.
    """
    other, count = labels.last[s], 0
    while other >= 0:
        cost = labels.entries.g[other]
        earlier = item < 0 or cost < g or masks != labels.masks[other] or other < item
        if other != item and cost <= g and masks & ~labels.masks[other] == NO_LIMB and earlier:
            return True
        other, count = labels.previous[other], count + 1
    return item < 0 and count >= most
