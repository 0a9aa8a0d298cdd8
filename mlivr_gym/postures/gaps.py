"""What the limbs touch on their branches at one candidate base pose, asked once each (compiled).

The distances are exact where nothing touches, since the clearance of the robot from itself breaks
ties between postures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.collisions.against_boxes import compare_limb_with_boxes, set_grasp_surface
from mlivr_gym.collisions.against_robot import has_separating_plane
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.distances import (
    CLEAR,
    segment_box_distance_squared,
    segment_distance_squared,
)
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.collisions.placement import Shapes, axis_of, capsule_axis, place, place_in_world
from mlivr_gym.compiled.bit_sets import below
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.kinematics.chain import FlangeAxis
from mlivr_gym.kinematics.inverse import branch_frames
from mlivr_gym.kinematics.poses import Pose, minus, out_of, vector
from mlivr_gym.postures.base_poses import turned
from mlivr_gym.postures.records import PostureRule, PostureScratch, StanceGeometry

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

TOUCHES = -1.0
"""Distance that stands for a branch that touches a box, or does not exist [m]."""


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
def place_limb(search: PostureSearch, i: int, b: int, scratch: PostureScratch) -> bool:
    """Place limb `i` on branch `b` in the body frame; return whether it has that branch."""
    limb, reach = search.robot.limbs[i], scratch.candidate.limbs[i]
    flange, frames = FlangeAxis(vector(reach.p), vector(reach.z)), scratch.placed.frames
    if not branch_frames(limb.arm, flange, b, frames):
        return False
    place(limb, frames, scratch.in_body[i, b])
    return True


@kernel
def limb_gap(search: PostureSearch, i: int, b: int, scratch: PostureScratch) -> float:
    """Return the distance of limb `i` on branch `b` from itself and the body [m].

    It is `TOUCHES` if the limb touches a box. Below the clearance to keep, it may be any distance
    that is too small.
    """
    if scratch.gaps[i, b, i, b] == np.inf:
        gap, least = TOUCHES, search.clearance
        if place_limb(search, i, b, scratch):
            gap = _gap_to_itself(search.robot, search.robot.limbs[i], scratch.in_body[i, b], least)
            # The boxes last: they take longest.
            if search.has_boxes and gap >= least and cause_at_boxes(search, i, b, scratch) != CLEAR:
                gap = TOUCHES
        scratch.gaps[i, b, i, b] = gap
    return float(scratch.gaps[i, b, i, b])


@kernel
def cause_at_boxes(search: PostureSearch, i: int, b: int, scratch: PostureScratch) -> int:
    """Return the cause of a collision of limb `i`, placed on branch `b`, with a box; else 0.

    What is on its flange axis does not depend on the posture, see
    `collisions.queries.check_points`. The gripper may touch what lies behind its surface.
    """
    limb, grasp, stance = search.robot.limbs[i], search.geometry.grasps[i], search.geometry.place
    point, normal = out_of(stance, vector(grasp.point)), vector(grasp.normal)
    set_grasp_surface(scratch.surface, point, turned(stance.rotation, normal))
    place_in_world(limb, scratch.base, scratch.in_body[i, b], scratch.in_world)
    pending = below(limb.first_on_axis)
    result, _ = compare_limb_with_boxes(
        limb, scratch.in_world, pending, search.grid, search.clearance, scratch.surface
    )
    return int(result)


@kernel
def pair_gap(
    search: PostureSearch, i: int, b: int, j: int, c: int, scratch: PostureScratch
) -> float:
    """Return the distance of limb `i` on branch `b` from limb `j` on branch `c`, both placed [m].

    Below the clearance to keep, it may be any distance that is too small.
    """
    if scratch.gaps[i, b, j, c] == np.inf:
        limb, other = search.robot.limbs[i], search.robot.limbs[j]
        shapes, others = scratch.in_body[i, b], scratch.in_body[j, c]
        gap = _gap_between(limb, shapes, other, others, search.clearance)
        scratch.gaps[i, b, j, c] = scratch.gaps[j, c, i, b] = gap
    return float(scratch.gaps[i, b, j, c])


@kernel
def touching_limb(search: PostureSearch, scratch: PostureScratch) -> int:
    """Return a limb that touches something on `scratch.combination`, -1 if none does.

    It touches the surroundings, itself or a limb after it: no combination serves in which it and
    the limbs after it are on these branches.
    """
    for i in range(search.robot.limb_count - 1, -1, -1):
        b = scratch.combination[i]
        if limb_gap(search, i, b, scratch) < search.clearance:
            return i
        for j in range(i + 1, search.robot.limb_count):
            if pair_gap(search, i, b, j, scratch.combination[j], scratch) < search.clearance:
                return i
    return -1


@kernel
def self_clearance(count: int, scratch: PostureScratch) -> float:
    """Return the distance of the robot from itself where `touching_limb` finds none [m]."""
    gap = np.inf
    for i in range(count):
        for j in range(i, count):
            gap = min(gap, scratch.gaps[i, scratch.combination[i], j, scratch.combination[j]])
    return gap


@part
def _gap_to_itself(robot: RobotModel, limb: LimbModel, shapes: Shapes, least: float) -> float:
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


@part
def _gap_between(
    limb: LimbModel, shapes: Shapes, other: LimbModel, others: Shapes, least: float
) -> float:
    """Return the smallest distance between two limbs [m].

    If it is below `least`, any number below `least` may be returned.
    """
    gap = np.inf
    for a in range(limb.capsule_count):
        axis = axis_of(shapes.ends, a)
        for b in range(other.capsule_count):
            if gap < least:
                return gap
            radii = limb.capsules[a].radius + other.capsules[b].radius
            gap = min(gap, _capsule_gap(axis, axis_of(others.ends, b), radii, gap))
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
