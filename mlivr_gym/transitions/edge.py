"""The edge of a checked step."""

from __future__ import annotations

from typing import Any, NamedTuple


class Edge(NamedTuple):
    """An edge of the stance graph: the swing, and the branches that limbs keep."""

    line_branches: int
    """Branches between which the limb can swing along a line in joint space, `8 * before + after`;
    -1 if it can be moved in a fold, or if not all branches of a single support share a swing."""
    kept: dict[int, int]
    """Branches that each support limb keeps, by limb; empty if the step is no edge."""


def edge_of(step: Any) -> Edge:
    """Return the edge of a checked step, a row of `StepRecord`."""
    kept = {i: int(branch_set) for i, branch_set in enumerate(step["kept"]) if branch_set}
    return Edge(int(step["line_branches"]), kept)
