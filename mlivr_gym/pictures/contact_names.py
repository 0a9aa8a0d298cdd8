"""Names of the shapes of a contact, and their witness points (nearest points of two shapes)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Contact
from mlivr_gym.pictures.robot_shapes import Part, nearest_pair, segment_samples
from mlivr_gym.world.boxes import BOX, Box

KINDS = {
    "panel": "wall",
    "rack": "rack",
    "closeout": "corner closeout",
    "bulkhead": "bulkhead",
    "track": "seat track",
    "handrail": "handrail",
    "stanchion": "post of handrail",
    "obstacle": "obstacle",
}
"""Names of the kinds of boxes."""

NUMBERED = ("rack", "track", "handrail", "stanchion", "obstacle")
"""Kinds whose boxes are named by their ids; other boxes are named by their faces."""


def shape_name(name: str, boxes: Mapping[str, Box]) -> str:
    """Return a readable name of a shape in the scene, as `"forearm of limb 0"` or `"rack F1"`."""
    if name.startswith(BOX):
        box = boxes[name]
        if box.kind in NUMBERED:
            return f"{KINDS[box.kind]} {box.id.split('/')[0]}"
        return f"{box.face} {KINDS[box.kind]}"
    limb, *link = name.split("/")
    if not limb.startswith("limb"):
        return limb  # the body or the cargo
    part = {"base": "mount"}.get(link[0], link[0].replace("_", " "))
    return f"{part} of limb {limb.removeprefix('limb')}"


def contact_sentence(contact: Contact, gap: float, boxes: Mapping[str, Box]) -> str:
    """Describe a contact with the gap between its shapes [m], which is negative if they overlap."""
    first, second = shape_name(contact.first, boxes), shape_name(contact.second, boxes)
    if gap > 0.0:
        return f"{first} {1e3 * gap:.0f} mm from {second}"
    return f"{first} {-1e3 * gap:.0f} mm deep in {second}"


class WitnessPoints(NamedTuple):
    """The nearest points of two shapes, or those of their deepest overlap."""

    first: Array
    """Point on the surface of the first shape, shape (3,) [m]."""
    second: Array
    """Point on the surface of the second shape, shape (3,) [m]."""
    normal: Array
    """Unit vector from the first shape to the second, shape (3,)."""

    @property
    def gap(self) -> float:
        """Signed distance of the shapes [m], negative if they overlap."""
        return float((self.second - self.first) @ self.normal)


def witness_points(first: Part, second: Part | Box) -> WitnessPoints:
    """Compute the witness points of two shapes, to within a tenth of a millimetre.

    If the axis of a capsule intersects a box, the gap is minus the distance by which the capsule
    would have to move along an edge of the box to leave it.
    """
    axis = _axis_samples(first)  # of the body: its edges
    if isinstance(second, Part) and second.box is not None:
        second = second.box
    if isinstance(second, Part):
        here, there = nearest_pair(axis, _axis_samples(second))
        return _between_rounded(here, there, first.radius, second.radius)
    rotation, half = np.array(second.rotation), np.array(second.half)
    local = (axis - np.array(second.centre)) @ rotation
    nearest = np.clip(local, -half, half)
    distances = np.linalg.norm(local - nearest, axis=1)
    k = int(np.argmin(distances))
    if distances[k] > 0.0:
        surface = rotation @ nearest[k] + np.array(second.centre)
        return _between_rounded(axis[k], surface, first.radius, 0.0)
    # Depth below each face, in the order -x, +x, -y, +y, -z, +z.
    depth = np.stack([half + local, half - local], axis=2).reshape(-1, 6)
    face = int(np.argmin(depth.max(axis=0)))
    normal = rotation[:, face // 2] * (1.0 if face % 2 == 0 else -1.0)
    k = int(np.argmax(depth[:, face]))
    return WitnessPoints(
        axis[k] + first.radius * normal, axis[k] - float(depth[k, face]) * normal, normal
    )


def _between_rounded(here: Array, there: Array, radius: float, other: float) -> WitnessPoints:
    """Return the witness points of two capsules by the nearest points of their axes and radii."""
    size = float(np.linalg.norm(there - here))
    normal = (there - here) / size if size > 1e-9 else np.array([0.0, 0.0, 1.0])
    return WitnessPoints(here + radius * normal, there - other * normal, normal)


def _axis_samples(part: Part) -> Array:
    """Sample the axes of a shape densely, shape (k, 3) [m]."""
    return np.concatenate([segment_samples(start, end, 801) for start, end in part.axes])
