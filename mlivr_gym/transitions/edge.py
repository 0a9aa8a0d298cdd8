"""The edge of a checked step."""

from __future__ import annotations

from typing import Any, NamedTuple

from mlivr_gym.compiled.bit_sets import BRANCHES, bits_of, codes_of
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
    """Return the edge of a checked step of some number of limbs, a row of `StepRecord`.

    With two limbs the swing is that of the first hold that the support keeps.
    """
    kept = {i: int(branch_set) for i, branch_set in enumerate(step["kept"]) if branch_set}
    fold, line_branches = int(step["fold"]), int(step["line_branches"])
    if limbs == 2:
        first = min((bits_of(branch_set)[0] for branch_set in kept.values()), default=0)
        code = codes_of(step["swings"])[first % BRANCHES]
        fold = code if kept and code < OTHER_FOLD else -1
        line_branches = line_branches if fold < 0 else -1
    return Edge(int(step["path_kind"]), fold, line_branches, kept)
