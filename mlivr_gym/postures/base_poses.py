"""Base poses of stances by their numbers among the candidates (compiled)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.kinematics.poses import Pose, columns, dot, minus, vector
from mlivr_gym.postures.base_frames import mean_over_limbs, scaled_to_one, set_frame
from mlivr_gym.postures.geometries import RESOLUTION
from mlivr_gym.postures.records import StanceGeometry
from mlivr_gym.postures.relabelling import first_limb, sorting_keys
from mlivr_gym.postures.selection import pose_count, set_pose

if TYPE_CHECKING:
    from mlivr_gym.values import Triple


class BaseRule(NamedTuple):
    """What base poses of N limbs on m points depend on."""

    positions: Array
    """The points [m], shape (m, 3)."""
    rotations: Array
    """Their axes in the world: rail, side and normal, shape (m, 3, 3)."""
    candidates: Any
    """The candidates, a record of `PostureRule`, shape (1,)."""
    mounts: Array
    """Directions of the mounts across the body's z axis, see `base_frames`, shape (N, 2)."""
    has_first: bool
    """Whether the first limb of the rule is to be found; else it is limb 0."""
    turns: Array
    """Axes of the base by its first limb, if that were limb 0, shape (N, 3, 3); (0, 3, 3) if it
    is."""


class BaseScratch(NamedTuple):
    """Work space for one stance of N limbs, in the frame of the grasp of its first limb."""

    positions: Array
    """Held points, and then those relative to their centroid [m], shape (N, 3)."""
    normals: Array
    """Surface normals, shape (N, 3)."""
    keys: Array
    """What chooses the first limb, see `first_limb`."""
    geometry: Any
    """Axes of the candidates, a record of `StanceGeometry`, shape (1,)."""

    @classmethod
    def allocate(cls, limbs: int) -> BaseScratch:
        """Allocate the work space for some number of limbs."""
        positions, normals = np.zeros((2, limbs, 3))
        return cls(positions, normals, sorting_keys(limbs), StanceGeometry.rows(1))


@entry
def set_bases(
    stances: IntArray, numbers: IntArray, rule: BaseRule, scratch: BaseScratch, bases: Any
) -> None:
    """Write base poses of stances (k, N) by number (k,), records of `Pose` in the world."""
    for k in range(len(stances)):
        first = 0
        if rule.has_first:
            first = first_limb(rule.positions, stances[k], scratch.keys)
        _set_base(stances[k], first, numbers[k], rule, scratch, bases[k])


@kernel
def _set_base(
    stance: IntArray, first: int, number: int, rule: BaseRule, scratch: BaseScratch, base: Pose
) -> None:
    """Write the base pose of a stance by number, computed in the frame of its first grasp.

    There it is the same to the last bit in all stances of the same rounded relative geometry.
    """
    held, geometry, candidates = scratch.positions, scratch.geometry[0], rule.candidates[0]
    place, frame = rule.positions[stance[first]], rule.rotations[stance[first]]
    _set_grasps(stance, first, rule, scratch)
    centroid = mean_over_limbs(held)
    for limb in range(len(stance)):
        for axis in range(3):
            held[limb, axis] -= centroid[axis]
    axes = geometry.frame, geometry.out, geometry.line
    geometry.opposed = set_frame(held, scratch.normals, (1.0, 0.0, 0.0), rule.mounts, axes)
    if 0 <= number < pose_count(geometry, candidates):
        set_pose(geometry, candidates, number, base)
    for axis in range(3):
        base.position[axis] += centroid[axis]
    there = _turned(frame, vector(base.position))
    x, y, z = columns(base.rotation)
    _set_columns(base.rotation, (_turned(frame, x), _turned(frame, y), _turned(frame, z)))
    for axis in range(3):
        base.position[axis] = place[axis] + there[axis]
    if len(rule.turns):
        x, y, z = columns(rule.turns[first])
        turned = _turned(base.rotation, x), _turned(base.rotation, y), _turned(base.rotation, z)
        _set_columns(base.rotation, turned)


@kernel
def _set_grasps(stance: IntArray, first: int, rule: BaseRule, scratch: BaseScratch) -> None:
    """Write points and normals of a stance in the frame of the grasp of its first limb, rounded."""
    limbs, place = len(stance), vector(rule.positions[stance[first]])
    x, y, z = columns(rule.rotations[stance[first]])
    for axis in range(3):
        scratch.positions[0, axis], scratch.normals[0, axis] = 0.0, 1.0 if axis == 2 else 0.0
    for limb in range(1, limbs):
        other = stance[(first + limb) % limbs]
        apart = minus(vector(rule.positions[other]), place)
        _, _, normal = columns(rule.rotations[other])
        apart = _rounded(dot(x, apart)), _rounded(dot(y, apart)), _rounded(dot(z, apart))
        normal = _rounded(dot(x, normal)), _rounded(dot(y, normal)), _rounded(dot(z, normal))
        normal = scaled_to_one(normal)
        for axis in range(3):
            scratch.positions[limb, axis], scratch.normals[limb, axis] = apart[axis], normal[axis]


@kernel
def _rounded(coordinate: float) -> float:
    """Return the closest multiple of `RESOLUTION`."""
    return int(np.rint(coordinate / RESOLUTION)) * RESOLUTION


@kernel
def _turned(frame: Array, v: Triple) -> Triple:
    """Return a vector of a frame, shape (3, 3), in the axes outside it."""
    x, y, z = v
    return (
        frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z,
        frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z,
        frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z,
    )


@kernel
def _set_columns(frame: Array, axes: tuple[Triple, Triple, Triple]) -> None:
    """Write the columns of a frame, shape (3, 3)."""
    x, y, z = axes
    for k in range(3):
        frame[k, 0], frame[k, 1], frame[k, 2] = x[k], y[k], z[k]
