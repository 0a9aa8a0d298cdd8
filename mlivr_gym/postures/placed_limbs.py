"""Limbs placed on their branches at one base pose: `K^-1`, capsules and distances (compiled).

The distances are exact where nothing touches, since the clearance of the robot from itself breaks
ties between postures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.collisions.against_boxes import compare_limb_with_boxes, set_grasp_surface
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.distances import (
    CLEAR,
    has_separating_plane,
    segment_box_distance_squared,
    segment_distance_squared,
)
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.collisions.placement import Shapes, axis_of, capsule_axis, place
from mlivr_gym.compiled.bit_sets import EVERY, below
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.kinematics.inverse import branch_frames
from mlivr_gym.kinematics.limb import flange_seen
from mlivr_gym.kinematics.manipulability import limb_information
from mlivr_gym.kinematics.poses import Pose, minus, out_of, vector
from mlivr_gym.postures.base_poses import turned
from mlivr_gym.postures.records import PostureRule, PostureScratch, StanceGeometry

if TYPE_CHECKING:
    from mlivr_gym.values import Triple


class PostureSearch(NamedTuple):
    """Inputs of the search for a posture of one stance."""

    robot: RobotModel
    """The robot."""
    rule: PostureRule
    """The rule."""
    grid: BoxGrid
    """The boxes."""
    geometry: StanceGeometry
    """The grasps of the stance."""
    given: Pose
    """Base pose in the world, if the rule has it given."""
    clearance: float
    """Clearance to keep [m]; with 0 only penetration counts."""
    has_boxes: bool
    """Whether the boxes count."""


@kernel
def limb_fits(search: PostureSearch, i: int, b: int, scratch: PostureScratch) -> bool:
    """Place limb `i` on branch `b`; return whether it has it and touches nothing but other limbs.

    If so, its distance from itself and the body and its `K^-1` are stored.
    """
    robot, limb, frames = search.robot, search.robot.limbs[i], scratch.frames
    flange, _ = flange_seen(limb, scratch.base, search.geometry.grasps[i].flange)
    if not branch_frames(limb.arm, flange, b, frames):
        return False
    shapes, information = scratch.in_body[i, b], scratch.information[i, b]
    place(limb, EVERY, frames, shapes.ends)
    scratch.gaps[i, b] = _gap_to_body(robot, limb, shapes, search.clearance)
    if scratch.gaps[i, b] < search.clearance:
        return False
    # The boxes last: they take longest.
    if search.has_boxes and _touches_boxes(search, i, shapes, scratch):
        return False
    l_c = robot.characteristic_length
    return limb_information(limb, flange, b, l_c, scratch.inversion, information)


@part
def _touches_boxes(search: PostureSearch, i: int, shapes: Shapes, scratch: PostureScratch) -> bool:
    """Return whether limb `i` touches a box; `shapes` are in the body frame.

    What is on its flange axis does not depend on the posture, see
    `collisions.queries.check_points`. The gripper may touch what lies behind its surface.
    """
    limb, grasp, stance = search.robot.limbs[i], search.geometry.grasps[i], search.geometry.place
    point, normal = out_of(stance, vector(grasp.point)), vector(grasp.normal)
    set_grasp_surface(scratch.surface, point, turned(stance.rotation, normal))
    result, _ = compare_limb_with_boxes(
        limb,
        shapes.ends,
        shapes.motion,
        scratch.base_in_world,
        below(limb.first_on_axis),
        search.grid,
        search.clearance,
        scratch.surface,
    )
    return result != CLEAR


@kernel
def gap_between_limbs(
    search: PostureSearch, i: int, b: int, j: int, c: int, scratch: PostureScratch
) -> float:
    """Return the distance of limb `i` on branch `b` from limb `j` on branch `c`, both placed [m].

    If it is below the clearance to keep, any number below that may be returned.
    """
    limb, other, gap = search.robot.limbs[i], search.robot.limbs[j], np.inf
    ends, others = scratch.in_body[i, b].ends, scratch.in_body[j, c].ends
    for k in range(limb.capsule_count):
        axis = axis_of(ends, k)
        for m in range(other.capsule_count):
            if gap < search.clearance:
                return gap
            radii = limb.capsules[k].radius + other.capsules[m].radius
            gap = min(gap, _capsule_gap(axis, axis_of(others, m), radii, gap))
    return gap


@part
def _gap_to_body(robot: RobotModel, limb: LimbModel, shapes: Shapes, least: float) -> float:
    """Return the distance of a limb's links from each other and from the body [m].

    The body includes the capsules fixed to it; `shapes` are in the body frame. If the distance is
    below `least`, any number below `least` may be returned.
    """
    gap, ends = np.inf, shapes.ends
    for k in range(limb.pair_count):
        i, j = limb.pairs[k, 0], limb.pairs[k, 1]
        radii = limb.capsules[i].radius + limb.capsules[j].radius
        gap = min(gap, _capsule_gap(axis_of(ends, i), axis_of(ends, j), radii, gap))
    for c in range(limb.capsule_count):
        capsule = limb.capsules[c]
        if gap < least:
            return gap
        if capsule.link < 2:
            continue
        axis = axis_of(ends, c)
        square = segment_box_distance_squared(axis[0], minus(axis[1], axis[0]), vector(robot.half))
        gap = min(gap, np.sqrt(square) - capsule.radius)
        for m in range(robot.mount_count):
            if capsule.link >= limb.first_link[m]:
                mount = robot.mounts[m]
                radii = capsule.radius + mount.radius
                gap = min(gap, _capsule_gap(axis, capsule_axis(mount.ends), radii, gap))
    return gap


@kernel
def _capsule_gap(
    first: tuple[Triple, Triple], second: tuple[Triple, Triple], radii: float, gap: float
) -> float:
    """Return the distance between two capsules [m], or `gap` if it is known not to be smaller."""
    if has_separating_plane(first, second, gap + radii):
        return gap
    (p, p_end), (q, q_end) = first, second
    return float(np.sqrt(segment_distance_squared(p, minus(p_end, p), q, minus(q_end, q)))) - radii
