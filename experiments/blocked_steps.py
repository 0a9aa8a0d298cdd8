"""Why the planner calls a step blocked, found by other means; part of `truth.py`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from sampled_lines import sampled_line

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.motion import DEPARTS, Sweep
from mlivr_gym.collisions.placing import Placed, place_in_body
from mlivr_gym.collisions.sweep import sweep
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, BasePath, base_path, base_poses
from mlivr_gym.kinematics.holding import Holding, hold_mask
from mlivr_gym.kinematics.limb import Angles, all_angles_at
from mlivr_gym.kinematics.path_following import joints_along, poses
from mlivr_gym.kinematics.poses import Pose, pose, quaternion
from mlivr_gym.motion.swings import Hold, SwingFinder
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.transitions.grasp_poses import angles_above

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
    """Two lifted postures that a line joins.

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
    for bit, path in _held_paths(graph, held, point, static):
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
    graph: PairGraph, held: int, point: int, static: Postures
) -> Iterator[tuple[int, BasePath]]:
    """Branches and base paths on which a limb can hold its point from one posture to the next."""
    masks = int(static.mask[0, held] & static.mask[1, held])
    grasp, room = graph.solver.grasps[point], Holding.row()
    floor = graph.settings.path_floor * graph.robot.characteristic_length**3
    for kind in (STRAIGHT, ARC):
        path = base_path(*static.base_rows, kind, grasp["point"])
        mask = hold(graph.checks.robots, held, grasp["flange"], path, floor, masks, room)
        for bit in range(8):
            if mask & 0x0101 << bit and _holds(graph, held, point, bit, path):
                yield bit, path


def _lines(
    graph: PairGraph, finder: SwingFinder, starts: list[Array], ends: list[Array]
) -> Iterator[SwingEnds]:
    """Pairs of lifted postures, the tool at the nearest half turn."""
    for start in starts:
        for end in ends:
            half_turns = np.rint((start[5] - end[5]) / np.pi)
            last = np.append(end[:5], end[5] + np.pi * half_turns)
            yield SwingEnds(float(np.abs(last - start)[:5].max()), finder, start, last)


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
    solver, robots, other = graph.solver, graph.checks.robots, 1 - limb
    base, grasp = static.base_rows[row], solver.grasps[stance[limb]]
    room = Sweep.row()
    motion, resting, behind = room["motion"], room["resting"], room["behind"]
    motion["path"] = base_path(base, base, STRAIGHT, np.zeros(3))
    motion["boxes"] = motion["body"] = motion["resting"] = True
    behind["applies"], behind["point"], behind["normal"] = True, grasp["point"], grasp["normal"]
    placed = Placed.rows(1)
    flange = solver.grasps[stance[other]]["flange"]
    placed["q"] = _angles(graph, other, base, flange)["q"][branch]
    place_in_body(robots, other, placed)
    resting["count"], resting["limb"][0], resting["shapes"][0] = 1, other, placed["in_body"][0]
    free, lifted = [], Angles.row()
    for b in range(8):
        if static.mask[row, limb] & 0x0101 << b:
            for part in (motion["first"], motion["second"]):
                part["limb"], part["kind"], part["branch"] = limb, DEPARTS, b
                part["flange"] = grasp["flange"]
            if (
                angles_above(robots, limb, base, grasp, b, lifted)
                and keeps_clear(robots, solver.boxes, graph.settings.clearance, room) == CLEAR
            ):
                free.append(lifted["q"].copy())
    return free


@njit(nogil=True, error_model="numpy")
def hold(
    robots: Any, i: int, flange: Pose, path: BasePath, floor: float, mask: int, room: Holding
) -> int:
    """Branches in `mask` on which limb `i` can hold along a path, see `holding.hold_mask`."""
    return hold_mask(robots[0].limbs[i], flange, path, floor, mask, room)


@njit(nogil=True, error_model="numpy")
def keeps_clear(robots: Any, grid: BoxGrid, clearance: float, room: Sweep) -> int:
    """What the check of the motion in `room` says, see `sweep.sweep`."""
    return sweep(robots[0], grid, clearance, room)


def grasps_at(
    graph: PairGraph, points: Iterable[tuple[int, int]]
) -> list[tuple[int, Array, Array]]:
    """Limb, point [m] and normal of limbs at points, given as limb and index of the point."""
    grasps = graph.solver.grasps
    return [(limb, grasps["point"][point], grasps["normal"][point]) for limb, point in points]


def _holds(graph: PairGraph, held: int, point: int, branch: int, path: BasePath) -> bool:
    """Whether a limb can hold along a path if the other were not there.

    Dense samples, each judged one pair of shapes after the other.
    """
    along = held_along(graph, held, point, branch, path)
    if along is None:
        return False
    grasps = grasps_at(graph, [(held, point)])
    for position, rotation, q in zip(*along, strict=True):
        joints = np.zeros((2, 6))
        joints[held] = q
        here = (position, quaternion(rotation), joints)
        for contact in contacts(
            graph.robot, graph.grasp_map.boxes, here, graph.settings.clearance, grasps
        ):
            names = f"{contact.first} {contact.second}"
            if f"limb{held}" in names and f"limb{1 - held}" not in names:
                return False
    return True


def held_along(
    graph: PairGraph, held: int, point: int, branch: int, path: BasePath
) -> tuple[Array, Array, Array] | None:
    """A robot with a limb that holds, at `SAMPLES` places along a base path.

    Args:
        graph: The graph.
        held: The limb.
        point: What it holds.
        branch: On which branch.
        path: The base path.

    Returns:
        Base positions (k, 3) [m], rotations (k, 3, 3) and the limb's joint angles (k, 6) [rad];
        None if the branch does not exist all along.
    """
    where, turned = base_poses(path, np.linspace(0.0, 1.0, SAMPLES))
    flanges = graph.solver.grasps["flange"][point : point + 1]
    start = _angles(graph, held, pose(where[0], turned[0]), flanges[0])[branch]
    out, bases = Angles.rows(SAMPLES), poses(where, turned)
    there = joints_along(graph.checks.robots, held, bases, flanges, branch, start, out)
    return (where, turned, out["q"]) if there == SAMPLES else None


def _angles(graph: PairGraph, limb: int, base: Pose, flange: Pose) -> Any:
    """Joint angles of a limb on each branch, rows of `Angles`, shape (8,)."""
    out = Angles.rows(8)
    all_angles_at(graph.checks.robots, limb, base, flange, out)
    return out
