"""Candidate base poses of a stance, and the number of a base pose among them.

The number of its base pose is all that a stored node needs to recover it, see `stances.node_table`.
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
"""Candidate distances of the base from the line through the grasps between opposite walls [m]."""

OPPOSED_ROLLS = 12
"""Number of candidate rolls between opposite walls, over a full turn."""


class Candidates(NamedTuple):
    """Candidate base poses of k stances."""

    frames: tuple[Array, Array, Array, BoolArray]
    """Body axes, outward directions, roll axes and opposed walls, see `base_frames`."""
    heights: Array
    """Heights above the centroid [m]."""
    rolls: Array
    """Rolls [rad]."""
    opposed_heights: Array
    """Heights between opposite walls [m]."""
    opposed_rolls: Array
    """Rolls between opposite walls [rad]."""

    @classmethod
    def of(cls, robot: RobotSpec, held: Grasps) -> Candidates:
        """Return a robot's candidates for given grasps."""
        opposed_rolls = 2.0 * np.pi * np.arange(OPPOSED_ROLLS) / OPPOSED_ROLLS
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
            np.array(geometric_order(opposed_rolls)),
        )

    def write(self, stances: Any, rules: Any) -> None:
        """Write the candidates into records of `HeldStance` and a record of `PostureRule`."""
        for name, array in zip(("frame", "out", "line", "opposed"), self.frames, strict=True):
            stances[name] = array
        set_candidates(rules[0], self[1:])

    def poses(self, numbers: IntArray) -> Any:
        """Return one base pose of each stance by number, relative to the centroid of its grasps.

        They are records of `Pose`, shape (k,).
        """
        count, rules = len(numbers), PostureRule.rows(1)
        stances, out = HeldStance.rows(count), Pose.rows(count)
        self.write(stances, rules)
        set_poses(stances, rules, numbers, out)
        return out


def held_in_world(grasp_map: GraspMap, stances: IntArray) -> Grasps:
    """Return the grasps of stances relative to their centroids, in the axes of the world."""
    points, rotations = grasp_map.positions[stances], grasp_map.rotations[stances]
    centres = mean_of_limbs(points)
    return Grasps(points - centres[:, None], rotations[..., 2], rotations[..., 0], centres)


def rounded_in_world(grasp_map: GraspMap, stances: IntArray) -> Grasps:
    """Return grasps like `held_in_world`, from the rounded coordinates of the relative geometry."""
    rows, inverse = relative_geometries(grasp_map, stances)
    held, centroids = grasps_of_geometries(rows[inverse], stances.shape[1])
    first = stances[:, 0]
    frames = grasp_map.rotations[first]
    grasps, normals, rails = (rotate(frames[:, None], part) for part in held[:3])
    return Grasps(grasps, normals, rails, grasp_map.positions[first] + rotate(frames, centroids))


def bases_of_ordered(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, numbers: IntArray
) -> tuple[Array, Array]:
    """Return base poses by number, of stances whose limb 0 is the first limb of the rule.

    See `bases_at`.
    """
    rows, inverse = relative_geometries(grasp_map, stances)
    held, centroids = grasps_of_geometries(rows[inverse], robot.limbs)
    found = Candidates.of(robot, held).poses(numbers)
    local = found["position"] + centroids
    return in_world(grasp_map, stances[:, 0], local, found["rotation"])


def bases_at(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, numbers: IntArray
) -> tuple[Array, Array]:
    """Return the base poses of stances in the world by their numbers among the candidates.

    They equal those of `Postures` to the last bit.

    Parameters
    ----------
    grasp_map
        The map.
    robot
        The robot.
    stances
        Point indices, shape (k, N).
    numbers
        Indices among the candidates, shape (k,).

    Returns
    -------
    tuple[Array, Array]
        Positions [m], shape (k, 3), and rotations, shape (k, 3, 3).
    """
    turns = first_limbs(grasp_map, stances, robot.is_symmetric)
    positions, rotations = bases_of_ordered(
        grasp_map, robot, permuted_limbs(stances, turns), numbers
    )
    return positions, turned_frames(rotations, -turns, robot.limbs)
