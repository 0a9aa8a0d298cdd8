"""Boxes of a cabin, from the figures that a map brings.

Racks, closeouts, bulkheads, seat tracks and handrails.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.schema import NAME, Choice, Fields, Tuples
from mlivr_gym.values import LONGEST
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.rails import LENGTH, Handrail, Segment

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

FACE_AXES = {"deck": (2, 1), "overhead": (2, -1), "forward": (1, 1), "aft": (1, -1)}
"""Axis across each rack face and the sign of its inward normal."""


def _box(
    id: str, kind: str, face: str, centre: Any, half: Any, rotation: Array | None = None
) -> Box:
    return Box(
        id,
        kind,
        tuple(centre),
        tuple(half),
        Box.rows(np.eye(3) if rotation is None else rotation),
        face,
    )


LEVEL = Tuples((), most=LONGEST, unit="m")
RANGE = Tuples((2,), most=LONGEST, unit="m")

SCENE = Fields(
    {
        "rack_zone_x": RANGE,
        "panel_planes": Fields(
            dict.fromkeys(("deck_z", "overhead_z", "forward_y", "aft_y"), LEVEL)
        ),
        "rack_outer_span": LENGTH,
        "rack_post_length": LENGTH,
        "corner_closeout": Tuples((2, 2), most=LONGEST, unit="m"),
        "node2_opening": Fields({"y": RANGE, "z": RANGE}),
        "node2_vestibule": Fields({"x": RANGE, "y": RANGE, "z": RANGE}),
        "airlock_end": Fields(
            {"x": RANGE, "y": RANGE, "deck_z": LEVEL, "upper_z": RANGE}, {"end_bulkhead_x": LEVEL}
        ),
        "airlock": Fields(
            {"centre_yz": RANGE, "inner_radius": LENGTH, "outer_radius": LENGTH, "x": RANGE},
            {"inner_hatch_diameter": LENGTH},
        ),
    },
    {
        "rack_post_section": RANGE,
        "jlp_hatch_ring": Fields({"x": RANGE, "y": RANGE, "z": RANGE}),
    },
)
"""A map's `scene`: plane of the rack fronts on each face, rack sections, closeouts and ends [m]."""

RACK = Fields(
    {"id": NAME, "face": Choice(tuple(FACE_AXES)), "x_centre": LEVEL, "run_centre": LEVEL}
)
"""A rack of a map: its face and the middle of its front [m]."""


def module_boxes(scene: dict[str, Any], racks: tuple[dict[str, Any], ...]) -> Iterator[Box]:
    """Racks, corner closeouts and end bulkheads of a module.

    Args:
        scene: What `SCENE` reads.
        racks: What `RACK` reads, of each rack.

    Raises:
        MlivrError: If figures do not go together.
    """
    planes = scene["panel_planes"]
    levels = {
        "deck": planes["deck_z"], "overhead": planes["overhead_z"],
        "forward": planes["forward_y"], "aft": planes["aft_y"],
    }  # fmt: skip
    start, end = scene["rack_zone_x"]
    middle, half_x = 0.5 * (start + end), 0.5 * (end - start)
    for face, (axis, sign) in FACE_AXES.items():
        run = 3 - axis
        centre, half = np.zeros(3), np.zeros(3)
        centre[0], half[0] = middle, half_x
        centre[axis], half[axis] = levels[face] - sign * 0.06, 0.02
        centre[run] = 0.5 * sum(levels[f] for f, (a, _) in FACE_AXES.items() if a == run)
        half[run] = 1.02
        yield _box(f"{face}/shell", "panel", face, centre, half)
    yield from _racks(scene, racks, levels)
    yield from _closeouts(scene, middle, half_x)
    yield from _ends(scene)


def _racks(
    scene: dict[str, Any], racks: tuple[dict[str, Any], ...], levels: dict[str, float]
) -> Iterator[Box]:
    for rack in racks:
        axis, sign = FACE_AXES[rack["face"]]
        run = 3 - axis
        centre, half = np.zeros(3), np.zeros(3)
        centre[0], half[0] = rack["x_centre"], 0.5 * scene["rack_outer_span"]
        centre[axis], half[axis] = levels[rack["face"]] - sign * 0.02, 0.02
        centre[run], half[run] = rack["run_centre"], 0.5 * scene["rack_post_length"]
        yield _box(rack["id"], "rack", rack["face"], centre, half)


def _closeouts(scene: dict[str, Any], middle: float, half_x: float) -> Iterator[Box]:
    (y0, z0), (y1, z1) = scene["corner_closeout"]
    for sy in (-1.0, 1.0):
        for sz in (-1.0, 1.0):
            angle = np.arctan2(sz * (z1 - z0), sy * (y1 - y0))
            c, s = np.cos(angle), np.sin(angle)
            rotation = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
            centre = np.array([middle, sy * 0.5 * (y0 + y1), sz * 0.5 * (z0 + z1)])
            face, side = "deck" if sz < 0 else "overhead", "forward" if sy < 0 else "aft"
            yield _box(
                f"{face}/{side}/closeout", "closeout", face, centre, (half_x, 0.09, 0.01), rotation
            )


def _ends(scene: dict[str, Any]) -> Iterator[Box]:
    """What closes the module at the airlock and at Node 2."""
    end, airlock, vestibule = scene["airlock_end"], scene["airlock"], scene["node2_vestibule"]
    (x0, x1), (y0, y1) = end["x"], end["y"]
    centre_x, half_x = 0.5 * (x0 + x1), 0.5 * (x1 - x0)
    for face, at in (("deck", end["deck_z"]), ("overhead", end["upper_z"][1])):
        yield _box(f"{face}/airlock_end", "panel", face, (centre_x, 0.0, at), (half_x, y1, 0.01))
    for face, at in (("forward", y0), ("aft", y1)):
        yield _box(f"{face}/airlock_end", "panel", face, (centre_x, at, -0.05), (half_x, 0.01, 1.1))
    opening = [scene["node2_opening"][axis] for axis in "yz"]
    passage = [vestibule[axis] for axis in "yz"]
    middle_yz = [0.5 * sum(side) for side in opening]
    yield from _ring("node2/bulkhead", "starboard", (-0.02, 0.0), middle_yz, 0.6325, outer=1.13)
    half = max(0.5 * (high - low) for low, high in passage)
    middle_yz, x = [0.5 * sum(side) for side in passage], vestibule["x"]
    yield from _ring("node2/passage", "starboard", x, middle_yz, half, outer=half + 0.02)
    centre, inner = airlock["centre_yz"], airlock["inner_radius"]
    yield from _ring("airlock/bulkhead", "port", (x1, x1 + 0.02), centre, inner, outer=1.43)
    tube, wall = (airlock["x"][0], x1), airlock["outer_radius"]
    yield from _ring("airlock/tube", "port", tube, centre, inner, wall=wall)


def _ring(
    name: str,
    face: str,
    x: Sequence[float],
    centre: Sequence[float],
    inner: float,
    *,
    outer: float | None = None,
    wall: float = 0.0,
) -> Iterator[Box]:
    """A square plate or tube with a square opening, as four boxes.

    Args:
        name: What their names begin with.
        face: Cabin face.
        x: Where it begins and ends [m].
        centre: Middle of the opening, y and z [m].
        inner: Half width of the opening [m].
        outer: Half width of the outside about the axis [m].
        wall: Half width of the outside about the opening [m], where there is no `outer`.
    """
    y, z = centre
    low_y, high_y, low_z, high_z = (
        (-outer, outer, -outer, outer)
        if outer is not None
        else (y - wall, y + wall, z - wall, z + wall)
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
        segment.id,
        "track",
        segment.face,
        0.5 * (start + end) - 0.5 * segment.thickness * normal,
        half,
        rotation,
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
