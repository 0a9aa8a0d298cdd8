"""A plan that is loaded is worked out again: what it tells has to be what follows.

What was asked for and the world are told by the plan alone. From the points and the base pose of
each stance and the branch that each limb is on follow the joint angles, the manipulability, the
base path and the swing of each step, and from these the cost; that the goal is reached, that each
stance can be held and that each step is one of the graph is looked at as when the plan was made.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import scipy

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.warming import warming
from mlivr_gym.errors import MlivrError, PlanError, shortened
from mlivr_gym.kinematics.limb import Angles, held_angles
from mlivr_gym.kinematics.path_following import poses
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.motion.commitment import CommittedMotion, committed_motion
from mlivr_gym.motion.plan_parts import Motion, Query, Statistics, World
from mlivr_gym.postures.postures import FIELDS, Postures
from mlivr_gym.stances.build import COMPILED
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import GraspMap

TOLERANCE = 1e-7
"""Largest deviation of a number that is told from the one that follows [m, rad, or its share].

A file keeps every bit, and a base rotation is told as a quaternion, to 1e-16. Where a limb is all
but singular its angles and manipulability change by the root of that, 1e-8.
"""

SAME_POSE = 1e-9
"""Base poses that differ by less from that of the stance's posture are the same [m, rad]."""

SAME_KNOT = 1e-9
"""Knots that differ by less are one [rad]."""

FLIP = np.diag([-1.0, -1.0, 1.0])
"""Half a turn of a tool about its axis, with which it holds as well."""


def check_counts(query: Query, motion: Motion, statistics: Statistics) -> None:
    """Refuse a plan whose displacements, cost or goal do not follow from its base positions.

    Raises
    ------
    PlanError
        naming the field, the value told and the one found.
    """
    if (query.cost_name == "weighted") != (query.regrasp_price is not None):
        raise PlanError(
            f"query.regrasp_price is {shortened(query.regrasp_price)} and query.cost_name "
            f"{query.cost_name!r}; a price goes with 'weighted' and only with it"
        )
    priced = f"cost_name {query.cost_name!r}, regrasp_price {query.regrasp_price!r}"
    places = motion.base_positions
    away = np.linalg.norm(np.diff(places, axis=0), axis=1)
    for k, step in enumerate(motion.steps):
        _compare(f"motion.steps[{k}].displacement", step.displacement, float(away[k]))
    found = query.cost_of(places)
    if not abs(statistics.cost - found) <= TOLERANCE * max(1.0, found):
        raise _told("statistics.cost", statistics.cost, f"{found!r} (query.{priced})")
    short = float(np.linalg.norm(places[-1] - np.array(query.goal)))
    if short > query.goal_tolerance + TOLERANCE:
        raise PlanError(
            f"query.goal is {shortened(list(query.goal))}, to be reached within "
            f"{query.goal_tolerance!r} m; the last base position "
            f"{shortened(places[-1].tolist())} is {short!r} m away"
        )


def check_motion(query: Query, world: World, motion: Motion, grasp_map: GraspMap) -> None:
    """Refuse a plan whose motion does not follow from its stances, base poses and branches.

    Raises
    ------
    PlanError
        naming the field, the value told and the one found.
    """
    try:
        graph = _graph(world, grasp_map)
        points = np.array([graph.indices(stance) for stance in motion.stances])
    except MlivrError as error:
        raise PlanError(f"the plan has a faulty field: {error}") from None
    for point in motion.stances[-1] if query.goal_face else ():
        face = grasp_map.faces[grasp_map.index(point)]
        if face != query.goal_face:
            told = f"query.goal_face is {query.goal_face!r}; the last stance"
            raise PlanError(f"{told} holds {point!r} on face {face!r}")
    with warming("mlivr_gym.planners.warmup", COMPILED):
        bits = _bits(graph, points, motion)
        postures = _postures(graph, points, motion, bits)
        masks = (1 << bits).tolist()
        states = [
            State(tuple(stance), tuple(mask))
            for stance, mask in zip(points.tolist(), masks, strict=True)
        ]
        found = committed_motion(graph, states, postures)
    _check_steps(motion, found, bits)


def _graph(world: World, grasp_map: GraspMap) -> LazyGraph:
    """A stance graph of the world of a plan, which works out no more than it is asked."""
    graph = LazyGraph(grasp_map, world.robot, world.settings)
    graph.add_obstacles(world.obstacles)
    graph.occupy(world.occupied)
    return graph


def _bits(graph: LazyGraph, points: IntArray, motion: Motion) -> IntArray:
    """Branch and flip that each limb is on, `branch + 8 * flip`, shape (K, N).

    Raises
    ------
    PlanError
        If the joint angles are none with which the limbs hold, or of other branches.
    """
    angles = Angles.rows(16, *points.shape)
    base = poses(motion.base_positions, _rotations(motion))
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
            raise _told(f"motion.branches[{k}][{i}]", int(motion.branches[k, i]), nearest % 8)
        _check_base(graph, points[k], motion, k)
        _compare(
            f"motion.joint_positions[{k}][{i}]",
            motion.joint_positions[k, i].tolist(),
            angles["q"][bits[k, i], k, i].tolist(),
        )
    for k, step in enumerate(motion.steps):
        for i in np.flatnonzero(bits[k] != bits[k + 1]).tolist():
            if i != step.limb and graph.settings.transitions:
                raise _told(f"motion.branches[{k + 1}][{i}]", *(bits[[k + 1, k], i] % 8).tolist())
    return bits


def _check_base(graph: LazyGraph, points: IntArray, motion: Motion, k: int) -> None:
    """Refuse the base pose of a stance if all limbs tell another."""
    told, robot = _rotations(motion)[k], graph.robot
    places, turns = np.empty((graph.limbs, 3)), np.empty((graph.limbs, 3, 3))
    for i, mount in enumerate(robot.mount_rotations):
        place, turn = _flange(robot.every_limb[i].lengths, motion.joint_positions[k, i])
        flange = graph.solver.grasps[points[i]]["flange"]
        turns[i] = min(
            (flange["rotation"] @ flip @ (mount @ turn).T for flip in (np.eye(3), FLIP)),
            key=lambda found: np.abs(found - told).max(),
        )
        places[i] = flange["position"] - turns[i] @ (robot.mount_positions[i] + mount @ place)
    if max(np.ptp(places, axis=0).max(), np.ptp(turns, axis=0).max()) < TOLERANCE:
        _compare(
            f"motion.base_positions[{k}]", motion.base_positions[k].tolist(), places[0].tolist()
        )
        found = quaternion(turns[0])
        found = found if found @ motion.base_quaternions[k] > 0.0 else -found
        _compare(
            f"motion.base_quaternions[{k}]", motion.base_quaternions[k].tolist(), found.tolist()
        )


def _flange(lengths: Array, joints: Array) -> tuple[Array, Array]:
    """Flange position [m] and rotation in the limb base frame, by the standard DH convention."""
    d1, a2, a3, d4, d5, d6 = lengths
    place, turn = np.zeros(3), np.eye(3)
    rows = zip(
        joints,
        (d1, 0.0, 0.0, d4, d5, d6),
        (0.0, a2, a3, 0.0, 0.0, 0.0),
        (1.0, 0.0, 0.0, 1.0, -1.0, 0.0),
        strict=True,
    )
    for q, d, a, quarter in rows:
        place = place + turn @ np.array([a * np.cos(q), a * np.sin(q), d])
        turn = (
            turn
            @ scipy.spatial.transform.Rotation.from_euler(
                "ZX", [q, quarter * np.pi / 2]
            ).as_matrix()
        )
    return place, turn


def _rotations(motion: Motion) -> Array:
    """Base rotations, shape (K, 3, 3)."""
    turns: Array = scipy.spatial.transform.Rotation.from_quat(
        motion.base_quaternions, scalar_first=True
    ).as_matrix()
    return turns


def _postures(graph: LazyGraph, points: IntArray, motion: Motion, bits: IntArray) -> Postures:
    """Postures of the stances at the base poses told.

    That of the stance where the pose is its own, else one of those a user or a refinement chose. On
    which branches limbs may be depends on that, too: a pose that meets the thresholds may have been
    looked at without them.

    Raises
    ------
    PlanError
        If a stance cannot be held on the branches told, or is no node.
    """
    turns, chosen = _rotations(motion), graph.postures(points)
    off = np.abs(chosen.base_position - motion.base_positions).max(axis=1)
    off = np.maximum(off, np.abs(chosen.base_rotation - turns).max(axis=(1, 2)))
    same = off < SAME_POSE
    node, held = same & graph.is_node(chosen), same & (chosen.mask >> bits & 1).all(axis=1)
    needed = graph.settings.thresholds(graph.limbs)
    for thresholds in (needed, (0.0, 0.0)):
        if not (held & node).all():
            at = graph.postures_at(points, motion.base_positions, turns, thresholds)
            node |= graph.is_node(at) & (thresholds == needed)
            for name in FIELDS:
                getattr(chosen, name)[~held] = getattr(at, name)[~held]
            held |= (chosen.mask >> bits & 1).all(axis=1)
    for k in np.flatnonzero(~held).tolist():
        i = int(np.argmin(chosen.mask[k] >> bits[k] & 1))
        can = sorted({bit % 8 for bit in range(16) if int(chosen.mask[k, i]) >> bit & 1})
        raise _told(f"motion.branches[{k}][{i}]", int(motion.branches[k, i]), f"one of {can}")
    for k in (np.flatnonzero(~node[1:]) + 1).tolist():  # the first may have been given
        raise PlanError(
            f"motion.stances[{k}] is {motion.stances[k]}, on which w_m is "
            f"{chosen.w_m[k].tolist()} and w_b {float(chosen.w_b[k])!r} at most; the world's "
            f"thresholds are {graph.limb_threshold!r} and {graph.base_threshold!r}"
        )
    return chosen


def _check_steps(motion: Motion, found: CommittedMotion, bits: IntArray) -> None:
    """Refuse a motion that is not the one found, or not possible."""
    for k, edge in enumerate(found.edges):
        step = motion.steps[k]
        for i, bit in enumerate(bits[k].tolist()):
            if i != step.limb and not edge.kept.get(i, 0) >> bit & 1:
                kept = sorted({b % 8 for b in range(16) if edge.kept.get(i, 0) >> b & 1})
                raise PlanError(
                    f"motion.steps[{k}] moves limb {step.limb} to {step.to_point!r}; limb {i} is "
                    f"on branch {bit % 8} and could follow the base on {kept or 'none'}"
                )
    if found.motion is None:
        k = found.failed or 0
        raise _told(f"motion.steps[{k}].swing", motion.steps[k].swing, "no swing that is clear")
    for name in ("branches", "joint_positions", "w_m", "w_b"):
        here, there = (getattr(one, name).tolist() for one in (motion, found.motion))
        _compare(f"motion.{name}", here, there)
    for k, pair in enumerate(zip(motion.steps, found.motion.steps, strict=True)):
        here, there = map(asdict, pair)
        if len(here["knots"]) != len(there["knots"]):
            here, there = _each_once(here), _each_once(there)
        _compare(f"motion.steps[{k}]", here, there)


def _each_once(step: dict[str, Any]) -> dict[str, Any]:
    """A step without knots that repeat the one before, where only rounding tells them apart."""
    knots = np.array(step["knots"]).reshape(-1, 7)
    moved = np.abs(np.diff(knots, axis=0)).max(axis=1) > SAME_KNOT
    kept = [0, *(np.flatnonzero(moved) + 1).tolist()] if len(knots) else []
    return step | {name: tuple(step[name][k] for k in kept) for name in ("knots", "rounded")}


def _compare(place: str, told: Any, found: Any) -> None:
    """Refuse the first value that is not the one found, in lists and objects."""
    if isinstance(told, dict):
        for name, value in told.items():
            _compare(f"{place}.{name}", value, found[name])
    elif isinstance(told, (list, tuple)) and len(told) == len(found):
        for k, pair in enumerate(zip(told, found, strict=True)):
            _compare(f"{place}[{k}]", *pair)
    elif isinstance(told, float):
        if not abs(told - found) <= TOLERANCE * max(1.0, abs(found)):
            raise _told(place, told, found)
    elif told != found:
        raise _told(place, told, found)


def _told(place: str, told: object, found: object) -> PlanError:
    """The error on a value that is not the one found."""
    text = found if isinstance(found, str) else shortened(found)
    return PlanError(f"{place} is {shortened(told)}; worked out again it is {text}")
