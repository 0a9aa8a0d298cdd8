"""The rule of a step: which steps leave a state, and on which branches the limbs are after one.

A limb may move if it may be on a branch on which it can be released from its point. The step must
be an edge of the graph, which says on which branches the limbs that hold can follow the base: each
of them keeps those it may be on already, and must keep one. A limb that grasps may then be on any
branch on which it can be released again. Graphs, tables, searches, environments and experts all ask
the functions below.

Masks are sets of branches and flips, see `compiled.bit_sets`.
"""

from __future__ import annotations

from mlivr_gym.compiled.kernels import entry


@entry
def can_release(mask: int, releasable: int) -> bool:
    """Whether a limb may move that may be on `mask` and can be released on `releasable`."""
    return mask & releasable != 0


@entry
def kept_on_edge(mask: int, edge: int) -> int:
    """Branches that a limb that holds keeps on an edge, 0 if it cannot follow the edge."""
    return mask & edge
