"""Base poses that are tried for a stance, and which of them its posture has, by number.

With the number the base pose of a node is found again without what led to it, see
`stances.node_table`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.postures.base_frames import base_frames
from mlivr_gym.postures.geometries import Grasps, grasps_of_geometries, relative_geometries
from mlivr_gym.postures.records import HeldStance, PostureRule, list_tries
from mlivr_gym.postures.selection import set_poses
from mlivr_gym.postures.turns import first_limbs, turned, turned_frames
from mlivr_gym.robot.specification import MOST_POSES, RobotSpec, geometric_order
from mlivr_gym.world.grasp_map import GraspMap

OPPOSED_HEIGHTS = (0.15, 0.25, 0.35, 0.45)
"""Distances of the base from the line through the grasps tried there [m]."""

OPPOSED_ROLLS = 12
"""Rolls over the full circle tried there."""

IN_PLACE = MOST_POSES * MOST_POSES
"""What is added to the number of a base pose that was found among the surroundings."""

SAME = 1e-12
"""Base poses that differ by less are equal [m, and in axes]."""

NO_POSE = 4 * IN_PLACE - 1
"""Number of what is none of those tried."""


class Candidates(NamedTuple):
    """Base poses that are tried."""

    frames: tuple[Array, Array, Array, BoolArray]
    """What `base_frames` returns."""
    heights: Array
    """Heights over the centroid [m]."""
    rolls: Array
    """Rolls [rad]."""
    opposed_heights: Array
    """Heights between opposite walls [m]."""
    opposed_rolls: Array
    """Rolls between opposite walls [rad]."""

    @classmethod
    def of(cls, robot: RobotSpec, held: Grasps) -> Candidates:
        """A robot's candidates for some grasps."""
        wide_rolls = 2.0 * np.pi * np.arange(OPPOSED_ROLLS) / OPPOSED_ROLLS
        return cls(
            base_frames(held.grasps, held.normals, np.ascontiguousarray(held.rails[:, 0])),
            np.array(robot.heights),
            np.array(robot.rolls),
            np.array(OPPOSED_HEIGHTS),
            np.array(geometric_order(wide_rolls)),
        )

    def write(self, stances: Any, rules: Any) -> None:
        """Put them into rows of `HeldStance` and a row of `PostureRule`."""
        for name, array in zip(("frame", "out", "line", "opposed"), self.frames, strict=True):
            stances[name] = array
        list_tries(rules[0], self[1:])

    @property
    def most(self) -> int:
        """The most base poses of one stance."""
        heights, rolls, opposed_heights, opposed_rolls = map(len, self[1:])
        return max(heights * rolls, opposed_heights * opposed_rolls)

    def poses(self, numbers: IntArray) -> Any:
        """One base pose of each stance, from the centroid of its grasps: rows of `Pose`, (k,)."""
        stances, rules, out = (row.rows(len(numbers)) for row in (HeldStance, PostureRule, Pose))
        self.write(stances, rules)
        set_poses(stances, rules, numbers, out)
        return out


def held_in_world(grasp_map: GraspMap, stances: IntArray) -> Grasps:
    """Grasps of stances about their centroids, in the axes of the world."""
    points, rotations = grasp_map.positions[stances], grasp_map.rotations[stances]
    centres = points.mean(axis=1)
    return Grasps(points - centres[:, None], rotations[..., 2], rotations[..., 0], centres)


def bases_at(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, numbers: IntArray
) -> tuple[Array, Array]:
    """Base poses of stances in the world, by their numbers.

    Args:
        grasp_map: The map.
        robot: The robot.
        stances: Point indices, shape (k, N).
        numbers: Which of those tried, `IN_PLACE` more if found among the surroundings, shape (k,).

    Returns:
        Positions, shape (k, 3) [m], and rotations, shape (k, 3, 3).
    """
    turns = first_limbs(grasp_map, stances)
    points, in_place = turned(stances, turns), numbers >= IN_PLACE
    positions, rotations = np.empty((len(points), 3)), np.empty((len(points), 3, 3))
    here = np.flatnonzero(in_place)
    if len(here):
        held = held_in_world(grasp_map, points[here])
        found = Candidates.of(robot, held).poses(numbers[here] - IN_PLACE)
        positions[here] = found["position"] + held.centres
        rotations[here] = found["rotation"]
    there = np.flatnonzero(~in_place)
    if len(there):
        rows, inverse = relative_geometries(grasp_map, points[there])
        held, centroids = grasps_of_geometries(rows[inverse], robot.limbs)
        found = Candidates.of(robot, held).poses(numbers[there])
        first = points[there, 0]
        frames, local = grasp_map.rotations[first], found["position"] + centroids
        positions[there] = grasp_map.positions[first] + np.einsum("kij,kj->ki", frames, local)
        rotations[there] = frames @ found["rotation"]
    return positions, turned_frames(rotations, -turns, robot.limbs)


def numbers_of(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, positions: Array, rotations: Array
) -> IntArray:
    """Numbers of base poses in the world, shape (k,); `NO_POSE` for what is none of those tried.

    Args:
        grasp_map: The map.
        robot: The robot.
        stances: Point indices, shape (k, N).
        positions: Base positions [m], shape (k, 3).
        rotations: Base rotations, shape (k, 3, 3).
    """
    numbers: IntArray = np.full(len(stances), NO_POSE, dtype=np.int64)
    most = Candidates.of(robot, held_in_world(grasp_map, stances[:0])).most
    for number in (*range(most), *range(IN_PLACE, IN_PLACE + most)):
        rest = np.flatnonzero(numbers == NO_POSE)
        if not len(rest):
            break
        tried = bases_at(grasp_map, robot, stances[rest], np.full(len(rest), number))
        same = np.abs(tried[0] - positions[rest]).max(axis=1) < SAME
        same &= np.abs(tried[1] - rotations[rest]).max(axis=(1, 2)) < SAME
        numbers[rest[same]] = number
    return numbers
