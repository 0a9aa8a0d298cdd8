"""Swings of the limb that moves, from above the point it leaves to above the point it grasps.

A swing is a chain of knots: where the base is on its path, from 0 to 1, and the limb's six joint
angles; between knots both change linearly together. The shortest kind that touches nothing is
taken:

* `direct`: one line in joint space while the base moves;
* `over`: through one of the robot's folds, the base moving all along;
* `folded`: fold, move the base, unfold; this is what the stance graph has shown to be possible for
  most steps;
* `changed`: change to another branch at others, swing in a line while the base moves, change again;
  this is what it has shown for the others.

At others a limb goes from fold to fold and branch to branch by the fewest lines that are free; those
by which the graph has shown that it can be released are among them. So an edge of the graph has a
swing: every line of `folded` and `changed` was found free when it was checked. Joint 6 turns while
the base moves, and of a limb's shapes moves none.

Each line is checked as a whole, see `collisions.sweep`. So is the curve that rounds a corner
between two lines, see `motion.runs`; the largest that keeps the clearance is taken of some, and
where none does the robot stops.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.motion import Sweep
from mlivr_gym.kinematics.base_path import BasePath
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.motion.regrasp import Regrasp
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions import motions
from mlivr_gym.transitions.edge import Edge
from mlivr_gym.transitions.grasp_poses import angles_above

ROUNDING_FRACTIONS = (1.0, 0.8, 0.6, 0.4, 0.2)
"""Parts of the most that the rounding of a corner may take of two lines, which are tried."""

MINIMUM_SHARE = 0.2
"""Least share of either line that the rounding of a corner takes; on a sharper one a robot that
does not slow down would pull harder on its grasps than one that stops."""

SHORTEST_LINE = 1e-3
"""A line on which no joint turns farther has no rounded corner [rad]."""


class Swing(NamedTuple):
    """A swing: its kind, and its knots (k, 7), base parameter and joint angles [rad]."""

    kind: str
    knots: Array


class SupportLimb(NamedTuple):
    """A limb that supports a point on a branch while another moves."""

    limb: int
    point: int
    branch: int


class SwingFinder:
    """Finds the swing of one step.

    Attributes
    ----------
    graph
        The stance graph.
    limb
        The limb that moves.
    path
        Base path.
    supports
        The limbs that support.
    """

    def __init__(
        self, graph: StanceGraph, limb: int, path: BasePath, supports: Sequence[SupportLimb]
    ) -> None:
        """Look at the step in which `limb` moves while the base follows `path`."""
        self.graph, self.limb, self.path, self.supports = graph, limb, path, supports
        self._robots, self._world = graph.checks.robots, graph.checks.world(graph.obstacle_grid)
        self._rows = motions.SupportRecord.rows(len(supports))
        for row, support in zip(self._rows, supports, strict=True):
            row["limb"], row["point"], row["branch"] = support
        self._segments, self._scratch = motions.SwingSegment.rows(1), Sweep.rows(1)
        self._segments["path"], self._segments["limb"] = path, limb

    @classmethod
    def of(cls, graph: StanceGraph, regrasp: Regrasp) -> SwingFinder:
        """Look at the step `regrasp`, whose swing is not looked at."""
        supports = [
            SupportLimb(limb, point, regrasp.branches[limb])
            for limb, point in enumerate(regrasp.after)
            if limb != regrasp.limb
        ]
        return cls(graph, regrasp.limb, regrasp.base_path, supports)

    def find(self, start: Array, end: Array, points: tuple[int, int], edge: Edge) -> Swing | None:
        """The shortest swing between lifted postures.

        Parameters
        ----------
        start
            Joint angles above the point it leaves, shape (6,) [rad].
        end
            Joint angles above the point it grasps, shape (6,) [rad].
        points
            Both points, by index.
        edge
            How the graph has shown that the limb can move.
        """
        first, last = _knot(0.0, start), _knot(1.0, end)
        folds = self._robots[0]["folds"][: self._robots[0]["fold_count"]]
        for knots in ((first, last), *((first, _knot(0.5, fold, end), last) for fold in folds)):
            if self.is_clear(np.stack(knots)):
                return Swing("direct" if len(knots) == 2 else "over", np.stack(knots))
        others = [
            [_knot(u, joints, tool) for joints in (*folds, *self._above_all(side, points[side]))]
            for side, (u, tool) in enumerate(((0.0, start), (1.0, end)))
        ]
        for kind, before, after in self._candidates(folds, points, edge):
            middle = _knot(0.0, before, start), _knot(1.0, after, end)
            if not self._is_line_clear(*middle):
                continue
            away = self._chain_at_rest(first, middle[0], others[0])
            back = away and self._chain_at_rest(middle[1], last, others[1])
            if away and back:
                return Swing(kind, np.stack([*away, *back]))
        return None

    def _candidates(
        self, folds: Array, points: tuple[int, int], edge: Edge
    ) -> Iterator[tuple[str, Array, Array]]:
        """Kinds of swing and joint angles before and after the base moves.

        What the graph has shown comes first.
        """
        if edge.pair >= 0:
            branches = divmod(edge.pair, 8)
            before, after = (self._above(side, points[side], branches[side]) for side in range(2))
            if before is not None and after is not None:
                yield "changed", before, after
        for k in sorted(range(len(folds)), key=lambda k: k != edge.fold):
            yield "folded", folds[k], folds[k]

    def _chain_at_rest(self, first: Array, last: Array, others: list[Array]) -> list[Array] | None:
        """The fewest free lines from one knot to another, through others, as a chain of knots."""
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
        """Joint angles above a point at one end of the base path, on each branch [rad]."""
        angles = [self._above(side, point, branch) for branch in range(8)]
        return [joints for joints in angles if joints is not None]

    def _above(self, side: int, point: int, branch: int) -> Array | None:
        """Joint angles above a point on one branch, shape (6,) [rad]; None if there are none."""
        out, base = Angles.row(), self.path["last" if side else "first"]
        grasp = self.graph.solver.grasps[point]
        return out["q"] if angles_above(self._robots, self.limb, base, grasp, branch, out) else None

    def is_clear(self, knots: Array) -> bool:
        """Whether the robot touches nothing along a chain of knots."""
        return all(self._is_line_clear(a, b) for a, b in pairwise(knots))

    def round_corners(self, knots: Array, lengths: Array) -> Array:
        """Shares of the lines before and after each knot on which its corner can be rounded.

        Parameters
        ----------
        knots
            Of a swing whose lines are clear, shape (k, 7).
        lengths
            Lengths of its lines, shape (k - 1,); a corner takes as much of either. What
            lies between two corners is theirs by halves.

        Returns
        -------
        Array
            Shape (k, 2); 0 at the ends and where no rounding keeps the clearance.
        """
        shares, most = np.zeros((len(knots), 2)), lengths.copy()
        most[1:-1] *= 0.5
        for k in range(1, len(knots) - 1):
            pair = lengths[k - 1 : k + 1]
            if pair.min() < SHORTEST_LINE:
                continue
            for part in ROUNDING_FRACTIONS:
                before, after = part * most[k - 1 : k + 1].min() / pair
                if min(before, after) < MINIMUM_SHARE:
                    break
                first = knots[k] + before * (knots[k - 1] - knots[k])
                last = knots[k] + after * (knots[k + 1] - knots[k])
                if self.is_corner_clear(first, knots[k], last):
                    shares[k] = before, after
                    break
        return shares

    def is_corner_clear(self, first: Array, corner: Array, last: Array) -> bool:
        """Whether the robot touches nothing on the rounding of a corner, from its first place."""
        segment = self._segments[0]
        segment["rounded"], segment["turning"], segment["corner"]["q"] = True, corner[0], corner[1:]
        clear = self._is_line_clear(first, last)
        segment["rounded"] = False
        return clear

    def _is_line_clear(self, a: Array, b: Array) -> bool:
        """Whether the robot touches nothing from one knot to the next."""
        segment = self._segments[0]
        segment["begin"], segment["finish"] = a[0], b[0]
        segment["start"]["q"], segment["end"]["q"] = a[1:], b[1:]
        clear = motions.segment_clear(
            self._segments, self._rows, self._robots, self._world, self._scratch
        )
        return bool(clear)


def _knot(u: float, joints: Array, tool: Array | None = None) -> Array:
    """A knot: base parameter, joints 1 to 5, and joint 6 as in `tool` if that is given [rad]."""
    return np.array([u, *joints[:5], (joints if tool is None else tool)[5]])
