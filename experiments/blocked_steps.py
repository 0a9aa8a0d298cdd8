"""Why the planner calls a step blocked, found by other means; part of `collision_truth.py`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.swept_swing import departure_free
from mlivr_gym.kinematics.base_path import STRAIGHT, follow
from mlivr_gym.kinematics.holding import base_path, quaternion
from mlivr_gym.motion.sampling import sampled_line
from mlivr_gym.motion.swings import Hold, SwingFinder
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.transitions.candidate import Candidate
from mlivr_gym.transitions.grasp_poses import flange_at, lifted_branches, line_end, place_branches

DIRECT = "a direct swing exists"
SAMPLED = "a sampled swing exists"
DEPARTURE = "no limb can depart or approach"
NO_SWING = "no swing found"
HOLD = "the limb that holds or the body"
"""What keeps a step out of the graph."""

SAMPLED_PAIRS = 2
"""Pairs of postures between which the sampling planner looks for a swing of a blocked step."""

SAMPLES = 25
"""Configurations looked at along a base path."""


class SwingEnds(NamedTuple):
    """Two lifted postures that a line joins inside the joint limits.

    Attributes:
        length: Largest turn of joints 1 to 5 [rad].
        finder: Tells whether a swing between them is free.
        start: Joint angles, shape (6,) [rad].
        end: Joint angles, shape (6,) [rad].
    """

    length: float
    finder: SwingFinder
    start: Array
    end: Array

    @property
    def knots(self) -> tuple[Array, Array]:
        """Base parameter and joint angles at both ends, shape (7,)."""
        return np.array([0.0, *self.start]), np.array([1.0, *self.end])


def why_blocked(graph: PairGraph, held: int, s0: int, s1: int) -> str:
    """What keeps a step out of the graph, looked for without what the graph takes for granted.

    Each branch of the limb that holds is looked at by itself, all branches of the limb that moves,
    lines between all of them, and then, by a sampling planner in base parameter and joint angles
    together, swings between the nearest.

    Args:
        graph: The graph.
        held: The limb that holds.
        s0: Stance before the step.
        s1: Stance after it.
    """
    stances = tuple(graph.points[s0].tolist()), tuple(graph.points[s1].tolist())
    static = graph.postures(np.array(stances))
    point = stances[0][held]
    answers: set[str] = {HOLD}
    candidates: list[SwingEnds] = []
    step = graph.candidate(*stances, static)
    for bit, path in _held_paths(graph, held, step):
        finder = SwingFinder(graph, 1 - held, path, [Hold(held, point, bit)])
        ends = [_departures(graph, stances[k], static, k, 1 - held, bit) for k in (0, 1)]
        if not ends[0] or not ends[1]:
            answers.add(DEPARTURE)
            continue
        answers.add(NO_SWING)
        for pair in _lines(graph, finder, *ends):
            if finder.clear(np.array(pair.knots)):
                return DIRECT
            candidates.append(pair)
    for pair in sorted(candidates, key=lambda pair: pair.length)[:SAMPLED_PAIRS]:
        knots = sampled_line(pair.finder.clear, graph.robot.limb.limits, *pair.knots)
        if knots is not None and pair.finder.clear(knots):
            return SAMPLED
    return next(answer for answer in (NO_SWING, DEPARTURE, HOLD) if answer in answers)


def _held_paths(
    graph: PairGraph, held: int, step: Candidate
) -> Iterator[tuple[int, tuple[Any, ...]]]:
    """Branches and base paths on which a limb can hold its point."""
    point, static = step.after[held], step.posture
    masks = int(static.mask[0, held] & static.mask[1, held])
    for kind in (0, 1):
        mask = graph.hold(step, kind, held, masks)
        path = step.path(kind)
        for bit in range(8):
            if mask & 0x0101 << bit and _holds(graph, held, point, bit, path):
                yield bit, path


def _lines(
    graph: PairGraph, finder: SwingFinder, starts: list[Array], ends: list[Array]
) -> Iterator[SwingEnds]:
    """Pairs of lifted postures that a line joins inside the joint limits."""
    for start in starts:
        for end in ends:
            last = np.empty(6)
            length = line_end(start, end, graph.solver.limits, last)
            if np.isfinite(length):
                yield SwingEnds(length, finder, start, last)


def _departures(
    graph: PairGraph, stance: tuple[int, ...], static: Postures, row: int, limb: int, branch: int
) -> list[Array]:
    """Angles above its point, shape (6,) [rad], on each branch on which a limb can depart.

    Args:
        graph: The graph.
        stance: The stance.
        static: Postures.
        row: That of the stance.
        limb: The limb that departs.
        branch: On which the other limb holds.
    """
    solver, robot, other = graph.solver, graph.robot, 1 - limb
    point, grasp = stance[limb], stance[other]
    position, rotation = static.base_position[row], static.base_rotation[row]
    shapes, gripper, _, fixed, world, clearance, _ = solver.collision_model.arrays
    placed = np.empty((1, len(shapes[0]), 2, 3))
    place_branches(
        other,
        1 << branch,
        solver.points[grasp],
        solver.normals[grasp],
        robot.tool_length,
        position,
        rotation,
        solver.mount_rotations,
        solver.mount_positions,
        solver.lengths,
        shapes,
        0,
        placed,
    )
    mount = (solver.mount_rotations[limb], solver.mount_positions[limb])
    p, x, z, away, q = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((8, 6))
    flange_at(
        solver.points[point],
        solver.normals[point],
        solver.rails[point],
        robot.tool_length,
        position,
        rotation,
        *mount,
        p,
        x,
        z,
        away,
    )
    flange = (p, x, z, away, robot.lift, solver.lengths)
    existing = lifted_branches(limb, int(static.mask[row, limb]), *flange, solver.limits, q)
    surroundings = (shapes, gripper, fixed, world, solver.points[point], solver.normals[point])
    free = []
    for b in range(8):
        if existing & 0x0101 << b:
            body = (*mount, position, rotation, placed)
            found = departure_free(limb, *flange, b, *body, *surroundings, clearance, True)
            if found == CLEAR:
                free.append(q[b])
    return free


def _holds(graph: PairGraph, held: int, point: int, branch: int, path: tuple[Any, ...]) -> bool:
    """Whether a limb can hold along a path if the other were not there.

    Dense samples, each judged one pair of shapes after the other.
    """
    where, turned = base_path(path, np.linspace(0.0, 1.0, SAMPLES))
    q = np.full(6, np.nan)
    for position, rotation in zip(where, turned, strict=True):
        if not follow_to(graph, held, point, branch, (position, rotation), q):
            return False
        joints = np.zeros((2, 6))
        joints[held] = q
        grasps = [(held, graph.solver.points[point], graph.solver.normals[point])]
        here = (position, quaternion(rotation), joints)
        for contact in contacts(
            graph.robot, graph.grasp_map.boxes, here, graph.settings.clearance, grasps
        ):
            names = f"{contact.first} {contact.second}"
            if f"limb{held}" in names and f"limb{1 - held}" not in names:
                return False
    return True


def follow_to(
    graph: PairGraph, held: int, point: int, branch: int, pose: tuple[Array, Array], q: Array
) -> bool:
    """Whether a limb can hold its point at a base pose; its angles continue the given ones.

    Args:
        graph: The graph.
        held: The limb.
        point: What it holds.
        branch: On which branch.
        pose: Base position, shape (3,) [m], and rotation, shape (3, 3).
        q: Joint angles before, shape (6,) [rad], NaN at the first pose; changed in place.
    """
    solver = graph.solver
    return bool(
        follow(
            solver.flanges_in_world[point],
            solver.flange_axes_in_world[point],
            *pose,
            *pose,
            STRAIGHT,
            pose[0],
            solver.mount_rotations[held],
            solver.mount_positions[held],
            solver.lengths,
            branch,
            0,
            np.empty(6),
            q,
            np.full(6, np.inf),
            np.full(6, -np.inf),
        )
    )
