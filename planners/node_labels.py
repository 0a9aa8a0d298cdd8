"""Walks over all nodes of many limbs on which every limb that holds keeps a branch (compiled).

Steps that were checked keep what was found; the others are taken to keep what the table says they
keep at most. Without the former the least cost of such a walk never exceeds that of a plan.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

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
from mlivr_gym.planners.node_queue import (
    NOTHING,
    NodeQueue,
    least_waiting,
    put,
    put_back,
    take,
    width_for,
)
from mlivr_gym.planners.pair_search import Weights
from mlivr_gym.stances.node_pairs import lost_on, row_of
from mlivr_gym.stances.node_table import NodeTable

ROOM = 1 << 22
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
    """Cost that a walk must not reach; once one was found its own."""
    pause: int
    """Labels that are taken before the search looks at the clock."""
    seeded: bool
    """Whether the origins are in the queue."""
    found: int
    """Label of the cheapest walk found, `NO_LABEL` without one."""


class Labels(NamedTuple):
    """Labels of a search, each an entry of its queue: which nodes are reached on which branches."""

    waiting: NodeQueue
    """The queue, with the node of each label."""
    cost: NDArray[np.float64]
    """Cost of each, shape (room,)."""
    link: NDArray[np.int32]
    """Label before on the walk, or -1 less the origin, shape (room,)."""
    bits: NDArray[np.int64]
    """Bit of the step from there, see `node_pairs`, shape (room,)."""
    masks: NDArray[np.uint64]
    """Branches that the limbs may be on, see `limb_masks`, shape (room,)."""
    previous: NDArray[np.int32]
    """Label before at the same node, shape (room,)."""
    last: NDArray[np.int32]
    """Last label of each node, shape (n,)."""

    @classmethod
    def of(cls, nodes: int) -> Labels:
        """Room for the labels of some number of nodes."""
        link, previous = (np.empty(ROOM, dtype=np.int32) for _ in range(2))
        bits, masks = np.empty(ROOM, dtype=np.int64), np.empty(ROOM, dtype=np.uint64)
        last = np.empty(nodes, dtype=np.int32)
        return cls(NodeQueue.of(ROOM), np.empty(ROOM), link, bits, masks, previous, last)

    @property
    def used(self) -> int:
        """Labels made by the last search."""
        filled: Any = self.waiting.filled
        return int(filled["used"])

    def walk_to(self, label: int) -> NodeWalk:
        """The walk that leads to a label."""
        chain = [label]
        while self.link[chain[-1]] >= 0:
            chain.append(int(self.link[chain[-1]]))
        chain.reverse()
        origin, cost = -1 - int(self.link[chain[0]]), float(self.cost[label])
        nodes = self.waiting.node[chain].astype(np.int64)
        return NodeWalk(cost, origin, nodes, self.bits[chain[1:]], self.masks[chain])


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
        The walk, None if none is found; and with factor 1 what no walk costs less than, `below`
        if none costs less than that.
    """
    how = Manner.row()
    how["factor"], how["most"], how["room"] = manner
    how["below"], how["pause"], how["found"] = below, PAUSE, NO_LABEL
    estimates = origins.cost + how["factor"] * h[origins.nodes]
    labels.waiting.empty(float(estimates.min(initial=np.inf)), width_for(steps[2]))
    labels.last[:] = NO_LABEL
    end = PAUSED
    while end == PAUSED and time.perf_counter() < until:
        end = int(_cheapest(steps, h, how, origins, labels))
    if not how["seeded"]:
        return None, 0.0
    low = float(how["below"])
    if end in (NO_ROOM, PAUSED):
        low = min(low, labels.waiting.least)
    if how["found"] == NO_LABEL:
        return None, low
    return labels.walk_to(int(how["found"])), low


@entry
def _cheapest(
    steps: Steps,
    h: Array,
    manner: Manner,
    origins: NodeOrigins,
    labels: Labels,
) -> int:
    """Go on until the cheapest label of a node of which `h` is 0 is found, see `cheapest_walk`.

    Returns:
        `NO_LABEL` at the end, or why it stopped: `NO_ROOM` or `PAUSED`.
    """
    table, _, _ = steps
    waiting, count = labels.waiting, 0
    if not manner.seeded:
        manner.seeded = True
        for k in range(len(origins.nodes)):
            s, cost = origins.nodes[k], origins.cost[k]
            if h[s] < np.inf:
                if waiting.filled.used >= len(waiting.node):
                    return NO_ROOM
                _note(labels, s, origins.masks[k], cost, -1 - k, -1)
                put(waiting, cost + manner.factor * h[s], s)
    while True:
        if count == manner.pause:
            return PAUSED
        count += 1
        here = take(waiting)
        if here == NOTHING:
            return NO_LABEL
        s, cost = int(waiting.node[here]), labels.cost[here]
        if manner.found != NO_LABEL and least_waiting(waiting) >= manner.below:
            return NO_LABEL
        if not cost + h[s] < manner.below:
            continue
        if h[s] == 0.0:
            manner.found, manner.below = here, cost
            if manner.factor > 1.0:
                return NO_LABEL
            continue
        if waiting.filled.used + degree(table, s) > min(len(waiting.node), manner.room):
            put_back(waiting, here)
            return NO_ROOM
        if not _covered(labels, s, labels.masks[here], cost, here, manner.most):
            _expand(steps, h, manner, here, labels)


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
    limbs = table.points.shape[1]
    s, masks = int(labels.waiting.node[here]), labels.masks[here]
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
            cost = labels.cost[here] + least_cost(table, s, other, weights)
            if not cost + h[other] < manner.below:
                continue
            after = beside(kept, mask_of(table.released[other], moved), moved, limbs)
            if not _covered(labels, other, after, cost, -1, manner.most):
                _note(labels, other, after, cost, here, row + k)
                put(labels.waiting, cost + manner.factor * h[other], other)


@kernel
def _note(labels: Labels, s: int, masks: np.uint64, cost: float, link: int, bit: int) -> None:
    """Note a label as the last of its node; it is put into the queue next."""
    item = labels.waiting.filled.used
    labels.masks[item], labels.cost[item] = masks, cost
    labels.link[item], labels.bits[item] = link, bit
    labels.previous[item], labels.last[s] = labels.last[s], item


@kernel
def _covered(labels: Labels, s: int, masks: np.uint64, g: float, item: int, most: int) -> bool:
    """Whether another label of a node costs no more and has all branches of a label.

    Also whether the node has its most labels, if `item`, the number of the label, is -1 for a new
    one. Of two that are equal the earlier one covers the other.
    """
    other, count = labels.last[s], 0
    while other >= 0:
        cost = labels.cost[other]
        earlier = item < 0 or cost < g or masks != labels.masks[other] or other < item
        if other != item and cost <= g and masks & ~labels.masks[other] == NO_LIMB and earlier:
            return True
        other, count = labels.previous[other], count + 1
    return item < 0 and count >= most
