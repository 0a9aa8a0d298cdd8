"""The edge that a step is."""

from __future__ import annotations

from typing import Any, NamedTuple


class Edge(NamedTuple):
    """An edge of the graph: base path, swing, and the branches that limbs keep on it."""

    kind: int
    """Kind of the base path, `base_path.STRAIGHT` or `base_path.ARC`."""
    fold: int
    """Fold in which the limb can be moved, -1 without collisions or if it swings along a line."""
    pair: int
    """Branches between which the limb can swing along a line, `8 * before + after`, or -1."""
    kept: dict[int, int]
    """Branches on which the limbs that hold can follow it, by limb; none if it is no edge."""


def edge_of(step: Any) -> Edge:
    """The edge that a checked step is, a row of `Step`."""
    kept = {i: int(mask) for i, mask in enumerate(step["kept"]) if mask}
    return Edge(int(step["kind"]), int(step["folds"][step["kind"]]), int(step["pair"]), kept)
