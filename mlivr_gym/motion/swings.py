"""Swings of the limb that moves, from above the point it leaves to above the point it grasps.

A swing is a chain of knots: where the base is on its path, from 0 to 1, and the limb's six joint
angles; between knots both change linearly together. The shortest kind that touches nothing is
taken:

* `direct`: one line in joint space while the base moves;
* `over`: through one of the robot's folds, the base moving all along;
* `folded`: fold, move the base, unfold; this is what the stance graph has shown to be possible for
  most steps;
* `changed`: change to another branch at rest, swing in a line while the base moves, change again;
  this is what it has shown for the others;
* `sampled`: as one of the last two, on lines found by a sampling planner, where a limb has turned
  so far while it held that the swings known to the graph would leave its joint limits.

Each line is checked as a whole, see `collisions.sweep`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.sweep import Sweep
from mlivr_gym.kinematics.base_path import BasePath
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.motion.regrasp import Regrasp
from mlivr_gym.motion.sampling import sampled_line
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions import motions
from mlivr_gym.transitions.grasp_poses import angles_above, fold_of_limb, line_of_limb

Ends = tuple[Array, Array, tuple[Array, Array]]
"""Joint angles above both points, and the fewest and most whole turns that may be added."""


class Swing(NamedTuple):
    """A swing: its kind, and its knots (k, 7), base parameter and joint angles [rad]."""

    kind: str
    knots: Array


class Hold(NamedTuple):
    """A limb that holds a point on a branch while another moves."""

    limb: int
    point: int
    branch: int


class SwingFinder:
    """Finds the swing of one step.

    Attributes:
        graph: The stance graph.
        limb: The limb that moves.
        path: Base path.
        holds: The limbs that hold.
    """

    def __init__(
        self, graph: StanceGraph, limb: int, path: BasePath, holds: Sequence[Hold]
    ) -> None:
        """Look at the step in which `limb` moves while the base follows `path`."""
        self.graph, self.limb, self.path, self.holds = graph, limb, path, holds
        self._robots = graph.checks.robots
        self._rows = motions.Hold.rows(len(holds))
        for row, hold in zip(self._rows, holds, strict=True):
            row["limb"], row["point"], row["branch"] = hold
        self._pieces, self._rooms = motions.Piece.rows(1), Sweep.rows(1)
        self._pieces["path"], self._pieces["limb"] = path, limb

    @classmethod
    def of(cls, graph: StanceGraph, regrasp: Regrasp) -> SwingFinder:
        """Look at the step `regrasp`, whose swing is not looked at."""
        holds = [
            Hold(limb, point, regrasp.branches[limb])
            for limb, point in enumerate(regrasp.after)
            if limb != regrasp.limb
        ]
        return cls(graph, regrasp.limb, regrasp.base_path, holds)

    def find(
        self,
        start: Array,
        end: Array,
        turns: tuple[Array, Array],
        fold: int,
        line: tuple[Array, Array] | None,
    ) -> Swing | None:
        """The shortest swing between lifted postures.

        Args:
            start: Joint angles above the point it leaves, shape (6,) [rad].
            end: Joint angles above the point it grasps, on any winding.
            turns: Fewest and most whole turns that may be added to `end`, each (6,).
            fold: The fold in which the graph has shown that the limb can move, or -1.
            line: Joint angles between which it has shown that the limb can swing in a line, where
                it cannot move folded.
        """
        for kind, knots in self._candidates((start, end, turns), fold, line):
            if self.clear(knots):
                return Swing(kind, knots)
        sampled = self._sampled((start, end, turns), self.shown_line(fold, line, start))
        return None if sampled is None else Swing("sampled", sampled)

    def _sampled(self, ends: Ends, shown: tuple[Array, Array] | None) -> Array | None:
        """Sampled knots at rest, a line while the base moves, sampled knots at rest; None if none.

        The whole is checked like any other swing, so what the sampling planner skips between its
        postures does no harm.
        """
        if shown is None:
            return None
        start, end, turns = ends
        limits = self.graph.robot.limb.limits
        away = sampled_line(self.clear, limits, _knot(0.0, start), _knot(0.0, shown[0]))
        if away is None:
            return None
        last = _knot(1.0, nearest_end(end, turns, shown[1]))
        back = sampled_line(self.clear, limits, _knot(1.0, shown[1]), last)
        if back is None:
            return None
        knots = np.vstack([away, back])
        return knots if self.clear(knots) else None

    def shown_line(
        self, fold: int, line: tuple[Array, Array] | None, start: Array
    ) -> tuple[Array, Array] | None:
        """Joint angles at both ends of the base path as the graph has shown it.

        They are on the windings nearest to `start`; None if these are outside the limits.
        """
        if line is None:
            folded = self.fold(fold, start)
            return None if folded is None else (folded, folded)
        before, first, last = map(_angles, (start, *line))
        there = line_of_limb(self._robots, self.limb, before, first, first)
        if max(there, line_of_limb(self._robots, self.limb, first, last, last)) == np.inf:
            return None
        return first["q"], last["q"]

    def _candidates(
        self, ends: Ends, fold: int, line: tuple[Array, Array] | None
    ) -> Iterator[tuple[str, Array]]:
        """Kinds and knots of the swings that are tried, the shortest first."""
        start, end, turns = ends
        yield "direct", np.stack([_knot(0.0, start), _knot(1.0, nearest_end(end, turns, start))])
        count = len(self.graph.robot.folds)
        for index in range(count):
            middle = self.fold(index, start)
            if middle is not None:
                last = nearest_end(end, turns, middle)
                yield "over", np.stack([_knot(0.0, start), _knot(0.5, middle), _knot(1.0, last)])
        if line is not None:
            yield from (("changed", knots) for knots in self._changed(ends, line))
        orders = sorted(range(count), key=lambda k: k != fold)
        for moved_in in orders:
            for first in orders:
                for last_fold in orders:
                    knots = self._folded(ends, (first, moved_in, last_fold))
                    if knots is not None:
                        yield "folded", knots

    def _folded(self, ends: Ends, folds: tuple[int, int, int]) -> Array | None:
        """Fold through one fold, move in another, unfold through a third."""
        start, end, turns = ends
        knots = [_knot(0.0, start)]
        for k, u in zip(folds, (0.0, 0.0, 1.0), strict=True):
            here = self.fold(k, knots[-1][1:])
            if here is None:
                return None
            if u == 1.0:
                knots.append(_knot(1.0, knots[-1][1:]))
            if np.abs(here - knots[-1][1:]).max() > 1e-9:
                knots.append(_knot(u, here))
        knots.append(_knot(1.0, nearest_end(end, turns, knots[-1][1:])))
        return np.stack(knots)

    def _changed(self, ends: Ends, line: tuple[Array, Array]) -> Iterator[Array]:
        """Change to the branch of the line, at once or through a fold, follow it, change again."""
        start, end, turns = ends
        through = [None, *range(len(self.graph.robot.folds))]
        for first in through:
            knots = [_knot(0.0, start)]
            if first is not None:
                here = self.fold(first, start)
                if here is None:
                    continue
                knots.append(_knot(0.0, here))
            shown = self.shown_line(-1, line, knots[-1][1:])
            if shown is None:
                continue
            knots += [_knot(0.0, shown[0]), _knot(1.0, shown[1])]
            for last in through:
                here = shown[1] if last is None else self.fold(last, shown[1])
                if here is not None:
                    rest = [] if last is None else [_knot(1.0, here)]
                    final = _knot(1.0, nearest_end(end, turns, here))
                    yield _without_stops(np.stack([*knots, *rest, final]))

    def fold(self, index: int, joints: Array) -> Array | None:
        """A fold on the windings nearest to some joint angles [rad], or None outside the limits."""
        out = _angles(joints)
        return out["q"] if fold_of_limb(self._robots, self.limb, index, out, out) else None

    def clear(self, knots: Array) -> bool:
        """Whether the robot touches nothing along a chain of knots."""
        return all(self._clear_line(a, b) for a, b in pairwise(knots))

    def _clear_line(self, a: Array, b: Array) -> bool:
        """Whether the robot touches nothing from one knot to the next."""
        piece, world = self._pieces[0], self.graph.checks.world(self.graph.obstacle_grid)
        piece["begin"], piece["finish"] = a[0], b[0]
        piece["start"]["q"], piece["end"]["q"] = a[1:], b[1:]
        clear = motions.piece_clear(self._pieces, self._rows, self._robots, world, self._rooms)
        return bool(clear)


def line_of_edge(graph: StanceGraph, regrasp: Regrasp, pair: int) -> tuple[Array, Array]:
    """Joint angles of the moving limb above both points, on the branches of `Edge.pair` [rad]."""
    out, robots = Angles.rows(2), graph.checks.robots
    points = regrasp.before[regrasp.limb], regrasp.to_point
    for side, (point, branch) in enumerate(zip(points, divmod(pair, 8), strict=True)):
        base, grasp = (
            pose(regrasp.positions[side], regrasp.rotations[side]),
            graph.solver.grasps[point],
        )
        angles_above(robots, regrasp.limb, base, grasp, branch, out[side])
    return out["q"][0], out["q"][1]


def nearest_end(end: Array, turns: tuple[Array, Array], joints: Array) -> Array:
    """The posture at the end on the windings nearest to `joints`, within allowed turns [rad]."""
    nearest: Array = end + 2.0 * np.pi * np.clip(np.rint((joints - end) / (2.0 * np.pi)), *turns)
    return nearest


def _without_stops(knots: Array) -> Array:
    """Knots without those that repeat the one before."""
    moved = np.abs(np.diff(knots, axis=0)).max(axis=1) > 1e-9
    kept: Array = knots[np.concatenate([[True], moved])]
    return kept


def _knot(u: float, joints: Array) -> Array:
    return np.concatenate([[u], joints])


def _angles(joints: Array) -> Angles:
    """Joint angles, shape (6,) [rad], as compiled code takes them."""
    out: Angles = Angles.row()
    out["q"] = joints
    return out
