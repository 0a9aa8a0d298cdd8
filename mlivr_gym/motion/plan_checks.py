"""Checks of a loaded plan: its values are recomputed, and must be those that follow.

Query and world are taken from the plan. Points, base pose and branches of each stance determine the
joint angles, the manipulability, the base path and the swing of each step, and these the cost.
Whether the goal is reached, each stance can be held, and each step is an edge of the graph, is
checked as when the plan was made.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.bit_sets import bits_of
from mlivr_gym.errors import MlivrError, PlanError, shortened
from mlivr_gym.kinematics.chain import LIMIT_TOLERANCE
from mlivr_gym.kinematics.limb import Angles, held_angles
from mlivr_gym.kinematics.poses import poses, quaternion
from mlivr_gym.motion.commitment import CommittedMotion, commitments, committed_motion
from mlivr_gym.motion.joint_path import HOLD_TOLERANCE, JointPath, flange_in_body
from mlivr_gym.motion.plan_parts import CUSTOM, Motion, Query, Statistics, Step, World, step_along
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.postures.postures import FIELDS, Postures
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import GraspMap

TOLERANCE = 1e-7
"""Largest deviation of a given number from the recomputed one [m, rad, or relative].

A file keeps every bit of a number, and a base orientation as a quaternion loses 1e-16. Close to a
singularity joint angles and manipulability change by the square root of that, 1e-8.
"""

SAME_POSE = 1e-9
"""Base poses that deviate less from the posture of the stance are equal to it [m, rad]."""

FLIP = np.diag([-1.0, -1.0, 1.0])
"""Half a turn of a tool about its axis, the symmetry of a grasp."""


def check_totals(query: Query, motion: Motion, statistics: Statistics) -> None:
    """Check the displacements, the cost and the goal of a plan against its base positions.

    Raises a `PlanError` if a value differs; the message names the field, the given value and the
    expected one.
    """
    if (query.cost_name == "weighted") != (query.regrasp_price is not None):
        raise PlanError(
            f"query.regrasp_price is {shortened(query.regrasp_price)} and query.cost_name "
            f"{query.cost_name!r}; a price goes with 'weighted' and only with it"
        )
    priced = f"cost_name {query.cost_name!r}, regrasp_price {query.regrasp_price!r}"
    positions = motion.base_positions
    away = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    for k, step in enumerate(motion.steps):
        _compare(f"motion.steps[{k}].displacement", step.displacement, float(away[k]))
    expected = statistics.cost if query.cost_name == CUSTOM else query.cost_of(positions)
    if not abs(statistics.cost - expected) <= TOLERANCE * max(1.0, expected):
        raise _mismatch("statistics.cost", statistics.cost, f"{expected!r} (query.{priced})")
    short = float(np.linalg.norm(positions[-1] - np.array(query.goal)))
    if short > query.goal_tolerance + TOLERANCE:
        raise PlanError(
            f"query.goal is {shortened(list(query.goal))}, to be reached within "
            f"{query.goal_tolerance!r} m; the last base position "
            f"{shortened(positions[-1].tolist())} is {short!r} m away from it"
        )


def check_motion(query: Query, world: World, motion: Motion, grasp_map: GraspMap) -> None:
    """Check the motion of a plan against its stances, base poses and branches.

    Raises a `PlanError` if a value differs; the message names the field, the given value and the
    expected one.
    """
    try:
        graph = _graph(world, grasp_map)
        points = np.array([graph.indices(stance) for stance in motion.stances])
    except MlivrError as error:
        raise PlanError(f"the plan has a faulty field: {error}") from None
    for point in motion.stances[-1] if query.goal_face else ():
        face = grasp_map.faces[grasp_map.index(point)]
        if face != query.goal_face:
            goal = f"query.goal_face is {query.goal_face!r}; the last stance"
            raise PlanError(f"{goal} holds {point!r} on face {face!r}")
    bits = _branch_bits(graph, points, motion)
    postures = _postures(graph, points, motion, bits)
    branch_sets = (1 << bits).tolist()
    states = [
        State(tuple(stance), tuple(branch_set))
        for stance, branch_set in zip(points.tolist(), branch_sets, strict=True)
    ]
    if world.settings.transitions:
        for k, (state, after) in enumerate(pairwise(states)):
            kept = graph.kept_on_step(state, after.stance, postures.take(slice(k, k + 2)))
            _check_kept(k, motion.steps[k], kept, bits[k])
    _check_steps(graph, motion, committed_motion(graph, states, postures))


def _graph(world: World, grasp_map: GraspMap) -> StanceGraph:
    """Return a stance graph of the world of a plan, which computes nodes and edges on demand."""
    graph = StanceGraph(grasp_map, world.robot, world.settings)
    graph.add_obstacles(world.obstacles)
    graph.occupy(world.occupied)
    return graph


def _branch_bits(graph: StanceGraph, points: IntArray, motion: Motion) -> IntArray:
    """Return the branch and flip of each limb as `branch + 8 * flip`, shape (K, N).

    Raises a `PlanError` if the limbs do not hold their points with these joint angles, or are on
    other branches.
    """
    angles = Angles.rows(16, *points.shape)
    base = poses(motion.base_positions, motion.base_rotations)
    for bit in range(16):
        every, grasps = np.full(points.shape, bit), graph.solver.grasps[points]
        held_angles(graph.checks.robots, base, grasps, every, angles[bit])
    away = np.abs(angles["q"] - motion.joint_positions).max(axis=3)
    away = np.nan_to_num(away, nan=np.inf)
    flipped = np.take_along_axis(away, np.stack([motion.branches, motion.branches + 8]), axis=0)
    bits: IntArray = motion.branches + 8 * flipped.argmin(axis=0)
    for k, i in np.argwhere(flipped.min(axis=0) > TOLERANCE).tolist():
        nearest = int(away[:, k, i].argmin())
        if away[nearest, k, i] <= TOLERANCE:
            raise _mismatch(f"motion.branches[{k}][{i}]", int(motion.branches[k, i]), nearest % 8)
        _check_base(graph, points[k], motion, k)
        _compare(
            f"motion.joint_positions[{k}][{i}]",
            motion.joint_positions[k, i].tolist(),
            angles["q"][bits[k, i], k, i].tolist(),
        )
    for k, step in enumerate(motion.steps):
        for i in np.flatnonzero(bits[k] != bits[k + 1]).tolist():
            if i != step.limb and graph.settings.transitions:
                raise _mismatch(
                    f"motion.branches[{k + 1}][{i}]", *(bits[[k + 1, k], i] % 8).tolist()
                )
    return bits


def _check_base(graph: StanceGraph, points: IntArray, motion: Motion, k: int) -> None:
    """Check the base pose of stance `k`; raise an error if all limbs agree on another one."""
    given = motion.base_rotations[k]
    positions, turns = np.empty((graph.limbs, 3)), np.empty((graph.limbs, 3, 3))
    for i, joints in enumerate(motion.joint_positions[k]):
        position, turn = flange_in_body(graph.robot, i, joints)
        flange = graph.solver.grasps[points[i]]["flange"]
        turns[i] = min(
            (flange["rotation"] @ flip @ turn.T for flip in (np.eye(3), FLIP)),
            key=lambda turn: np.abs(turn - given).max(),
        )
        positions[i] = flange["position"] - turns[i] @ position
    if max(np.ptp(positions, axis=0).max(), np.ptp(turns, axis=0).max()) < TOLERANCE:
        _compare(
            f"motion.base_positions[{k}]", motion.base_positions[k].tolist(), positions[0].tolist()
        )
        expected = quaternion(turns[0])
        expected = expected if expected @ motion.base_quaternions[k] > 0.0 else -expected
        _compare(
            f"motion.base_quaternions[{k}]", motion.base_quaternions[k].tolist(), expected.tolist()
        )


def _postures(graph: StanceGraph, points: IntArray, motion: Motion, bits: IntArray) -> Postures:
    """Return the postures of the stances at the given base poses.

    That is the posture of the stance if its base pose is the given one, and otherwise a posture at
    a pose that a user or a refinement chose. Such a pose may have been evaluated without the
    thresholds, and on them the allowed branches depend. Raises a `PlanError` if a stance cannot be
    held on the given branches, or is not a node.
    """
    turns, chosen = motion.base_rotations, graph.postures(points)
    off = np.abs(chosen.base_position - motion.base_positions).max(axis=1)
    off = np.maximum(off, np.abs(chosen.base_rotation - turns).max(axis=(1, 2)))
    same = off < SAME_POSE
    node, held = same & graph.is_node(chosen), same & (chosen.branch_sets >> bits & 1).all(axis=1)
    needed = graph.settings.thresholds(graph.limbs)
    for thresholds in (needed, (0.0, 0.0)):
        if not (held & node).all():
            at = graph.postures_at(points, motion.base_positions, turns, thresholds)
            node |= graph.is_node(at) & (thresholds == needed)
            for name in FIELDS:
                getattr(chosen, name)[~held] = getattr(at, name)[~held]
            held |= (chosen.branch_sets >> bits & 1).all(axis=1)
    for k in np.flatnonzero(~held).tolist():
        i = int(np.argmin(chosen.branch_sets[k] >> bits[k] & 1))
        can = sorted({bit % 8 for bit in bits_of(chosen.branch_sets[k, i])})
        raise _mismatch(f"motion.branches[{k}][{i}]", int(motion.branches[k, i]), f"one of {can}")
    for k in (np.flatnonzero(~node[1:]) + 1).tolist():  # the user may have chosen the first
        raise PlanError(
            f"motion.stances[{k}] is {motion.stances[k]}, on which w_m is "
            f"{chosen.w_m[k].tolist()} and w_b {float(chosen.w_b[k])!r} at most; the world's "
            f"thresholds are {graph.limb_threshold!r} and {graph.base_threshold!r}"
        )
    return chosen


def _check_kept(k: int, step: Step, kept: dict[int, int], bits: IntArray) -> None:
    """Check that each support limb keeps its bit on step k, of which `kept` tells, shape (N,)."""
    for i, bit in enumerate(bits.tolist()):
        if i != step.limb and not kept.get(i, 0) >> bit & 1:
            branches = sorted({b % 8 for b in bits_of(kept.get(i, 0))})
            raise PlanError(
                f"motion.steps[{k}] moves limb {step.limb} to {step.to_point!r}; limb {i} is "
                f"on branch {bit % 8} and could follow the base on {branches or 'none'}"
            )


def _check_steps(graph: StanceGraph, motion: Motion, expected: CommittedMotion) -> None:
    """Check that the motion equals the recomputed one."""
    if expected.motion is None:
        k = expected.failed or 0
        raise _mismatch(f"motion.steps[{k}].swing", motion.steps[k].swing, "no swing that is clear")
    for name in ("branches", "joint_positions", "w_m", "w_b"):
        _compare(f"motion.{name}", *(getattr(one, name) for one in (motion, expected.motion)))
    for k, step in enumerate(motion.steps):
        place = f"motion.steps[{k}]"
        if step.swing != "unchecked":
            path, holds = motion.joint_path(graph.robot, k), motion.joint_positions[k : k + 2]
            for end, hold in ((0, holds[0]), (len(path.knots) - 1, holds[1])):
                _compare(f"{place}.knots[{end}]", path.knots[end], hold)
            _check_joint_path(place, path)
        _compare(place, vars(step), vars(_same_swing(graph, expected, k, step)))


def _check_joint_path(place: str, path: JointPath) -> None:
    """Check that supports hold their points along a joint path, and joints stay in their windows.

    On a line between two knots grippers of support limbs are farthest off in the middle.
    """
    middles = 0.5 * (path.knots[1:] + path.knots[:-1])
    for name, joints, most in (("at", path.knots, TOLERANCE), ("after", middles, HOLD_TOLERANCE)):
        slips = path.slips(joints)
        k = int(slips.argmax())
        if slips[k] > most:
            raise PlanError(
                f"{place}.knots: {name} knot {k} the support limbs are {float(slips[k])!r} m "
                f"off their points; it may be {most!r} m"
            )
    windows = np.array([limb.windows for limb in path.robot.every_limb])
    excess = np.maximum(windows[..., 0] - path.knots, path.knots - windows[..., 1])
    if excess.max() > LIMIT_TOLERANCE:
        n, limb, joint = np.unravel_index(int(excess.argmax()), excess.shape)
        raise PlanError(
            f"{place}.knots[{n}][{limb}][{joint}] is {float(path.knots[n, limb, joint])!r}, "
            f"outside the window of the joint, {windows[limb, joint].tolist()}"
        )


def _same_swing(graph: StanceGraph, expected: CommittedMotion, k: int, step: Step) -> Step:
    """Return step `k` with the clear swing that a plan may have chosen, or that it should have."""
    assert expected.motion is not None
    expected_step = expected.motion.steps[k]
    if graph.settings.transitions and not _is_along(step, expected_step):
        ends = StepEnds.of(graph, expected.motion, k)
        for path, swing in commitments(graph, ends):
            if path is not None and _is_along(step, step_along(expected_step, path, swing)):
                return step_along(expected_step, path, swing)
    return expected_step


def _is_along(step: Step, other: Step) -> bool:
    """Return whether two steps have the same knots, up to rounding."""
    here, there = step.knots, other.knots
    return here.shape == there.shape and bool(np.abs(here - there).max(initial=0.0) <= TOLERANCE)


def _compare(path: str, given: Any, expected: Any) -> None:
    """Raise an error at the first value, in nested data too, that differs from the expected one."""
    if isinstance(given, np.ndarray):
        given, expected = given.tolist(), expected.tolist()
    if isinstance(given, dict):
        for name, value in given.items():
            _compare(f"{path}.{name}", value, expected[name])
    elif isinstance(given, (list, tuple)) and len(given) == len(expected):
        for k, pair in enumerate(zip(given, expected, strict=True)):
            _compare(f"{path}[{k}]", *pair)
    elif isinstance(given, float):
        if not abs(given - expected) <= TOLERANCE * max(1.0, abs(expected)):
            raise _mismatch(path, given, expected)
    elif given != expected:
        raise _mismatch(path, given, expected)


def _mismatch(path: str, given: object, expected: object) -> PlanError:
    """Return the error for a value that differs from the recomputed one."""
    text = expected if isinstance(expected, str) else shortened(expected)
    return PlanError(f"{path} is {shortened(given)}; recomputed, it is {text}")
