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
    RelativeGeometries,
    geometries_of_rows,
    in_world,
    relative_geometries,
)
from mlivr_gym.postures.records import PostureRule, StanceGeometry, set_candidates
from mlivr_gym.postures.relabelling import first_limbs, relabelled, relabelled_frames
from mlivr_gym.postures.selection import set_poses
from mlivr_gym.robot.planning_lengths import geometric_order
from mlivr_gym.robot.specification import RobotSpec
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
    def of(cls, robot: RobotSpec, geometry: RelativeGeometries) -> Candidates:
        """Return a robot's candidates for given grasps."""
        opposed_rolls = 2.0 * np.pi * np.arange(OPPOSED_ROLLS) / OPPOSED_ROLLS
        return cls(
            base_frames(
                geometry.positions,
                geometry.normals,
                np.ascontiguousarray(geometry.rails[:, 0]),
                None if robot.is_symmetric else robot.mount_directions,
            ),
            np.array(robot.heights),
            np.array(robot.rolls),
            np.array(OPPOSED_HEIGHTS),
            np.array(geometric_order(opposed_rolls)),
        )

    def write(self, stances: Any, rules: Any) -> None:
        """Write the candidates into records of `StanceGeometry` and a record of `PostureRule`."""
        for name, array in zip(("frame", "out", "line", "opposed"), self.frames, strict=True):
            stances[name] = array
        set_candidates(rules[0], self[1:])

    def poses(self, numbers: IntArray) -> Any:
        """Return one base pose of each stance by number, relative to the centroid of its grasps.

        They are records of `Pose`, shape (k,).
        """
        count, rules = len(numbers), PostureRule.rows(1)
        stances, out = StanceGeometry.rows(count), Pose.rows(count)
        self.write(stances, rules)
        set_poses(stances, rules, numbers, out)
        return out


def geometries_in_world(grasp_map: GraspMap, stances: IntArray) -> RelativeGeometries:
    """Return the grasps of stances relative to their centroids, in the axes of the world."""
    positions, rotations = grasp_map.positions[stances], grasp_map.rotations[stances]
    centres = mean_of_limbs(positions)
    return RelativeGeometries(
        positions - centres[:, None], rotations[..., 2], rotations[..., 0], centres
    )


def rounded_geometries_in_world(grasp_map: GraspMap, stances: IntArray) -> RelativeGeometries:
    """Return what `geometries_in_world` does, from the rounded relative geometry."""
    rows, inverse = relative_geometries(grasp_map, stances)
    geometry, centroids = geometries_of_rows(rows[inverse], stances.shape[1])
    first = stances[:, 0]
    frames = grasp_map.rotations[first]
    positions, normals, rails = (rotate(frames[:, None], part) for part in geometry[:3])
    return RelativeGeometries(
        positions, normals, rails, grasp_map.positions[first] + rotate(frames, centroids)
    )


def bases_of_ordered(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, numbers: IntArray
) -> tuple[Array, Array]:
    """Return base poses by number, of stances whose limb 0 is the first limb of the rule.

    See `bases_at`.
    """
    rows, inverse = relative_geometries(grasp_map, stances)
    # Each pose is computed once in the frame of the first grasp.
    count = int(numbers.max(initial=0)) + 1
    poses, pose_of = np.unique(inverse * count + numbers, return_inverse=True)
    geometry, centroids = geometries_of_rows(rows[poses // count], robot.limbs)
    found = Candidates.of(robot, geometry).poses(poses % count)
    local = found["position"] + centroids
    return in_world(grasp_map, stances[:, 0], local[pose_of], found["rotation"][pose_of])


def bases_at(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, numbers: IntArray
) -> tuple[Array, Array]:
    """Return the base poses of stances in the world by their numbers among the candidates (k,).

    They equal those of `Postures` to the last bit. Stances are point indices, shape (k, N);
    returned are positions [m], shape (k, 3), and rotations, shape (k, 3, 3).
    """
    relabellings = first_limbs(grasp_map, stances, robot.is_symmetric)
    positions, rotations = bases_of_ordered(
        grasp_map, robot, relabelled(stances, relabellings), numbers
    )
    return positions, relabelled_frames(rotations, -relabellings, robot.limbs)
