"""The edge of a checked step."""

from __future__ import annotations

from typing import Any, NamedTuple

from mlivr_gym.compiled.bit_sets import BRANCHES, bits_of, codes_of
from mlivr_gym.transitions.line_steps import ON_LINE, OTHER_FOLD


class Edge(NamedTuple):
    """An edge of the stance graph: the swing, and the branches that limbs keep."""

    line_branches: int
    """Branches between which the limb can swing along a line in joint space, `8 * before + after`;
    -1 if it can be moved in a fold."""
    kept: dict[int, int]
    """Branches that each support limb keeps, by limb; empty if the step is no edge."""


def edge_of(step: Any, limbs: int) -> Edge:
    """Return the edge of a checked step of some number of limbs, a row of `StepRecord`."""
    if limbs == 2:
        support = 1 - int(step["limb"])
        return edge_alone(support, int(step["kept"][support]), step)
    kept = {i: int(branch_set) for i, branch_set in enumerate(step["kept"]) if branch_set}
    return Edge(int(step["line_branches"]), kept)


def edge_alone(support: int, kept: int, found: Any) -> Edge:
    """Return the edge of a step of two limbs, of which one supports and keeps a branch set.

    The swing is that of the first hold; `found` has `swings` and `line_branches` as a row of
    `StepRecord`.
    """
    if not kept:
        return Edge(-1, {})
    is_on_line = _code_of(kept, found) == ON_LINE
    line_branches = int(found["line_branches"]) if is_on_line else -1
    return Edge(line_branches, {support: kept})


def is_told_apart(kept: int, found: Any) -> bool:
    """Return whether the swing of the first hold follows from the codes, as `edge_alone` reads it.

    If one flip of a branch has a fold and the other the line, they do not tell which.
    """
    return not kept or _code_of(kept, found) != OTHER_FOLD or int(found["line_branches"]) < 0


def _code_of(kept: int, found: Any) -> int:
    """Return the code of the first hold of a branch set."""
    return codes_of(found["swings"])[bits_of(kept)[0] % BRANCHES]
