"""Base poses that are tried for a stance, and which of them its posture has, by number.

With the number the base pose of a node is found again without what led to it, see
`stances.node_table`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.kinematics.batches import mean_of_limbs, rotate
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.postures.base_frames import base_frames
from mlivr_gym.postures.geometries import (
    Grasps,
    grasps_of_geometries,
    in_world,
    relative_geometries,
)
from mlivr_gym.postures.records import HeldStance, PostureRule, set_candidates
from mlivr_gym.postures.selection import set_poses
from mlivr_gym.postures.turns import first_limbs, permuted_limbs, turned_frames
from mlivr_gym.robot.specification import RobotSpec, geometric_order
from mlivr_gym.world.grasp_map import GraspMap

OPPOSED_HEIGHTS = (0.15, 0.25, 0.35, 0.45)
"""Distances of the base from the line through the grasps tried there [m]."""

OPPOSED_ROLLS = 12
"""Rolls over the full circle tried there."""


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
            base_frames(
                held.grasps,
                held.normals,
                np.ascontiguousarray(held.rails[:, 0]),
                robot.mount_directions if robot.mounts else None,
            ),
            np.array(robot.heights),
            np.array(robot.rolls),
            np.array(OPPOSED_HEIGHTS),
            np.array(geometric_order(wide_rolls)),
        )

    def write(self, stances: Any, rules: Any) -> None:
        """Put them into rows of `HeldStance` and a row of `PostureRule`."""
        for name, array in zip(("frame", "out", "line", "opposed"), self.frames, strict=True):
            stances[name] = array
        set_candidates(rules[0], self[1:])

    @property
    def most(self) -> int:
        """The most base poses of one stance."""
        heights, rolls, opposed_heights, opposed_rolls = map(len, self[1:])
        return max(heights * rolls, opposed_heights * opposed_rolls)

    def poses(self, numbers: IntArray) -> Any:
        """One base pose of each stance, from the centroid of its grasps: rows of `Pose`, (k,)."""
        count, rules = len(numbers), PostureRule.rows(1)
        stances, out = HeldStance.rows(count), Pose.rows(count)
        self.write(stances, rules)
        set_poses(stances, rules, numbers, out)
        return out


def held_in_world(grasp_map: GraspMap, stances: IntArray) -> Grasps:
    """Grasps of stances about their centroids, in the axes of the world."""
    points, rotations = grasp_map.positions[stances], grasp_map.rotations[stances]
    centres = mean_of_limbs(points)
    return Grasps(points - centres[:, None], rotations[..., 2], rotations[..., 0], centres)


def rounded_in_world(grasp_map: GraspMap, stances: IntArray) -> Grasps:
    """As `held_in_world`, but on the rounded figures of the relative geometry."""
    rows, inverse = relative_geometries(grasp_map, stances)
    held, centroids = grasps_of_geometries(rows[inverse], stances.shape[1])
    first = stances[:, 0]
    frames = grasp_map.rotations[first]
    grasps, normals, rails = (rotate(frames[:, None], part) for part in held[:3])
    return Grasps(grasps, normals, rails, grasp_map.positions[first] + rotate(frames, centroids))


def bases_of(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, numbers: IntArray
) -> tuple[Array, Array]:
    """Base poses by their numbers of stances with whose limb 0 the rule begins, see `bases_at`."""
    rows, inverse = relative_geometries(grasp_map, stances)
    held, centroids = grasps_of_geometries(rows[inverse], robot.limbs)
    found = Candidates.of(robot, held).poses(numbers)
    local = found["position"] + centroids
    return in_world(grasp_map, stances[:, 0], local, found["rotation"])


def bases_at(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, numbers: IntArray
) -> tuple[Array, Array]:
    """Base poses of stances in the world, by their numbers.

    They are those of `Postures` to the last bit.

    Parameters
    ----------
    grasp_map
        The map.
    robot
        The robot.
    stances
        Point indices, shape (k, N).
    numbers
        Which of those tried, shape (k,).

    Returns
    -------
    tuple[Array, Array]
        Positions, shape (k, 3) [m], and rotations, shape (k, 3, 3).
    """
    turns = first_limbs(grasp_map, stances, robot.is_symmetric)
    positions, rotations = bases_of(grasp_map, robot, permuted_limbs(stances, turns), numbers)
    return positions, turned_frames(rotations, -turns, robot.limbs)
