"""From states to motion: branches and joint path that the robot commits to on each step.

A state of the stance graph holds the set of branches on which each limb may be; a robot is on one
of them, with each joint angle in its window. `commit` chooses the joint path of one step, for plans
and for the simulation alike. `committed_motion` does so for a sequence of states, and chooses one
branch for each interval in which a limb holds a point.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import BRANCHES, bits_of
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.batches import distance
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.motion.paper_motion import paper_path
from mlivr_gym.motion.plan_parts import Motion, Step, step_along
from mlivr_gym.motion.step_ends import StepEnds, normal_knots, step_path
from mlivr_gym.motion.straight_base import FollowingSupports
from mlivr_gym.motion.swings import SwingFinder, swing_knot
from mlivr_gym.postures.postures import Postures
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State, moving_limb

CACHED_STEPS = 4096
"""Capacity of the cache `CommittedSteps`, in steps."""


class Committed(NamedTuple):
    """A committed step: branches and joint path are chosen."""

    path: JointPath | None
    """The joint path; None if steps are not checked and the limbs cannot follow."""
    swing: str
    """Kind of the swing, one of `plan_parts.SWING_KINDS`."""


class CommittedMotion(NamedTuple):
    """The motion of a walk, or the step at which it fails."""

    motion: Motion | None
    """The motion; None if a step cannot be executed."""
    failed: int | None
    """Index of the step for which no swing was found, or None."""


def commit(graph: StanceGraph, ends: StepEnds) -> Committed | None:
    """Choose the first of `commitments` for a step; return None if no clear swing exists."""
    return next(commitments(graph, ends), None)


def commitments(graph: StanceGraph, ends: StepEnds) -> Iterator[Committed]:
    """Yield a step on its branches with each of its clear swings, the preferred one first."""
    if not graph.settings.collisions:
        yield Committed(_unchecked_path(graph, ends), "unchecked")
        return
    lifts = normal_knots(graph, ends, 0), normal_knots(graph, ends, 1)
    supports = FollowingSupports(graph, ends)
    finder = SwingFinder(graph, ends, supports)
    for swing in finder.swings(lifts[0][-1], lifts[1][-1]):
        parts = [ends.joints[:1]]
        for a, b in pairwise(swing.knots):
            parts.append(supports.knots(a, b, parts[-1][-1]))
        yield Committed(step_path(graph, ends, lifts, parts[1:]), swing.kind)


def _unchecked_path(graph: StanceGraph, ends: StepEnds) -> JointPath | None:
    """Return a joint path on which collisions are not checked; None if a limb cannot follow.

    If supports are checked, they move as they were, and the other limb on one line.
    """
    try:
        if not graph.settings.transitions:
            return paper_path(graph, ends)
        lifts = normal_knots(graph, ends, 0), normal_knots(graph, ends, 1)
        above = swing_knot(0.0, lifts[0][-1]), swing_knot(1.0, lifts[1][-1])
        return step_path(
            graph, ends, lifts, [FollowingSupports(graph, ends).knots(*above, ends.joints[0])]
        )
    except PlanError:
        return None


class CommittedSteps:
    """A cache of the last `CACHED_STEPS` committed steps, of which walks on one graph share many.

    The key is everything on which a joint path depends; a change of the obstacles empties the
    cache.
    """

    step_time: ClassVar[float] = 0.05
    """Time that steps not in a cache took on this machine, the last ones above all [s].

    At first it lies between that of machine code and that of the interpreter.
    """

    def __init__(self, graph: StanceGraph) -> None:
        """Start with an empty cache for `graph`."""
        self.graph, self._obstacles = graph, graph.obstacles
        self._cached: OrderedDict[tuple[Any, ...], Committed | None] = OrderedDict()

    def commit(self, ends: StepEnds) -> Committed | None:
        """Return the result of the function `commit`, from the cache if it is stored there."""
        graph, cached = self.graph, self._cached
        if self._obstacles != graph.obstacles:
            cached.clear()
            self._obstacles = graph.obstacles
        arrays = ends.positions, ends.rotations, ends.joints
        key = (
            ends.limb, ends.before, ends.to_point, ends.branches,
            *(array.tobytes() for array in arrays),
        )  # fmt: skip
        if key not in cached:
            began = time.perf_counter()
            cached[key] = commit(graph, ends)
            took = time.perf_counter() - began
            CommittedSteps.step_time += 0.3 * (took - CommittedSteps.step_time)
            if len(cached) > CACHED_STEPS:
                cached.popitem(last=False)
        return cached[key]


def hold_intervals(points: IntArray, limb: int) -> list[tuple[int, int]]:
    """Return the first and last stance of each interval in which `limb` holds one point.

    The array `points` has the point index of each limb in each stance, shape (K, N).
    """
    intervals, first = [], 0
    for k in range(1, len(points) + 1):
        if k == len(points) or points[k, limb] != points[first, limb]:
            intervals.append((first, k - 1))
            first = k
    return intervals


def committed_motion(
    graph: StanceGraph,
    states: Sequence[State],
    postures: Postures | None = None,
    cache: CommittedSteps | None = None,
) -> CommittedMotion:
    """Compute the motion of a walk over K states: branches, joint angles and joint paths.

    For each interval in which a limb holds a point, the branch is the one that maximises the
    minimum `w_m` over the stances of the interval, among the branches of the last state on which
    the limb can be released; ties go to the lowest number. Postures are by
    default those of the graph; steps are looked up and stored in `cache`. Raises a `PlanError` if a
    limb has no branch on which it can be released for its next step, which does not occur for a
    walk of the graph.
    """
    draft = _MotionDraft(graph, states, graph.postures_of(states) if postures is None else postures)
    cache, steps = cache or CommittedSteps(graph), []
    for k in range(len(states) - 1):
        committed = draft.commit(k, cache)
        if committed is None:
            return CommittedMotion(None, k)
        steps.append(draft.step(k, committed))
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


class _MotionDraft:
    """A motion under construction: first branches, then joint angles, then joint paths."""

    def __init__(self, graph: StanceGraph, states: Sequence[State], postures: Postures) -> None:
        """Choose the branches of the walk, and compute its joint angles."""
        self.graph, self.states, self.postures = graph, states, postures
        self.points: IntArray = np.array([state.stance for state in states])
        count, limbs = len(states), graph.limbs
        self._twists = _twists(graph, self.points, self.postures)
        w = np.abs(np.linalg.det(np.nan_to_num(self._twists)))
        self._w: Array = np.minimum(w[..., ::2], w[..., 1::2])  # by classes of branches
        self.branches: IntArray = self.postures.branch.copy()
        self.flips: IntArray = np.zeros((count, limbs), dtype=np.int64)
        if graph.settings.transitions:
            for limb in range(limbs):
                self._choose_branches(limb)
        bits = self.branches + 8 * self.flips
        self.joints: Array = graph.joints(self.points, self.postures, bits)

    def _choose_branches(self, limb: int) -> None:
        """Choose the branches of a limb."""
        graph = self.graph
        for first, last in hold_intervals(self.points, limb):
            branch_set = self.states[last].branch_sets[limb]
            if graph.settings.collisions and last < len(self.points) - 1:
                here = self.postures.take(slice(last, last + 1))
                branch_set &= graph.releasable_branches(self.states[last].stance, here, limb)
            minimum = self._w[first : last + 1, limb].min(axis=0)
            bits = bits_of(branch_set)
            if not bits:
                point = graph.grasp_map.ids[self.points[last, limb]]
                raise PlanError(f"limb {limb} cannot be released from {point!r} at stance {last}")
            bit = max(bits, key=lambda b: (round(float(minimum[(b & 7) >> 1]), 9), -b))
            self.branches[first : last + 1, limb] = bit & 7
            self.flips[first : last + 1, limb] = bit >> 3

    def commit(self, k: int, cache: CommittedSteps) -> Committed | None:
        """Commit the robot to step `k`; return None if no clear swing exists."""
        limb = moving_limb(self.states[k].stance, self.states[k + 1].stance)
        ends = StepEnds(
            limb=limb,
            before=self.states[k].stance,
            to_point=self.states[k + 1].stance[limb],
            positions=self.postures.base_position[k : k + 2],
            rotations=self.postures.base_rotation[k : k + 2],
            branches=(*self.branches[k].tolist(), int(self.branches[k + 1, limb])),
            joints=self.joints[k : k + 2],
        )
        return cache.commit(ends)

    def step(self, k: int, committed: Committed) -> Step:
        """Return step `k` in the form in which a plan stores it."""
        ids, positions = self.graph.grasp_map.ids, self.postures.base_position
        limb = moving_limb(self.states[k].stance, self.states[k + 1].stance)
        step = Step(
            limb=limb,
            from_point=ids[self.points[k, limb]],
            to_point=ids[self.points[k + 1, limb]],
            leader=int(limb == 0),
            displacement=distance(positions[k + 1], positions[k]),
        )
        if committed.path is None:
            return step
        return step_along(step, committed.path, committed.swing)

    def manipulability(self) -> tuple[Array, Array]:
        """Return `w_m`, shape (K, N), and `w_b`, shape (K,), on the chosen branches."""
        w_m: Array = np.take_along_axis(self._w, self.branches[..., None] >> 1, axis=2)[..., 0]
        chosen = np.take_along_axis(self._twists, self.branches[..., None, None, None], axis=2)
        rates = np.linalg.inv(chosen[:, :, 0])
        inverse = (np.swapaxes(rates, 2, 3) @ rates).sum(axis=1)
        return w_m, 1.0 / np.sqrt(np.linalg.det(inverse))


def _twists(graph: StanceGraph, points: IntArray, postures: Postures) -> Array:
    """Return the normalised base twists of the joints on each branch, shape (K, N, 8, 6, 6).

    They are the columns of `SA`, see `manipulability`, with NaN where the branch does not exist.
    """
    robot, (count, limbs) = graph.robot, points.shape
    stances = np.repeat(np.arange(count), BRANCHES)
    bits = np.tile(np.arange(BRANCHES), count)[:, None] + np.zeros(limbs, dtype=np.int64)
    joints = graph.joints(points[stances], postures.take(stances), bits)
    joints = joints.reshape(count, BRANCHES, limbs, 6).swapaxes(1, 2)
    frames = [link_frames(limb, joints[:, i]) for i, limb in enumerate(robot.every_limb)]
    links = robot.mount_rotations[:, None, None] @ np.stack(frames, axis=1)[..., 1:, :3, :]
    axes, places = links[..., 2], links[..., 3] + robot.mount_positions[:, None, None]
    moments = np.cross(places, axes) / robot.characteristic_length
    return np.swapaxes(np.concatenate([moments, axes], axis=-1), -1, -2)
