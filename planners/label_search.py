"""The cheapest walk over a roadmap on which every limb that holds keeps a branch (compiled).

A robot that comes to a stance may be on some branches of each limb only, by the steps that it took;
so a stance is entered once for each set of masks that no cheaper way there covers: a label.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.planners.queue import Queue, first, has_room, pop, push, queue
from mlivr_gym.transitions.rule import can_release, kept_on_edge

ROOM = 1 << 17
"""Most labels of a search."""

NO_LABEL, NO_ROOM = -1, -2
"""What a search ends with that found nothing: no walk, or too many labels."""


class Roads(NamedTuple):
    """Steps between n stances, in both directions, by the stance that they leave.

    There are millions, so numbers are small: memory that is used first costs more than all else.
    """

    start: NDArray[np.int32]
    """First step of each stance, and their number, shape (n + 1,)."""
    other: NDArray[np.int32]
    """Stance after each step, shape (e,)."""
    limb: NDArray[np.uint8]
    """Limb that it moves, shape (e,)."""
    turn: NDArray[np.uint8]
    """Turn that puts the limbs in the places that they have at the stance after it, shape (e,)."""
    kept: NDArray[np.uint16]
    """Masks that limbs keep that hold; of the one that moves those it may be on then, (e, N).

    The limbs are those of the stance before.
    """
    released: NDArray[np.uint16]
    """Masks on which each limb can be released at each stance, shape (n, N)."""


class Origins(NamedTuple):
    """K stances at which walks begin."""

    stance: IntArray
    """Shape (k,)."""
    masks: IntArray
    """Branches that each limb may be on, shape (k, N)."""
    cost: Array
    """What it cost to get there, shape (k,)."""


class Labels(NamedTuple):
    """What goes with the entries of the queue."""

    masks: IntArray
    """Branches that each limb may be on, shape (room, N)."""
    previous: IntArray
    """Label before at the same stance, shape (room,)."""
    last: IntArray
    """Last label of each stance, shape (n,)."""


class RoadmapWalk(NamedTuple):
    """A walk over a roadmap."""

    origin: int
    """Which origin it begins at."""
    stances: list[int]
    """Stances from there on."""
    steps: list[int]
    """Steps between them."""
    masks: IntArray
    """Branches that each limb may be on at the stances, shape (k, N)."""


def cheapest_walk(
    roads: Roads, cost: Array, h: Array, origins: Origins, factors: Sequence[float]
) -> RoadmapWalk | None:
    """The walk of least cost to a stance of which `h` is 0, or one within a factor of it.

    Args:
        roads: The steps.
        cost: Cost of each, infinite if it cannot be taken, shape (e,).
        h: Lower bounds of the cost from each stance, infinite if none leads on, shape (n,).
        origins: Where walks begin.
        factors: Weights of `h`, at least 1, ascending: more labels are looked at the smaller it is,
            so the next is taken where that takes more than `ROOM`.

    Returns:
        The walk; None if there is none, or if it takes too many labels with every factor.
    """
    room, limbs = ROOM + len(origins.stance), roads.kept.shape[1]
    item = NO_ROOM
    for factor in factors:
        entries = queue(room)
        labels = Labels(
            np.empty((room, limbs), dtype=np.int64),
            np.empty(room, dtype=np.int64),
            np.full(len(h), NO_LABEL),
        )
        item = int(_cheapest((roads, cost), h, factor, origins, entries, labels))
        if item != NO_ROOM:
            break
    if item < 0:
        return None
    chain = [item]
    while entries.link[chain[-1]] >= 0:
        chain.append(int(entries.link[chain[-1]]))
    chain.reverse()
    origin = -1 - int(entries.link[chain[0]])
    stances, steps = entries.node[chain].tolist(), entries.bits[chain[1:]].tolist()
    return RoadmapWalk(origin, stances, steps, labels.masks[chain])


@entry
def _cheapest(
    steps: tuple[Roads, Array],
    h: Array,
    factor: float,
    origins: Origins,
    entries: Queue,
    labels: Labels,
) -> int:
    """Entry of the first label taken at a stance of which `h` is 0, see `cheapest_walk`."""
    roads, cost = steps
    for k in range(len(origins.stance)):
        s, item = origins.stance[k], entries.filled.used
        if h[s] < np.inf:
            for i in range(labels.masks.shape[1]):
                labels.masks[item, i] = origins.masks[k, i]
            _note(item, s, labels)
            push(entries, origins.cost[k] + factor * h[s], origins.cost[k], 0.0, s, -1 - k, -1)
    while entries.filled.size > 0:
        here = first(entries)
        s = entries.node[here]
        if h[s] == 0.0:
            return int(here)
        start, stop = int(roads.start[s]), int(roads.start[s + 1])
        if not has_room(entries, stop - start):
            return NO_ROOM
        pop(entries)
        for e in range(start, stop):
            other, g = int(roads.other[e]), entries.g[here] + cost[e]
            item = entries.filled.used
            if not (g + h[other] < np.inf and _may_step(here, item, e, roads, entries, labels)):
                continue
            if not _covered(item, other, g, entries, labels):
                _note(item, other, labels)
                push(entries, g + factor * h[other], g, 0.0, other, here, e)
    return NO_LABEL


@kernel
def _note(item: int, s: int, labels: Labels) -> None:
    """Note a label as the last of its stance."""
    labels.previous[item] = labels.last[s]
    labels.last[s] = item


@kernel
def _may_step(here: int, item: int, e: int, roads: Roads, entries: Queue, labels: Labels) -> bool:
    """Masks of `item` after step `e` from label `here`; whether the step can be taken."""
    limb, turn, masks = int(roads.limb[e]), int(roads.turn[e]), labels.masks
    limbs = masks.shape[1]
    if not can_release(masks[here, limb], int(roads.released[entries.node[here], limb])):
        return False
    for i in range(limbs):
        kept = int(roads.kept[e, i])
        if i != limb:
            kept = kept_on_edge(masks[here, i], kept)
        if kept == 0:
            return False
        masks[item, (i - turn + limbs) % limbs] = kept
    return True


@kernel
def _covered(item: int, s: int, g: float, entries: Queue, labels: Labels) -> bool:
    """Whether a label of a stance costs no more than `g` and has all branches of `item`."""
    masks, other = labels.masks, labels.last[s]
    while other >= 0:
        more = 0
        for i in range(masks.shape[1]):
            more |= masks[item, i] & ~masks[other, i]
        if more == 0 and entries.g[other] <= g:
            return True
        other = labels.previous[other]
    return False
