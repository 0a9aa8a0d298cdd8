"""Boxes of a cabin: racks, closeouts, bulkheads, seat tracks and handrails, from the figures that a map brings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.shapes import Array, Box

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from mlivr_gym.grasp_map import Handrail, Segment

FACE_AXES = {"deck": (2, 1), "overhead": (2, -1), "forward": (1, 1), "aft": (1, -1)}
"""Axis across each rack face and the sign of its inward normal."""


def _box(id: str, kind: str, face: str, centre: Any, half: Any, rotation: Array | None = None) -> Box:
    return Box(id, kind, tuple(centre), tuple(half), Box.rows(np.eye(3) if rotation is None else rotation), face)


def module_boxes(figures: dict[str, Any], racks: list[dict[str, Any]]) -> Iterator[Box]:
    """Racks, corner closeouts and end bulkheads of a module, where the figures are given.

    Args:
        figures: The map's `scene`: plane of the rack fronts on each face, rack sections, closeouts and ends [m].
        racks: Face and centre of each rack [m].
    """
    planes = figures.get("panel_planes")
    if not planes:
        return
    start, end = figures["rack_zone_x"]
    middle, half_x = 0.5 * (start + end), 0.5 * (end - start)
    levels = {
        "deck": planes["deck_z"], "overhead": planes["overhead_z"],
        "forward": planes["forward_y"], "aft": planes["aft_y"],
    }  # fmt: skip
    half_width, half_length = 0.5 * figures["rack_outer_span"], 0.5 * figures["rack_post_length"]
    for face, (axis, sign) in FACE_AXES.items():
        run = 3 - axis
        centre, half = np.zeros(3), np.zeros(3)
        centre[0], half[0] = middle, half_x
        centre[axis], half[axis] = levels[face] - sign * 0.06, 0.02
        centre[run], half[run] = 0.5 * sum(levels[f] for f, (a, _) in FACE_AXES.items() if a == run), 1.02
        yield _box(f"{face}/shell", "panel", face, centre, half)
    for rack in racks:
        axis, sign = FACE_AXES[rack["face"]]
        run = 3 - axis
        centre, half = np.zeros(3), np.zeros(3)
        centre[0], half[0] = rack["x_centre"], half_width
        centre[axis], half[axis] = levels[rack["face"]] - sign * 0.02, 0.02
        centre[run], half[run] = rack["run_centre"], half_length
        yield _box(rack["id"], "rack", rack["face"], centre, half)
    (y0, z0), (y1, z1) = figures["corner_closeout"]
    for sy in (-1.0, 1.0):
        for sz in (-1.0, 1.0):
            angle = np.arctan2(sz * (z1 - z0), sy * (y1 - y0))
            c, s = np.cos(angle), np.sin(angle)
            rotation = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
            centre = np.array([middle, sy * 0.5 * (y0 + y1), sz * 0.5 * (z0 + z1)])
            face, side = "deck" if sz < 0 else "overhead", "forward" if sy < 0 else "aft"
            yield _box(f"{face}/{side}/closeout", "closeout", face, centre, (half_x, 0.09, 0.01), rotation)
    zone = figures["airlock_end"]
    centre_x, half_x = 0.5 * sum(zone["x"]), 0.5 * (zone["x"][1] - zone["x"][0])
    for face, at in (("deck", zone["deck_z"]), ("overhead", zone["upper_z"][1])):
        yield _box(f"{face}/airlock_end", "panel", face, (centre_x, 0.0, at), (half_x, zone["y"][1], 0.01))
    for face, at in (("forward", zone["y"][0]), ("aft", zone["y"][1])):
        yield _box(f"{face}/airlock_end", "panel", face, (centre_x, at, -0.05), (half_x, 0.01, 1.1))
    opening, passage = figures["node2_opening"], figures["node2_vestibule"]
    middle_yz = [0.5 * sum(opening["y"]), 0.5 * sum(opening["z"])]
    yield from _ring("node2/bulkhead", "starboard", (-0.02, 0.0), 1.13, middle_yz, 0.6325)
    sides = [0.5 * (passage[axis][1] - passage[axis][0]) for axis in "yz"]
    middle_yz = [0.5 * sum(passage[axis]) for axis in "yz"]
    yield from _ring("node2/passage", "starboard", passage["x"], max(sides) + 0.02, middle_yz, max(sides))
    airlock, end_x = figures["airlock"], zone["x"][1]
    centre, inner = airlock["centre_yz"], airlock["inner_radius"]
    yield from _ring("airlock/bulkhead", "port", (end_x, end_x + 0.02), 1.43, centre, inner)
    yield from _ring("airlock/tube", "port", (airlock["x"][0], end_x), None, centre, inner, airlock["outer_radius"])


def _ring(
    name: str, face: str, x: Sequence[float], outer: float | None, centre: list[float], inner: float, wall: float = 0.0
) -> Iterator[Box]:
    """A square plate or tube from `x[0]` to `x[1]` with a square opening of half width `inner` at (y, z): four boxes.

    The outside is a square of half width `outer` about the axis, or of `wall` about the opening.
    """
    y, z = centre
    low_y, high_y, low_z, high_z = (
        (-outer, outer, -outer, outer) if outer is not None else (y - wall, y + wall, z - wall, z + wall)
    )
    parts = (
        ((low_y, low_z), (high_y, z - inner)), ((low_y, z + inner), (high_y, high_z)),
        ((low_y, z - inner), (y - inner, z + inner)), ((y + inner, z - inner), (high_y, z + inner)),
    )  # fmt: skip
    for k, (low, high) in enumerate(parts):
        yield Box.between(f"{name}{k}", "bulkhead", (x[0], *low), (x[1], *high), face)


def track_box(segment: Segment) -> Box:
    """The strip of a seat track, its face in the plane of the grasps."""
    start, end, normal = (np.array(v) for v in (segment.start, segment.end, segment.normal))
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    rotation = np.column_stack([along, np.cross(normal, along), normal])
    half = (0.5 * length, 0.5 * segment.width, 0.5 * segment.thickness)
    return _box(
        segment.id, "track", segment.face, 0.5 * (start + end) - 0.5 * segment.thickness * normal, half, rotation
    )


def handrail_boxes(rail: Handrail) -> Iterator[Box]:
    """A bar on two posts; only the bounding box where the bar is not known."""
    if rail.bar_min is None or rail.bar_max is None:
        yield Box.between(rail.id, "handrail", rail.min, rail.max, rail.face)
        return
    yield Box.between(rail.id, "handrail", rail.bar_min, rail.bar_max, rail.face)
    along = "xyz".index(rail.axis)
    for side in (0, 1):
        low, high = list(rail.min), list(rail.max)
        if side == 0:
            high[along] = rail.bar_min[along] + 0.008
        else:
            low[along] = rail.bar_max[along] - 0.008
        yield Box.between(f"{rail.id}/post{side}", "stanchion", low, high, rail.face)
