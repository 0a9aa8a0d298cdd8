"""The way of the limb that moves: from above the point it leaves to above the point it takes hold of.

A swing is a chain of knots: where the base is on its path, from 0 to 1, and the limb's six joint
angles; between knots both change linearly together. The shortest kind that touches nothing is
taken:

* `direct`: one line in joint space while the base moves;
* `over`: by way of one of the robot's folds, the base moving all along;
* `folded`: fold, move the base, unfold; this is what the stance graph has shown to be possible for
  most steps;
* `changed`: change to another branch at rest, swing in a line while the base moves, change again;
  this is what it has shown for the others;
* `sampled`: as one of the last two, on ways found by a sampling planner, where a limb has turned so
  far while it held that the ways known to the graph would leave its joint limits.

Each line is checked as a whole, see `swept_kernels`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.swept_hold import BOTH, hold_free
from mlivr_gym.collisions.swept_swing import swing_free
from mlivr_gym.motion.sampling import sampled_line
from mlivr_gym.postures.solver import Postures
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.grasp_poses import fold_near, line_end
from mlivr_gym.transitions.line_swings import lifted_at

Array = NDArray[np.float64]

SWING_KINDS = ("direct", "over", "folded", "changed", "sampled", "unchecked")
"""Names of the kinds of swings, the shortest first; `unchecked` where collisions are not looked at."""


class Hold(NamedTuple):
    """A limb that holds a point on a branch while another moves."""

    limb: int
    point: int
    branch: int


class Swing(NamedTuple):
    """A swing: its kind, and its knots (k, 7), base parameter and joint angles [rad]."""

    kind: str
    knots: Array


class SwingFinder:
    """Finds the swing of one step.

    Attributes:
        graph: The stance graph.
        limb: The limb that moves.
        path: Base path (t0, r0, t1, r1, kind, pivot).
        holds: The limbs that hold.
    """

    def __init__(
        self, graph: StanceGraph, limb: int, path: tuple[Any, ...], holds: list[Hold]
    ) -> None:
        """Look at the step in which `limb` moves while the base follows `path`."""
        self.graph, self.limb, self.path, self.holds = graph, limb, path, holds

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
            end: Joint angles above the point it lands on, on any winding.
            turns: Fewest and most whole turns that may be added to `end`, each (6,).
            fold: The fold in which the graph has shown that the limb can be carried, or -1.
            line: Joint angles between which it has shown that the limb can swing, where it cannot
                be carried folded.
        """
        for kind, knots in self._ways(start, end, turns, fold, line):
            if self.clear(knots):
                return Swing(kind, knots)
        sampled = self._sampled(start, end, turns, self.carriage(fold, line, start))
        return None if sampled is None else Swing("sampled", sampled)

    def _sampled(
        self,
        start: Array,
        end: Array,
        turns: tuple[Array, Array],
        carriage: tuple[Array, Array] | None,
    ) -> Array | None:
        """Sampled knots at rest, a line while the base moves, sampled knots at rest; None if none are found.

        The whole is checked like any other swing, so what the sampling planner skips between its
        postures does no harm.
        """
        if carriage is None:
            return None
        limits = self.graph.robot.limb.limits
        away = sampled_line(self.clear, limits, _knot(0.0, start), _knot(0.0, carriage[0]))
        if away is None:
            return None
        last = _knot(1.0, landing(end, turns, carriage[1]))
        back = sampled_line(self.clear, limits, _knot(1.0, carriage[1]), last)
        if back is None:
            return None
        knots = np.vstack([away, back])
        return knots if self.clear(knots) else None

    def carriage(
        self, fold: int, line: tuple[Array, Array] | None, start: Array
    ) -> tuple[Array, Array] | None:
        """Joint angles at both ends of the base path as the graph has shown it, on windings near `start`; None outside the limits."""
        if line is None:
            folded = self.fold(fold, start)
            return None if folded is None else (folded, folded)
        first, last = np.empty(6), np.empty(6)
        limits = self.graph.solver.limits
        if (
            max(line_end(start, line[0], limits, first), line_end(first, line[1], limits, last))
            == np.inf
        ):
            return None
        return first, last

    def _ways(
        self,
        start: Array,
        end: Array,
        turns: tuple[Array, Array],
        fold: int,
        line: tuple[Array, Array] | None,
    ) -> Iterator[tuple[str, Array]]:
        yield "direct", np.stack([_knot(0.0, start), _knot(1.0, landing(end, turns, start))])
        count = len(self.graph.robot.folds)
        for index in range(count):
            middle = self.fold(index, start)
            if middle is not None:
                last = landing(end, turns, middle)
                yield "over", np.stack([_knot(0.0, start), _knot(0.5, middle), _knot(1.0, last)])
        if line is not None:
            yield from (("changed", knots) for knots in self._changed(start, end, turns, line))
        orders = sorted(range(count), key=lambda k: k != fold)
        for carried in orders:
            for first in orders:
                for last_fold in orders:
                    knots = self._folded(start, end, turns, (first, carried, last_fold))
                    if knots is not None:
                        yield "folded", knots

    def _folded(
        self, start: Array, end: Array, turns: tuple[Array, Array], way: tuple[int, int, int]
    ) -> Array | None:
        """Fold by way of one fold, move in another, unfold by way of a third."""
        knots = [_knot(0.0, start)]
        for k, u in zip(way, (0.0, 0.0, 1.0), strict=True):
            here = self.fold(k, knots[-1][1:])
            if here is None:
                return None
            if u == 1.0:
                knots.append(_knot(1.0, knots[-1][1:]))
            if np.abs(here - knots[-1][1:]).max() > 1e-9:
                knots.append(_knot(u, here))
        knots.append(_knot(1.0, landing(end, turns, knots[-1][1:])))
        return np.stack(knots)

    def _changed(
        self, start: Array, end: Array, turns: tuple[Array, Array], line: tuple[Array, Array]
    ) -> Iterator[Array]:
        """Change to the branch of the line, directly or by way of a fold, follow the line, and change again."""
        ways = [None, *range(len(self.graph.robot.folds))]
        for first in ways:
            knots = [_knot(0.0, start)]
            if first is not None:
                here = self.fold(first, start)
                if here is None:
                    continue
                knots.append(_knot(0.0, here))
            ends = self.carriage(-1, line, knots[-1][1:])
            if ends is None:
                continue
            knots += [_knot(0.0, ends[0]), _knot(1.0, ends[1])]
            for last in ways:
                here = ends[1] if last is None else self.fold(last, ends[1])
                if here is not None:
                    rest = [] if last is None else [_knot(1.0, here)]
                    yield _without_stops(
                        np.stack([*knots, *rest, _knot(1.0, landing(end, turns, here))])
                    )

    def fold(self, index: int, near: Array) -> Array | None:
        """A fold on the windings nearest to some joint angles [rad], or None outside the limits."""
        out = np.empty(6)
        return (
            out
            if fold_near(self.graph.solver.folds[index], near, self.graph.solver.limits, out)
            else None
        )

    def clear(self, knots: Array) -> bool:
        """Whether the robot touches nothing along a chain of knots."""
        solver, limb = self.graph.solver, self.limb
        for collision_model, inside in self.graph.checks:
            shapes, _, hand, fixed, world, clearance, body = collision_model
            none = np.empty((0, len(shapes[0]), 2, 3))
            for a, b in zip(knots, knots[1:], strict=False):
                ends = (self.path, a[0], b[0])
                found = swing_free(
                    limb, *ends, a[1:], b[1:], solver.lengths, solver.mount_rotations[limb],
                    solver.mount_positions[limb],
                    none, shapes, fixed, world, clearance, inside, body,
                )  # fmt: skip
                if found != CLEAR:
                    return False
                for hold in self.holds:
                    found = hold_free(
                        hold.limb, self.graph.solver.flanges[hold.point], solver.tools[hold.point],
                        *ends, hold.branch, solver.lengths,
                        solver.mount_rotations[hold.limb], solver.mount_positions[hold.limb], a[1:],
                        b[1:],
                        solver.mount_rotations[limb], solver.mount_positions[limb], shapes, hand,
                        fixed, world, clearance, inside, BOTH,
                    )  # fmt: skip
                    if found != CLEAR:
                        return False
        return True


def direct_line(
    graph: StanceGraph, limb: int, points: Sequence[int], postures: Postures, pair: int
) -> tuple[Array, Array]:
    """Joint angles of a limb above two points, in two postures, on the branches `pair` of `step_checks.Way` [rad]."""
    solver, robot = graph.solver, graph.robot
    out = np.empty((2, 8, 6))
    branches = pair >> 3, pair & 7
    for side in range(2):
        point = points[side]
        lifted_at(
            limb, 1 << branches[side], solver.points[point], solver.normals[point],
            solver.rails[point], robot.tool_length,
            robot.lift, postures.position[side], postures.rotation[side], solver.mount_rotations,
            solver.mount_positions,
            solver.lengths, solver.limits, out[side],
        )  # fmt: skip
    return out[0, branches[0]], out[1, branches[1]]


def landing(end: Array, turns: tuple[Array, Array], near: Array) -> Array:
    """The landing posture on the windings nearest to some joint angles, within the turns allowed [rad]."""
    nearest: Array = end + 2.0 * np.pi * np.clip(np.rint((near - end) / (2.0 * np.pi)), *turns)
    return nearest


def _without_stops(knots: Array) -> Array:
    """Knots without those that repeat the one before."""
    moved = np.abs(np.diff(knots, axis=0)).max(axis=1) > 1e-9
    return knots[np.concatenate([[True], moved])]


def _knot(u: float, joints: Array) -> Array:
    return np.concatenate([[u], joints])
