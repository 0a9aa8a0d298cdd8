"""The edge of a checked step."""

from __future__ import annotations

from typing import Any, NamedTuple


class Edge(NamedTuple):
    """An edge of the stance graph: base path, swing, and the branches that limbs keep."""

    path_kind: int
    """Kind of the base path, `base_path.STRAIGHT` or `base_path.ARC`."""
    fold: int
    """Fold in which the limb can be moved, -1 if it swings along a line or collisions are not
    checked."""
    line_branches: int
    """Branches between which it can swing along a line in joint space, `8 * before + after`, or
    -1."""
    kept: dict[int, int]
    """Branches that each support limb keeps, by limb; empty if the step is no edge."""


def edge_of(step: Any) -> Edge:
    """Return the edge of a checked step, a row of `StepRecord`."""
    kept = {i: int(branch_set) for i, branch_set in enumerate(step["kept"]) if branch_set}
    return Edge(
        int(step["path_kind"]),
        int(step["folds"][step["path_kind"]]),
        int(step["line_branches"]),
        kept,
    )
