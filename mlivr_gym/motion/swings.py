"""Search for the swing of a step: the motion from above one point to above another.

A swing is a chain of swing knots, each with the place of the base on its way, from 0 to 1, and the
six joint angles of the limb; between them both change linearly, and at each the robot is at rest.
Of the candidates along which the robot keeps the clearance the first is taken, unless a plan is to
have little reaction (`mlivr_gym.extensions.reaction.fastest`):

* `direct`: one line in joint space while the base moves;
* `over`: two lines through one of the robot's folds, while the base moves;
* `folded`: fold the limb, move the base, unfold the limb;
* `changed`: change to other branches with the base at rest, swing on a line while the base moves,
  change again.

Folds are tried in the order of the joint travel to them, branches in that of the travel between
them. The graph proves a step by one of the last two, so each of its edges has a swing; should none
be found, the planner reports it.

While the base is at rest, a limb changes between folds and branches by the fewest clear lines
(breadth-first search). Joint 6 turns while the base moves, which moves none of the limb's collision
shapes.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import poses
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.motion.straight_base import FollowingSupports
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.grasp_poses import angles_above

SAME_KNOT = 1e-9
"""Swing knots that differ by less are equal [1, rad]."""


class Swing(NamedTuple):
    """The kind of a swing, and its swing knots, shape (k, 7) [1, rad]."""

    kind: str
    knots: Array


class SwingFinder:
    """Search for the swing of one step beside its support limbs."""

    def __init__(self, graph: StanceGraph, ends: StepEnds, supports: FollowingSupports) -> None:
        """Prepare the step with given ends."""
        self._ends, self._supports = ends, supports
        self._robots, self._grasps = graph.checks.robots, graph.solver.grasps
        self._bases = poses(ends.positions, ends.rotations)

    def swings(self, start: Array, end: Array) -> Iterator[Swing]:
        """Yield the clear swings from above one point to above another, the preferred one first.

        Joint angles above the points have shape (6,) [rad]. Of those that change the branch only
        the first is told.
        """
        first, last = swing_knot(0.0, start), swing_knot(1.0, end)
        folds = self._robots[0]["folds"][: self._robots[0]["fold_count"]]
        travels = sum(np.abs(folds - joints[:5]).max(axis=1) for joints in (start, end))
        folds = folds[np.argsort(travels, kind="stable")]
        over = ((first, swing_knot(0.5, fold, end), last) for fold in folds)
        for knots in ((first, last), *over):
            if all(self._supports.is_clear(a, b) for a, b in pairwise(knots)):
                yield Swing("direct" if len(knots) == 2 else "over", np.stack(knots))
        above = [self._above_all(side) for side in range(2)]
        others = [
            [swing_knot(s, joints, tool) for joints in (*folds, *above[side])]
            for side, (s, tool) in enumerate(((0.0, start), (1.0, end)))
        ]
        for kind, before, after in self._candidates(folds, above):
            middle = swing_knot(0.0, before, start), swing_knot(1.0, after, end)
            if _are_same(middle[0], first) and _are_same(middle[1], last):
                continue  # that is the direct one
            if not self._supports.is_clear(*middle):
                continue
            away = self._chain_at_rest(first, middle[0], others[0])
            back = away and self._chain_at_rest(middle[1], last, others[1])
            if away and back:
                yield Swing(kind, np.stack([*away, *back]))
                if kind == "changed":
                    return

    def _candidates(
        self, folds: Array, above: list[list[Array]]
    ) -> Iterator[tuple[str, Array, Array]]:
        """Yield kinds of swing, with the joint angles before and after the base moves.

        The folds come first, then the pairs of branches above both points.
        """
        for fold in folds:
            yield "folded", fold, fold
        for before, after in sorted(product(*above), key=_travel):
            yield "changed", before, after

    def _chain_at_rest(self, first: Array, last: Array, others: list[Array]) -> list[Array] | None:
        """Return a chain of the fewest clear lines between two knots via `others`, or None."""
        if _are_same(first, last):
            return [first]
        chains = [[first]]
        for chain in chains:
            if self._supports.is_clear(chain[-1], last):
                return [*chain, last]
            for other in list(others):
                if not _are_same(other, first) and self._supports.is_clear(chain[-1], other):
                    chains.append([*chain, other])
                    others = [knot for knot in others if knot is not other]
        return None

    def _above_all(self, side: int) -> list[Array]:
        """Return joint angles above a point on each branch, before or after the step [rad]."""
        angles = [self._above(side, branch) for branch in range(8)]
        return [joints for joints in angles if joints is not None]

    def _above(self, side: int, branch: int) -> Array | None:
        """Return joint angles above a point on a branch, shape (6,) [rad]; None if unreachable."""
        out, limb, base = Angles.row(), self._ends.limb, self._bases[side]
        grasp = self._grasps[(self._ends.after if side else self._ends.before)[limb]]
        return out["q"] if angles_above(self._robots, limb, base, grasp, branch, out) else None


def swing_knot(s: float, joints: Array, tool: Array | None = None) -> Array:
    """Return a swing knot with a place of the base and joint angles [rad], shape (7,).

    Joint 6 is that of `tool` if it is given.
    """
    return np.array([s, *joints[:5], (joints if tool is None else tool)[5]])


def _travel(ends: tuple[Array, ...]) -> float:
    """Return how far the joints turn on a line, at most [rad]."""
    return float(np.abs(ends[1] - ends[0])[:5].max())


def _are_same(a: Array, b: Array) -> bool:
    """Return whether two swing knots are equal."""
    return bool(np.abs(a - b).max() <= SAME_KNOT)
