"""Search for the swing of a step: the motion from above one point to above another.

A swing is a chain of knots, each with the base parameter from 0 to 1 and the six joint angles of
the limb; between knots both change linearly. Of the candidates along which the robot keeps the
clearance the first is taken, unless a plan is to have little reaction (`mlivr_gym.fastest`):

* `direct`: one line in joint space while the base moves;
* `over`: two lines through one of the robot's folds, while the base moves;
* `changed`: change to other branches with the base at rest, swing on a line while the base moves,
  change again; a candidate only if the stance graph proved the step by such a line;
* `folded`: fold the limb, move the base, unfold the limb. The stance graph tries this first, and a
  plan takes it where no shorter swing is clear.

While the base is at rest, a limb changes between folds and branches by the fewest clear lines
(breadth-first search). The lines by which the graph proved that the limb can be released are among
them, so each edge of the graph has a swing; should none be found, the planner reports it. Joint 6
turns while the base moves, which moves none of the limb's collision shapes.

Each line is checked as a whole, see `collisions.sweep`, and so is the curve that rounds a corner,
see `rounded_lines`. Of several roundings the largest that keeps the clearance is taken; at a corner
without one the robot stops.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.motion import SweepScratch
from mlivr_gym.kinematics.base_path import BasePath
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.motion.knots import SwingPart
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions import motions
from mlivr_gym.transitions.edge import Edge
from mlivr_gym.transitions.grasp_poses import angles_above

ROUNDING_FRACTIONS = (1.0, 0.8, 0.6, 0.4, 0.2)
"""Candidate sizes of the rounding of a corner, as fractions of the largest possible one."""

MIN_FRACTION = 0.2
"""Smallest fraction of either line that a rounding may replace. On a sharper corner a robot that
does not slow down would load its grasps more than one that stops."""

SHORTEST_LINE = 1e-3
"""Corners next to a line with less joint travel are not rounded [rad]."""

SAME_KNOT = 1e-9
"""Knots that differ by less are equal [1, rad]."""


class Swing(NamedTuple):
    """The kind of a swing, and its knots of base parameter and joint angles, (k, 7) [1, rad]."""

    kind: str
    knots: Array


class SupportLimb(NamedTuple):
    """A support limb, with the point that it holds and its branch."""

    limb: int
    point: int
    branch: int


class SwingFinder:
    """Search for the swing of one step, along its base path and beside its support limbs."""

    def __init__(
        self, graph: StanceGraph, limb: int, path: BasePath, supports: Sequence[SupportLimb]
    ) -> None:
        """Prepare the step in which `limb` moves while the base follows `path`."""
        self.graph, self.limb, self.path, self.supports = graph, limb, path, supports
        self._robots, self._world = graph.checks.robots, graph.checks.world(graph.obstacle_grid)
        self._rows = motions.SupportRecord.rows(len(supports))
        for row, support in zip(self._rows, supports, strict=True):
            row["limb"], row["point"], row["branch"] = support
        self._curves, self._scratch = motions.SwingCurve.rows(1), SweepScratch.rows(1)
        self._curves["path"], self._curves["limb"] = path, limb

    @classmethod
    def of(cls, graph: StanceGraph, ends: StepEnds, path: BasePath) -> SwingFinder:
        """Prepare the step with given ends while the base follows `path`."""
        supports = [
            SupportLimb(limb, point, ends.branches[limb])
            for limb, point in enumerate(ends.after)
            if limb != ends.limb
        ]
        return cls(graph, ends.limb, path, supports)

    def swings(
        self, start: Array, end: Array, points: tuple[int, int], edge: Edge
    ) -> Iterator[Swing]:
        """Yield the clear swings from above one point to above another, the preferred one first.

        Joint angles above the points have shape (6,) [rad]; `points` are the indices of both, and
        the edge of the step is as the stance graph has proved it.
        """
        first, last = _knot(0.0, start), _knot(1.0, end)
        folds = self._robots[0]["folds"][: self._robots[0]["fold_count"]]
        for knots in ((first, last), *((first, _knot(0.5, fold, end), last) for fold in folds)):
            if self.is_clear(np.stack(knots)):
                yield Swing("direct" if len(knots) == 2 else "over", np.stack(knots))
        others = [
            [_knot(s, joints, tool) for joints in (*folds, *self._above_all(side, points[side]))]
            for side, (s, tool) in enumerate(((0.0, start), (1.0, end)))
        ]
        for kind, before, after in self._candidates(folds, points, edge):
            middle = _knot(0.0, before, start), _knot(1.0, after, end)
            if not self._is_line_clear(*middle):
                continue
            away = self._chain_at_rest(first, middle[0], others[0])
            back = away and self._chain_at_rest(middle[1], last, others[1])
            if away and back:
                yield Swing(kind, np.stack([*away, *back]))

    def _candidates(
        self, folds: Array, points: tuple[int, int], edge: Edge
    ) -> Iterator[tuple[str, Array, Array]]:
        """Yield kinds of swing, with the joint angles before and after the base moves.

        The kind by which the stance graph proved the step comes first.
        """
        if edge.line_branches >= 0:
            branches = divmod(edge.line_branches, 8)
            before, after = (self._above(side, points[side], branches[side]) for side in range(2))
            if before is not None and after is not None:
                yield "changed", before, after
        for k in sorted(range(len(folds)), key=lambda k: k != edge.fold):
            yield "folded", folds[k], folds[k]

    def _chain_at_rest(self, first: Array, last: Array, others: list[Array]) -> list[Array] | None:
        """Return a chain of the fewest clear lines between two knots via `others`, or None."""
        if (first == last).all():
            return [first]
        chains = [[first]]
        for chain in chains:
            if self._is_line_clear(chain[-1], last):
                return [*chain, last]
            for other in list(others):
                if (other != first).any() and self._is_line_clear(chain[-1], other):
                    chains.append([*chain, other])
                    others = [knot for knot in others if knot is not other]
        return None

    def _above_all(self, side: int, point: int) -> list[Array]:
        """Return joint angles above a point on each branch, at one end of the base path [rad]."""
        angles = [self._above(side, point, branch) for branch in range(8)]
        return [joints for joints in angles if joints is not None]

    def _above(self, side: int, point: int, branch: int) -> Array | None:
        """Return joint angles above a point on a branch, shape (6,) [rad]; None if unreachable."""
        out, base = Angles.row(), self.path["last" if side else "first"]
        grasp = self.graph.solver.grasps[point]
        return out["q"] if angles_above(self._robots, self.limb, base, grasp, branch, out) else None

    def is_clear(self, knots: Array) -> bool:
        """Return whether the robot keeps the clearance along a chain of knots."""
        return all(self._is_line_clear(a, b) for a, b in pairwise(knots))

    def round_corners(self, knots: Array, lengths: Array) -> Array:
        """Return the fractions of the lines before and after each knot that its rounding replaces.

        The lines between the knots (k, 7) of a swing are clear, and have lengths (k - 1,). A corner
        takes the same length of both its lines, and two corners share the line between them by
        halves. The result has shape (k, 2), with 0 at both ends and at corners that stay sharp.
        """
        fractions, available = np.zeros((len(knots), 2)), lengths.copy()
        available[1:-1] *= 0.5
        for k in range(1, len(knots) - 1):
            pair = lengths[k - 1 : k + 1]
            if pair.min() < SHORTEST_LINE:
                continue
            for fraction in ROUNDING_FRACTIONS:
                before, after = fraction * available[k - 1 : k + 1].min() / pair
                if min(before, after) < MIN_FRACTION:
                    break
                first = knots[k] + before * (knots[k - 1] - knots[k])
                last = knots[k] + after * (knots[k + 1] - knots[k])
                if self.is_corner_clear(first, knots[k], last):
                    fractions[k] = before, after
                    break
        return fractions

    def is_corner_clear(self, first: Array, corner: Array, last: Array) -> bool:
        """Return whether the robot keeps the clearance on the rounding of a corner.

        The rounding starts at `first` and ends at `last`, each with shape (7,).
        """
        curve = self._curves[0]
        curve["rounded"], curve["turning"], curve["corner"]["q"] = True, corner[0], corner[1:]
        clear = self._is_line_clear(first, last)
        curve["rounded"] = False
        return clear

    def _is_line_clear(self, a: Array, b: Array) -> bool:
        """Return whether the robot keeps the clearance from one knot to the next."""
        curve = self._curves[0]
        curve["begin"], curve["finish"] = a[0], b[0]
        curve["start"]["q"], curve["end"]["q"] = a[1:], b[1:]
        clear = motions.curve_clear(
            self._curves, self._rows, self._robots, self._world, self._scratch
        )
        return bool(clear)


def rounded_lines(knots: Array, corners: Array) -> SwingPart:
    """Return lines between knots (k, 7) with rounded corners at the inner ones.

    The rounding of a corner replaces a fraction `before` of the line to it, W, and a fraction
    `after` of the line from it, V; corners have shape (k - 2, 2):

        x(t) = corner - before W f(1 - t) + after V f(t),   f(t) = t^3 (2 - t),   t from 0 to 1

    The curve stays in the triangle of the corner and its two end points. Its first and second
    derivatives agree with those of the lines, since the path parameter is distributed over the
    lines so that `2 before W` and `2 after V` are the derivatives by t on either side.
    `collisions.sweep` checks the same curve as a whole.
    """
    longer = np.cumprod(corners[:, 0] / corners[:, 1])
    places = np.cumsum(np.concatenate([[0.0, 1.0], longer]))
    places /= places[-1]
    halves = corners[:, 0] * np.diff(places)[:-1]

    def at(sigma: Array) -> Array:
        values: Array = np.column_stack([np.interp(sigma, places, column) for column in knots.T])
        for k, half in enumerate(halves.tolist(), 1):
            here = np.abs(sigma - places[k]) < half
            t = 0.5 + 0.5 * (sigma[here, None] - places[k]) / half
            into, out = knots[k] - knots[k - 1], knots[k + 1] - knots[k]
            before, after = corners[k - 1]
            values[here] = knots[k] - before * into * ease(1.0 - t) + after * out * ease(t)
        return values

    inner = places[1:-1, None] + halves[:, None] * [-1.0, 0.0, 1.0]
    breaks = np.unique(np.concatenate([[0.0, 1.0], inner.ravel().clip(0.0, 1.0)]))
    # Where a corner takes all that another one leaves of a line, nothing is between them.
    breaks = breaks[np.diff(breaks, append=2.0) > SAME_KNOT]
    breaks[0] = 0.0
    return SwingPart(breaks, at)


def ease(t: Array) -> Array:
    """Return `t^3 (2 - t)`, from 0 at rest to 1 with velocity 2, both without acceleration."""
    return t**3 * (2.0 - t)


def rounded_parts(knots: Array, corners: Array) -> list[SwingPart]:
    """Return the parts of a swing between its points of rest.

    Knots have shape (k, 7), and corners as `SwingFinder.round_corners` returns them shape (k, 2); a
    robot stops at one that is not rounded.
    """
    distinct = np.abs(np.diff(knots, axis=0, prepend=np.inf)).max(axis=1) > SAME_KNOT
    knots, corners = knots[distinct], corners[distinct]
    stops = np.flatnonzero((corners == 0.0).any(axis=1))
    return [
        rounded_lines(knots[first : last + 1], corners[first + 1 : last])
        for first, last in pairwise(stops.tolist())
    ]


def _knot(s: float, joints: Array, tool: Array | None = None) -> Array:
    """Return a knot of base parameter and joint angles [rad], joint 6 of `tool` if given."""
    return np.array([s, *joints[:5], (joints if tool is None else tool)[5]])
