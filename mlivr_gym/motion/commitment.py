"""From states to motion: what the robot is committed to on each step, branch, winding and swing.

The stance graph keeps the branches that limbs may be on; a robot is on one of them, with one
winding of every joint. `commit` finds the swing of a step and the winding on which the limb grasps,
for plans and for the simulation alike. `committed_motion` does so for a sequence of states, where
the branches of the whole walk are chosen together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.kinematics.base_path import PATH_KINDS, STRAIGHT
from mlivr_gym.kinematics.holding import LIMIT_TOLERANCE, Leg, Track, follow_hold
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.motion.plan_parts import Motion, Step
from mlivr_gym.motion.regrasp import UNCHECKED_KNOTS, Regrasp, RegraspPath
from mlivr_gym.motion.swings import SwingFinder, line_of_edge
from mlivr_gym.postures.records import HeldStance, PostureRoom, Tried
from mlivr_gym.postures.selection import base_along, reach_all
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.edge import Edge
from mlivr_gym.transitions.state import State, moving_limb

FULL_TURN = 2.0 * np.pi


class Committed(NamedTuple):
    """A step that the robot is committed to."""

    regrasp: Regrasp
    """The step with the knots of its swing, and the joint angles with which the limb grasps."""
    swing: str
    """Kind of the swing, one of `plan_parts.SWING_KINDS`."""


class CommittedMotion(NamedTuple):
    """The motion of a walk, or why there is none."""

    motion: Motion | None
    """The motion; None if a step cannot be executed."""
    failed: int | None
    """Index of a step that joint limits or shapes forbid on the branches chosen, or None."""


class _Hold(NamedTuple):
    """A time in which a limb holds one point: its last stance, and the whole turns it may take.

    `fewest` and `most` may be added to its joint angles without leaving the limits, each (6,).
    """

    last: int
    fewest: Array
    most: Array


def turns_within_limits(graph: StanceGraph, low: Array, high: Array) -> tuple[Array, Array]:
    """Fewest and most whole turns that may be added to angles without leaving the limits.

    Args:
        graph: The stance graph.
        low: Least angle of each joint [rad], shape (6,).
        high: Largest angle of each joint [rad], shape (6,).

    Returns:
        Two arrays of shape (6,).
    """
    limits = graph.robot.limb.limits
    fewest = np.ceil((limits[:, 0] - LIMIT_TOLERANCE - low) / FULL_TURN)
    most = np.floor((limits[:, 1] + LIMIT_TOLERANCE - high) / FULL_TURN)
    return fewest, most


def commit(
    graph: StanceGraph, regrasp: Regrasp, edge: Edge, turns: tuple[Array, Array] | None = None
) -> Committed | None:
    """Commit the robot to a step, or None if no swing is found for it.

    Args:
        graph: The stance graph.
        regrasp: The step on the branches chosen, without a swing.
        edge: How the graph has shown it, on these branches.
        turns: Fewest and most whole turns that may be added to the angles with which the limb
            grasps, each (6,); by default those that leave its approach inside the limits.
    """
    if not graph.settings.collisions:
        return Committed(regrasp, "unchecked")
    path = RegraspPath(graph, regrasp)
    start, down = path.departure(np.ones(1))[0], path.approach(np.zeros(1))
    if turns is None:
        down = path.approach(np.array([0.0, 1.0]))
        turns = turns_within_limits(graph, down.min(axis=0), down.max(axis=0))
    line = None if edge.pair < 0 else line_of_edge(graph, regrasp, edge.pair)
    finder = SwingFinder.of(graph, regrasp)
    swing = finder.find(start, down[0], turns, edge.fold, line)
    if swing is None:
        return None
    turned = FULL_TURN * np.rint((swing.knots[-1, 1:] - down[0]) / FULL_TURN)
    grasp_joints = regrasp.grasp_joints + turned
    return Committed(replace(regrasp, grasp_joints=grasp_joints, knots=swing.knots), swing.kind)


def holds(points: IntArray, limb: int) -> list[tuple[int, int]]:
    """First and last stance of each time `limb` holds one point; `points` has shape (K, N)."""
    spans, first = [], 0
    for k in range(1, len(points) + 1):
        if k == len(points) or points[k, limb] != points[first, limb]:
            spans.append((first, k - 1))
            first = k
    return spans


def committed_motion(
    graph: StanceGraph, states: Sequence[State], start_joints: Array | None = None
) -> CommittedMotion:
    """The motion of a walk.

    For each time a limb holds, the branch is the one kept at its end that has the largest least
    `w_m` over the hold; of equal ones the first. Joint angles are continuous over a hold, on the
    winding inside the limits that is nearest to where the limb was before.

    Args:
        graph: The stance graph.
        states: K states, each with the branches kept.
        start_joints: Joint angles of the limbs at the start, shape (N, 6) [rad], if given.
    """
    draft = _Draft(graph, states)
    failed = draft.set_joints(start_joints)
    steps = []
    for k in range(len(states) - 1):
        committed = None if failed is not None else draft.commit(k)
        if failed is None and committed is None:
            failed = k
        if committed is not None:
            steps.append(draft.step(k, committed))
    if failed is not None:
        return CommittedMotion(None, failed)
    w_m, w_b = draft.manipulability()
    motion = Motion(
        stances=tuple(graph.ids(state.stance) for state in states),
        steps=tuple(steps),
        base_positions=draft.postures.base_position,
        base_quaternions=quaternion(draft.postures.base_rotation),
        joint_positions=draft.joints,
        branches=draft.branches,
        w_m=w_m,
        w_b=w_b,
    )
    return CommittedMotion(motion, None)


class _Draft:
    """A motion in the making: branches first, then joint angles, then swings."""

    def __init__(self, graph: StanceGraph, states: Sequence[State]) -> None:
        self.graph, self.states = graph, states
        self.points: IntArray = np.array([state.stance for state in states])
        self.postures = graph.postures_of(states)
        count, limbs, solver = len(states), graph.limbs, graph.solver
        held, self._tried, self._room = (
            HeldStance.rows(count),
            Tried.rows(count),
            PostureRoom.rows(1),
        )
        held["grasps"][:, :limbs] = solver.grasps[self.points]
        self._bases = self._tried["base"] = self.postures.base_rows
        reach_all(graph.checks.robots, held, self._tried, self._room)
        self._w: Array = self._tried["limbs"]["w"][:, :limbs]
        self.branches: IntArray = self.postures.branch.copy()
        self.flips: IntArray = np.zeros((count, limbs), dtype=np.int64)
        self.edges: list[Edge] = []
        if graph.settings.transitions:
            allowed = [self._choose_branches(limb) for limb in range(limbs)]
            self.edges = self._edges()
            if self._take_lines(allowed):
                self.edges = self._edges()
        self.pivots = self._pivots()
        self.joints: Array = np.empty((count, limbs, 6))
        self._holds: list[dict[int, _Hold]] = []

    def _choose_branches(self, limb: int) -> dict[int, int]:
        """Choose the branch of each hold; returns the branches allowed, by its first stance."""
        graph, allowed = self.graph, {}
        for first, last in holds(self.points, limb):
            mask = self.states[last].masks[limb]
            if graph.settings.collisions and last < len(self.points) - 1:
                here = self.postures.take(slice(last, last + 1))
                mask &= graph.released(self.states[last].stance, here, limb)
            least = self._w[first : last + 1, limb].min(axis=0)
            bits = [bit for bit in range(16) if mask >> bit & 1]
            bit = max(bits, key=lambda b: (round(float(least[(b & 7) >> 1]), 12), -b))
            self.branches[first : last + 1, limb] = bit & 7
            self.flips[first : last + 1, limb] = bit >> 3
            allowed[first] = mask
        return allowed

    def _edges(self) -> list[Edge]:
        """How each step is made on the branches and flips chosen."""
        bits, edges = self.branches + 8 * self.flips, []
        for k in range(len(self.points) - 1):
            masks = tuple(1 << int(bit) for bit in bits[k])
            state = self.states[k]._replace(masks=masks)
            both = self.postures.take(slice(k, k + 2))
            edges.append(self.graph.edge(state, self.states[k + 1].stance, both))
        return edges

    def _take_lines(self, allowed: list[dict[int, int]]) -> bool:
        """Put limbs on the branches of the line swings that the graph knows, where they may be.

        Returns whether any was changed.
        """
        changed = False
        for k, edge in enumerate(self.edges):
            if edge.pair < 0:
                continue
            limb = moving_limb(self.states[k].stance, self.states[k + 1].stance)
            spans = holds(self.points, limb)
            for stance, wanted in ((k, edge.pair >> 3), (k + 1, edge.pair & 7)):
                first, last = next(span for span in spans if span[0] <= stance <= span[1])
                bit = wanted + 8 * int(self.flips[first, limb])
                if self.branches[first, limb] != wanted and allowed[limb][first] >> bit & 1:
                    self.branches[first : last + 1, limb] = wanted
                    changed = True
        return changed

    def _pivots(self) -> Array:
        """Centroid of the held points of each step [m], shape (K - 1, 3)."""
        held = self.points[:-1] == self.points[1:]
        positions = self.graph.grasp_map.positions[self.points[:-1]]
        centres: Array = (positions * held[..., None]).sum(axis=1) / held.sum(axis=1)[:, None]
        return centres

    def set_joints(self, start_joints: Array | None) -> int | None:
        """Set the joint angles at every stance, continuous over each hold.

        The first hold of a limb is on the windings of `start_joints`, shape (N, 6) [rad], if they
        are given. Returns the last step of a hold that does not fit inside the limits, or None.
        """
        failed = None
        for limb in range(self.graph.limbs):
            before = np.zeros(6)
            self._holds.append({})
            for first, last in holds(self.points, limb):
                low, high = self._follow_hold(limb, first, last)
                fewest, most = turns_within_limits(self.graph, low, high)
                if self.edges and (fewest > most).any():
                    failed = last - 1
                most = np.maximum(fewest, most)
                here = self.joints[first : last + 1, limb]
                if first == 0 and start_joints is not None:
                    given = np.rint((start_joints[limb] - here[0]) / FULL_TURN)
                    if self.edges and ((given < fewest) | (given > most)).any():
                        failed = last - 1
                    fewest = most = given
                nearest = np.clip(np.rint((before - here[0]) / FULL_TURN), fewest, most)
                here += FULL_TURN * nearest
                self._holds[limb][first] = _Hold(last, fewest - nearest, most - nearest)
                before = here[-1]
        return failed

    def _follow_hold(self, limb: int, first: int, last: int) -> tuple[Array, Array]:
        """Set the joint angles of one hold on any winding.

        Returns the least and the largest angle of each joint over the hold, each (6,) [rad].
        """
        steps, point = range(first, last + 1), self.points[first, limb]
        legs, tracks, out = Leg.rows(len(steps)), Track.rows(1), Angles.rows(len(steps))
        legs["anew"] = not self.edges
        for leg, k in zip(legs, steps, strict=True):
            if self.edges and k < last:
                leg["moves"], leg["kind"], leg["pivot"] = True, self.edges[k].kind, self.pivots[k]
            # Where the limb grasps and where it leaves, it also moves along the normal.
            ends = k == first > 0 or k == last < len(self.points) - 1
            leg["lifts"] = bool(self.edges) and ends
        tracks["q"], tracks["low"], tracks["high"] = np.nan, np.inf, -np.inf
        follow_hold(
            self.graph.checks.robots,
            limb,
            self.graph.solver.grasps[point : point + 1],
            self._bases[first : last + 1],
            legs,
            int(self.branches[first, limb]),
            out,
            tracks,
        )
        self.joints[first : last + 1, limb] = out["q"]
        low, high = tracks["low"][0].copy(), tracks["high"][0].copy()
        half_turn = np.pi * self.flips[first, limb]
        self.joints[first : last + 1, limb, 5] += half_turn
        low[5] += half_turn
        high[5] += half_turn
        return low, high

    def commit(self, k: int) -> Committed | None:
        """Commit the robot to step `k`, and the limb to the windings on which it grasps."""
        limb = moving_limb(self.states[k].stance, self.states[k + 1].stance)
        regrasp = Regrasp(
            limb=limb,
            before=self.states[k].stance,
            to_point=self.states[k + 1].stance[limb],
            positions=self.postures.base_position[k : k + 2],
            rotations=self.postures.base_rotation[k : k + 2],
            kind=self.edges[k].kind if self.edges else STRAIGHT,
            pivot=self.pivots[k],
            branches=(*self.branches[k].tolist(), int(self.branches[k + 1, limb])),
            joints=self.joints[k],
            grasp_joints=self.joints[k + 1, limb],
            knots=UNCHECKED_KNOTS,
        )
        if not self.edges:
            return Committed(regrasp, "unchecked")
        last, fewest, most = self._holds[limb][k + 1]
        committed = commit(self.graph, regrasp, self.edges[k], (fewest, most))
        if committed is not None:
            turned = committed.regrasp.grasp_joints - regrasp.grasp_joints
            self.joints[k + 1 : last + 1, limb] += turned
        return committed

    def step(self, k: int, committed: Committed) -> Step:
        """Step `k` as a plan has it."""
        regrasp, ids = committed.regrasp, self.graph.grasp_map.ids
        x, y, z = regrasp.pivot.tolist()
        return Step(
            limb=regrasp.limb,
            from_point=ids[regrasp.before[regrasp.limb]],
            to_point=ids[regrasp.to_point],
            path=PATH_KINDS[regrasp.kind] if self.edges else "unchecked",
            pivot=(x, y, z),
            displacement=float(np.linalg.norm(regrasp.positions[1] - regrasp.positions[0])),
            swing=committed.swing,
            knots=tuple(tuple(knot) for knot in regrasp.knots.tolist()),
        )

    def manipulability(self) -> tuple[Array, Array]:
        """Limb manipulability (K, N) and base manipulability (K,) on the branches chosen."""
        w_m: Array = np.take_along_axis(self._w, self.branches[..., None] >> 1, axis=2)[..., 0]
        w_b = np.empty(len(self.points))
        base_along(self.graph.checks.robots, self._tried, self.branches, self._room, w_b)
        return w_m, w_b
