"""The edge of a checked step."""

from __future__ import annotations

from typing import Any, NamedTuple

from mlivr_gym.compiled.bit_sets import BRANCHES, bits_of, codes_of
from mlivr_gym.kinematics.base_path import STRAIGHT
from mlivr_gym.transitions.line_steps import OTHER_FOLD


class Edge(NamedTuple):
    """An edge of the stance graph: way of the base, swing, and the branches that limbs keep."""

    path_kind: int
    """Of three and more limbs: kind of the base path, `base_path.STRAIGHT` or `base_path.ARC`."""
    fold: int
    """Fold in which the limb can be moved, -1 if it swings along a line or collisions are not
    checked."""
    line_branches: int
    """Branches between which it can swing along a line in joint space, `8 * before + after`, or
    -1."""
    kept: dict[int, int]
    """Branches that each support limb keeps, by limb; empty if the step is no edge."""


def edge_of(step: Any, limbs: int) -> Edge:
    """Return the edge of a checked step of some number of limbs, a row of `StepRecord`."""
    if limbs == 2:
        support = 1 - int(step["limb"])
        return edge_alone(support, int(step["kept"][support]), step)
    kept = {i: int(branch_set) for i, branch_set in enumerate(step["kept"]) if branch_set}
    return Edge(int(step["path_kind"]), int(step["fold"]), int(step["line_branches"]), kept)


def edge_alone(support: int, kept: int, found: Any) -> Edge:
    """Return the edge of a step of two limbs, of which one supports and keeps a branch set.

    The swing is that of the first hold; `found` has `swings` and `line_branches` as a row of
    `StepRecord`.
    """
    if not kept:
        return Edge(STRAIGHT, -1, -1, {})
    code = codes_of(found["swings"])[bits_of(kept)[0] % BRANCHES]
    if code < OTHER_FOLD:
        return Edge(STRAIGHT, code, -1, {support: kept})
    return Edge(STRAIGHT, -1, int(found["line_branches"]), {support: kept})
