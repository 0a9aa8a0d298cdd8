"""Candidate base poses of a stance, and the number of a base pose among them.

The number of its base pose is all that a stored node needs to recover it, see `stances.node_table`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.kinematics.batches import mean_of_limbs, rotate
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.postures.base_frames import base_frames, mount_azimuths
from mlivr_gym.postures.base_poses import BaseRule, BaseScratch, set_bases
from mlivr_gym.postures.geometries import (
    RelativeGeometries,
    geometries_of_rows,
    relative_geometries,
)
from mlivr_gym.postures.records import PostureRule, set_candidates
from mlivr_gym.postures.relabelling import turns_to_mounts
from mlivr_gym.robot.planning_lengths import geometric_order
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.world.grasp_map import GraspMap

OPPOSED_HEIGHTS = (0.15, 0.25, 0.35, 0.45)
"""Candidate distances of the base from the line through the grasps between opposite walls [m]."""

OPPOSED_ROLLS = geometric_order(2.0 * np.pi * np.arange(12) / 12)
"""Candidate rolls between opposite walls [rad], over a full turn."""


def heights_and_rolls(robot: RobotSpec) -> tuple[Array, Array, Array, Array]:
    """Return a robot's candidate heights [m] and rolls [rad], and those between opposite walls."""
    every = robot.heights, robot.rolls, OPPOSED_HEIGHTS, OPPOSED_ROLLS
    heights, rolls, opposed_heights, opposed_rolls = map(np.array, every)
    return heights, rolls, opposed_heights, opposed_rolls


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
        mounts = None if robot.is_symmetric else robot.mount_directions
        rails = np.ascontiguousarray(geometry.rails[:, 0])
        frames = base_frames(geometry.positions, geometry.normals, rails, mounts)
        return cls(frames, *heights_and_rolls(robot))

    def write(self, stances: Any, rules: Any) -> None:
        """Write the candidates into records of `StanceGeometry` and a record of `PostureRule`."""
        for name, array in zip(("frame", "out", "line", "opposed"), self.frames, strict=True):
            stances[name] = array
        set_candidates(rules[0], self[1:])


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
    return _bases(grasp_map, robot, stances, numbers, np.empty((0, 3, 3)))


def bases_at(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, numbers: IntArray
) -> tuple[Array, Array]:
    """Return the base poses of stances in the world by their numbers among the candidates (k,).

    They equal those of `Postures` to the last bit. Stances are point indices, shape (k, N);
    returned are positions [m], shape (k, 3), and rotations, shape (k, 3, 3).
    """
    turns = turns_to_mounts(robot.limbs)[-np.arange(robot.limbs)]
    return _bases(grasp_map, robot, stances, numbers, turns)


def _bases(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, numbers: IntArray, turns: Array
) -> tuple[Array, Array]:
    """Return base poses by number; the turns are those of `BaseRule`."""
    candidates, limbs = PostureRule.rows(1), robot.limbs
    set_candidates(candidates[0], heights_and_rolls(robot))
    mounts = mount_azimuths(limbs) if robot.is_symmetric else robot.mount_directions
    has_first = len(turns) > 0 and limbs > 2 and robot.is_symmetric
    frames = grasp_map.positions, grasp_map.rotations
    rule = BaseRule(*frames, candidates, mounts, has_first, turns)
    out, whole = Pose.rows(len(stances)), (np.ascontiguousarray(stances), np.asarray(numbers))
    set_bases(*whole, rule, BaseScratch.allocate(limbs), out)
    return out["position"].copy(), out["rotation"].copy()
