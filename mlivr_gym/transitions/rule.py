"""The rule of a step: which steps leave a state, and which branches limbs keep.

A limb may move if it may be on a branch on which it can be released from its point. The step must
be an edge of the graph, which has the branches on which the support limbs can follow the base: each
of them keeps those of its branches, and must keep one. A limb that grasps may then be on any branch
on which it can be released again. For two limbs, graphs, tables, exact costs-to-go, environments
and policies call the functions below. The search over a table applies the same rule to the packed
branch sets of all limbs, see `compiled.limb_branch_sets`.

Branch sets are sets of branches and flips, see `compiled.bit_sets`.
"""

from __future__ import annotations

from mlivr_gym.compiled.kernels import entry


@entry
def can_release(branch_set: int, releasable: int) -> bool:
    """Return whether a limb that may be on some branches can be released on one of them."""
    return branch_set & releasable != 0


@entry
def kept_on_edge(branch_set: int, kept: int) -> int:
    """Return those branches of a support limb that an edge keeps, 0 if it cannot follow it."""
    return branch_set & kept
