"""The rule of a step: which steps leave a state, and on which branches the limbs are after one.

A limb may move if it may be on a branch on which it can be released from its point. The step must
be an edge of the graph, which says on which branches the limbs that hold can follow the base: each
of them keeps those it may be on already, and must keep one. A limb that grasps may then be on any
branch on which it can be released again. Graphs, tables, searches, environments and experts all ask
the functions below.

Masks have a bit for each branch and flip of a limb, `branch + 8 * flip`; further bits are ignored.
"""

from __future__ import annotations

from mlivr_gym.compiled.kernels import kernel

BRANCH_BITS = 0xFFFF
"""The bits of branches and flips; answers of `release` and edge entries have more above them."""


@kernel
def can_release(mask: int, releasable: int) -> bool:
    """Whether a limb may move that may be on `mask` and can be released on `releasable`."""
    return mask & releasable & BRANCH_BITS != 0


@kernel
def kept_on_edge(mask: int, edge: int) -> int:
    """Branches that a limb that holds keeps on an edge, 0 if it cannot follow the edge."""
    return mask & edge & BRANCH_BITS


@kernel
def mask_of_grasp(releasable: int) -> int:
    """Branches on which a limb may be that has just grasped a point."""
    return releasable & BRANCH_BITS
