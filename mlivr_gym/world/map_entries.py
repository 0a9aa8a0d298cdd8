"""Map files: their fields, and the points that their entries make."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.schema import NAME, Anything, FieldPath, Fields, Listed, Numbers, Tuples
from mlivr_gym.values import LONGEST, MOST_POINTS, SMALLEST
from mlivr_gym.world.boxes import CORNER, Boxes
from mlivr_gym.world.rails import DIRECTION, HANDRAIL, SEGMENT, Handrail, Segment

MARGIN = 1.5
"""How far from the box of all points the base may be [m] where a map gives no cabin.

The robots that ship hold a point at most 1.46 m from the middle of their body.
"""

UNIT_TOLERANCE = 1e-6
"""Largest deviation of a unit vector's length, and of its right angles, from 1 and 0."""

SPACING = Tuples((), SMALLEST, LONGEST, "m")
"""Distance of points along a rail."""

CLEARANCE = Tuples((), 0.0, LONGEST, "m")
"""Distance of points from handrails."""

POINT = Fields(
    {"id": NAME, "face": NAME, "position": CORNER, "normal": DIRECTION, "rail": DIRECTION}
)
"""A point of a map file."""

REMARKS = ("description", "frame", "sources", "provenance")
"""Fields of a map file for its readers."""

MODULE = Fields(
    {},
    {
        **dict.fromkeys(REMARKS, Anything()),
        "name": NAME,
        "points": Listed(POINT, most=MOST_POINTS),
        "segments": Listed(SEGMENT),
        "spacing": SPACING,
        "handrails": Listed(HANDRAIL),
        "clearance": CLEARANCE,
        "cabin": Fields({"min": CORNER, "max": CORNER}),
        "boxes": Boxes("panel"),
    },
)
"""A map file."""

POINTS = Fields(
    {
        "name": NAME,
        "ids": Listed(NAME, 1, MOST_POINTS),
        "faces": Listed(NAME, 1, MOST_POINTS),
        "positions": Numbers((None, 3), most=LONGEST, unit="m", rows=(1, MOST_POINTS)),
        "rotations": Numbers((None, 3, 3), rows=(1, MOST_POINTS)),
        "cabin": Numbers((2, 3), most=LONGEST, unit="m"),
        "segments": Listed(SEGMENT),
        "handrails": Listed(HANDRAIL),
        "boxes": Boxes("panel"),
    }
)
"""A map as `GraspMap.to_dict` writes it, and the fields of one that is made."""

Row = tuple[str, str, Array, Array, float]
"""Id, face, position and rotation in the map's frame, width of the rail across [m]."""


def _frame(place: FieldPath, rail: Array, normal: Array) -> Array:
    length = float(np.linalg.norm(normal))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise place.field("normal").fault(
            f"is {normal.tolist()}, of length {length:.6g}; its length must be 1"
        )
    if not np.linalg.norm(rail) > SMALLEST:
        raise place.fault("has a rail without a direction")
    rail = rail / np.linalg.norm(rail)
    if abs(float(rail @ normal)) > UNIT_TOLERANCE:
        raise place.fault(f"has a rail that is not at right angles to normal {normal.tolist()}")
    return np.column_stack([rail, np.cross(normal, rail), normal])


def point_row(data: dict[str, Any], place: FieldPath) -> Row:
    """Return a point that `POINT` has read, its rail without width."""
    frame = _frame(place, np.array(data["rail"]), np.array(data["normal"]))
    return data["id"], data["face"], np.array(data["position"]), frame, 0.0


def discretise(segment: Segment, spacing: float, most: int, place: FieldPath) -> list[Row]:
    """Return points at multiples of `spacing` [m] from the segment's middle, about `most`."""
    start, end = np.array(segment.start), np.array(segment.end)
    length = float(np.linalg.norm(end - start))
    frame = _frame(place, end - start, np.array(segment.normal))
    if length > spacing * most:
        raise place.fault(
            f"is {length:g} m long and has too many points {spacing:g} m apart: "
            f"a map has at most {MOST_POINTS}; take a larger spacing"
        )
    half = int(np.floor(0.5 * length / spacing + 1e-9))
    middle, along = 0.5 * (start + end), frame[:, 0]
    points = [middle + k * spacing * along for k in range(-half, half + 1)]
    return [
        (f"{segment.id}:{k}", segment.face, point, frame, segment.width)
        for k, point in enumerate(points)
    ]


def clear_of_handrails(
    rows: list[Row], handrails: tuple[Handrail, ...], clearance: float
) -> list[Row]:
    """Return points whose rail keeps `clearance` [m] from each handrail's footprint on the face."""
    if not rows:
        return []
    faces, positions = np.array([row[1] for row in rows]), np.array([row[2] for row in rows])
    frames, width = np.array([row[3] for row in rows]), np.array([row[4] for row in rows])
    reach = clearance + 0.5 * width[:, None] * np.abs(frames[:, :, 1])
    across = np.abs(frames[:, :, 2]) >= 0.5
    free = np.ones(len(rows), dtype=np.bool_)
    for rail in handrails:
        inside = (np.array(rail.min) - reach <= positions) & (
            positions <= np.array(rail.max) + reach
        )
        free &= ~((faces == rail.face) & (inside | across).all(axis=1))
    return [row for row, kept in zip(rows, free, strict=True) if kept]
