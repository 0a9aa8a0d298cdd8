"""The US Laboratory (Destiny): seat tracks, 45 degree tracks and handrails, from published figures.

`station_places.py` writes the map. Racks and standoffs are measured on NASA's mesh of the module,
as those of the JEM are in `jem.json`; the handrails are those of a published world of Robonaut 2.
The two fit together: both put the plane in which deck handrails stand at 1.093 m below the axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from reports import plain

from mlivr_gym.arrays import Array

TRACKS = {
    "deck": (
        (-3.1817, -1.0806, -0.0223), (-2.1626, -1.0806, -0.0223), (-2.1121, -1.0806, -0.0223),
        (-1.0930, -1.0806, -0.0223), (-1.0440, -1.0799, -0.0181), (-0.0248, -1.0799, -0.0181),
        (0.0244, -1.0799, -0.0207), (1.0435, -1.0799, -0.0208), (1.0946, -1.0806, -0.0223),
        (2.1137, -1.0806, -0.0223), (2.1621, -1.0799, -0.0230), (3.1813, -1.0799, -0.0230),
    ),
    "overhead": (
        (-3.1753, 1.0799, -0.0177), (-2.1561, 1.0799, -0.0176), (-2.1074, 1.0799, -0.0177),
        (-1.0882, 1.0799, -0.0176), (-1.0532, 1.0801, -0.0301), (-0.0340, 1.0801, -0.0300),
        (0.0180, 1.0859, -0.0200), (1.0372, 1.0859, -0.0199), (2.1677, 1.0854, -0.0197),
        (3.1868, 1.0854, -0.0196),
    ),
    "port": (
        (-3.1753, -1.0791, -0.0148), (-2.1561, -1.0791, -0.0148), (-2.1074, -1.0839, -0.0165),
        (-1.0882, -1.0839, -0.0164), (-1.0304, -1.0707, -0.0140), (-0.0113, -1.0707, -0.0139),
        (0.0180, -1.0851, -0.0172), (1.0372, -1.0851, -0.0171), (1.0991, -1.0838, -0.0165),
        (2.1183, -1.0838, -0.0165), (2.1631, -1.0863, -0.0181), (3.1823, -1.0863, -0.0180),
    ),
    "starboard": (
        (-3.1822, 1.1046, -0.0174), (-2.1630, 1.1046, -0.0175), (-2.1106, 1.0979, -0.0123),
        (-1.0915, 1.0979, -0.0124), (-1.0471, 1.0948, -0.0123), (-0.0279, 1.0948, -0.0124),
        (0.0221, 1.0948, -0.0123), (1.0412, 1.0948, -0.0124), (1.0947, 1.0946, -0.0165),
        (2.1138, 1.0946, -0.0165), (2.1727, 1.0962, -0.0180), (3.1918, 1.0962, -0.0181),
    ),
}  # fmt: skip
"""Seat tracks of the racks: place along the module, of the surface across the face, and of the
middle along the track [m]. No rack of the mesh is in the fifth bay overhead."""

TRACK, WIDTH, THICKNESS = 1.7578, 0.0261, 0.0125
"""Length and width of a seat track, and its height above the front of its rack: half the depth of
the body that the mesh has, since handrails stand at that plane [m]."""

STANDOFFS = {
    "deck port": (1.5094, -0.009), "deck starboard": (1.5086, 0.001),
    "overhead port": (1.5356, -0.006), "overhead starboard": (1.5402, 0.0015),
}  # fmt: skip
"""Front faces of the four standoffs, at 45 degrees to the racks: distance from the axis of the
module, and of their middle from the diagonal, towards the direction `across` [m]."""

HALF_FACE = 0.08
"""Half the width of these faces [m]."""

LAMPS = {
    "overhead port": (-2.879, -1.806, -0.739, 0.330, 1.395, 2.465),
    "overhead starboard": (-2.459, -1.393, -0.325, 0.744, 1.815, 2.880),
}
"""Middles of the lamps on the upper standoffs, along the module [m]."""

LAMP, LAMP_DEPTH, LAMP_WIDTH = 0.552, 0.0685, 0.076
"""Length of a lamp, how far it stands out, and its width [m]."""

ENDS, PITCH = (-3.19, 3.2), 1.069
"""Where the rows of racks end, along the module, and the distance of racks [m]."""

HANDRAILS = (
    ("stow", (-3.2258, -0.86, -1.09314), (0.0, 0.0)),
    ("deck_1", (-2.2098, -0.37729, -1.09314), (0.0, 90.0)),
    ("deck_2", (-1.0848, -0.15, -1.09314), (0.0, 90.0)),
    ("deck_3", (-0.025, -0.67729, -1.09314), (0.0, 90.0)),
    ("deck_4", (1.04, -0.15, -1.09314), (0.0, 90.0)),
    ("port_0", (-1.0848, -1.1, 0.6), (-90.0, 90.0)),
    ("port_1", (-0.0402, -1.1, 0.1), (-90.0, 90.0)),
    ("port_2", (1.055, -1.1, 0.6), (-90.0, 90.0)),
    ("port_3", (2.06, -1.1, 0.1), (-90.0, 90.0)),
    ("stbd_0", (-2.2098, 1.09, 0.6), (90.0, -90.0)),
    ("stbd_1", (-1.0848, 1.09, 0.1), (90.0, -90.0)),
    ("stbd_2", (-0.03, 1.09, 0.6), (90.0, -90.0)),
    ("stbd_3", (1.04, 1.09, 0.1), (90.0, -90.0)),
    ("stbd_4", (2.06, 1.09, 0.6), (90.0, -90.0)),
)
"""Handrails of the US Lab: name, place [m], roll and yaw [degrees] (Chunting/r2_planning)."""

BAR, STAND_OFF, BAR_SECTION = 1.0541, 0.0757, (0.0187, 0.0324)
"""Length of a bar, 41.5 inches; its top above the wall, width and depth, as measured in the JEM
[m]."""

WALLS = {
    "deck": (2, -1.0931),
    "overhead": (2, 1.0984),
    "port": (1, -1.0988),
    "starboard": (1, 1.1171),
}
"""Axis and place of the fronts of the racks [m]: behind the tracks that stand back most."""

FRONT = 0.96
"""Half the height of the fronts of the racks, beside which the standoffs begin [m]."""

CABIN = {"min": [-3.27, -1.0863, -1.0806], "max": [3.27, 1.0948, 1.0799]}
"""Room between the racks [m]."""

PANEL = 0.04
"""Thickness of a wall [m]: assumed."""


def rack_tracks() -> list[dict[str, Any]]:
    """Return the tracks of the racks; `D1a` is the forward one of the first rack of the deck."""
    found = []
    for face, rows in TRACKS.items():
        axis = WALLS[face][0]
        for k, (along, surface, middle) in enumerate(rows):
            place, normal, half = np.zeros(3), np.zeros(3), np.zeros(3)
            place[[0, axis, 3 - axis]] = along, surface, middle
            normal[axis], half[3 - axis] = -np.sign(surface), 0.5 * TRACK
            first = rows[k - k % 2][0]
            bay = 1 + round((first - ENDS[0]) / PITCH)
            found.append(
                {
                    "id": f"{face[0].upper()}{bay}{'ab'[k % 2]}", "face": face,
                    "start": plain(place - half), "end": plain(place + half),
                    "normal": plain(normal), "width": WIDTH, "thickness": THICKNESS,
                }
            )  # fmt: skip
    return found


def standoff(name: str) -> tuple[Array, Array, float, float]:
    """Return normal and direction `across` of a standoff's face, and where its middle is."""
    level, side = name.split()
    out = np.array([0.0, 1.0 if side == "port" else -1.0, 1.0 if level == "deck" else -1.0])
    away, middle = STANDOFFS[name]
    normal = np.sqrt(0.5) * out
    return normal, np.cross([1.0, 0.0, 0.0], -normal), away, middle


def standoff_tracks() -> list[dict[str, Any]]:
    """Return a seat track along the middle of each standoff's face, with gaps at the lamps."""
    found = []
    for name in STANDOFFS:
        normal, across, away, middle = standoff(name)
        place = middle * across - (away - THICKNESS) * normal
        marks = [
            ENDS[0],
            *(x + s * 0.5 * LAMP for x in LAMPS.get(name, ()) for s in (-1, 1)),
            ENDS[1],
        ]
        pieces = [
            (a, b) for a, b in zip(marks[::2], marks[1::2], strict=True) if b - a > 2.0 * WIDTH
        ]
        level, side = name.split()
        for k, ends in enumerate(pieces, 1):
            start, end = (plain([x, *place[1:]]) for x in ends)
            found.append(
                {
                    "id": f"{level[0]}{side[0]}{k}".upper(), "face": name,
                    "start": start, "end": end, "normal": normal.tolist(),
                    "width": WIDTH, "thickness": THICKNESS,
                }
            )  # fmt: skip
    return found


def handrails() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the bars as rails that can be held, and the handrails with posts as obstacles."""
    bars, whole = [], []
    for name, place, (roll, yaw) in HANDRAILS:
        c, s = np.round([np.cos(np.deg2rad(roll)), np.sin(np.deg2rad(roll))], 9)
        turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        c, s = np.round([np.cos(np.deg2rad(yaw)), np.sin(np.deg2rad(yaw))], 9)
        along = turn @ [c, s, 0.0]
        start = np.array(place) + STAND_OFF * turn[:, 2]
        end = start + BAR * along
        bars.append(
            {
                "id": name, "face": "handrails", "start": plain(start), "end": plain(end),
                "normal": (turn[:, 2] + 0.0).tolist(),
                "width": BAR_SECTION[0], "thickness": BAR_SECTION[1],
            }
        )  # fmt: skip
        beside = 0.5 * BAR_SECTION[0] * np.cross(turn[:, 2], along)
        foot = STAND_OFF * turn[:, 2]
        corners = np.array([start - beside, end + beside, start - foot, end - foot])
        bar = np.array([*corners[:2], start - beside - BAR_SECTION[1] * turn[:, 2]])
        whole.append(
            {
                "id": f"{name}/handrail",
                "face": {"port": "port", "stbd": "starboard"}.get(name[:4], "deck"),
                "axis": "xyz"[int(np.abs(along).argmax())],
                "min": plain(corners.min(axis=0)), "max": plain(corners.max(axis=0)),
                "bar_min": plain(bar.min(axis=0)), "bar_max": plain(bar.max(axis=0)),
            }
        )  # fmt: skip
    return bars, whole


def boxes() -> list[dict[str, Any]]:
    """Return the fronts of the racks, the faces of the standoffs and their lamps."""
    low, high, found = np.array(CABIN["min"]), np.array(CABIN["max"]), []
    for face, (axis, place) in WALLS.items():
        ends = np.array([[low[0], -FRONT, -FRONT], [high[0], FRONT, FRONT]])
        ends[:, axis] = sorted((place, place + np.sign(place) * PANEL))
        found.append({"id": face, "face": face, "min": plain(ends[0]), "max": plain(ends[1])})
    for name in STANDOFFS:
        normal, across, away, middle = standoff(name)
        turn = np.column_stack([[1.0, 0.0, 0.0], across, normal])
        face = {"face": name, "rotation": turn.tolist()}
        centre = middle * across - (away + 0.5 * PANEL) * normal
        found.append(
            {
                "id": f"{name} standoff", "kind": "closeout", **face,
                "centre": plain([0.5 * sum(ENDS), *centre[1:]]),
                "half": [0.5 * (ENDS[1] - ENDS[0]), HALF_FACE, 0.5 * PANEL],
            }
        )  # fmt: skip
        for k, x in enumerate(LAMPS.get(name, ()), 1):
            centre = middle * across - (away - 0.5 * LAMP_DEPTH) * normal
            found.append(
                {
                    "id": f"{name} lamp {k}", **face, "centre": plain([x, *centre[1:]]),
                    "half": [0.5 * LAMP, 0.5 * LAMP_WIDTH, 0.5 * LAMP_DEPTH],
                }
            )  # fmt: skip
    return found


def uslab() -> dict[str, Any]:
    """Return the map of the US Lab."""
    bars, whole = handrails()
    return {
        "name": "uslab",
        "description": "The US Laboratory Module (Destiny): seat tracks of its 23 racks, tracks at "
        "45 degrees along its four standoffs, and handrails.",
        "frame": "that of the handrails' source: x aft along the module, y starboard, z overhead; "
        "metres",
        "sources": {
            "tracks": "NASA's mesh of the module (IGOAL): us_lab.obj of danielpmorton/pyastrobee, "
            "commit 43c9c844, which has us_lab.dae of nasa/astrobee_media; scaled by 1.0858, as "
            "astrobee_iss/urdf/model.urdf of nasa/astrobee_media does after hatches and maps of "
            "the station; NASA media usage guidelines",
            "handrails": "Chunting/r2_planning commit 353f2f7e7e72e7d40a4341e7fc71111a32501d45 "
            "(BSD), r2_planning_demos/world/iss_navigation.world.yaml: poses of 14 handrails of "
            "41.5 inches in the world of Robonaut 2",
            "bar": "cross-section and stand-off as measured in the JEM, jem.json",
        },
        "provenance": {
            "tracks": "measured (mesh): 46 seat tracks on the posts of 23 racks",
            "standoffs": "measured (mesh): faces at 45 degrees between the racks of neighbouring "
            "sides, and the lamps on the upper two. The mesh has no tracks on them: assumed is one "
            "seat track along the middle of each face, with gaps at the lamps",
            "frames": "mesh and handrails: forward, starboard and overhead from the names of the "
            "bulkheads and of the handrails; assumed is that both have their middle at the middle "
            "of the racks' tracks. So deck handrails lie within 0.06 m of a track, and the plane "
            "in which they stand is that through the middle of the tracks",
            "handrails": "published poses; assumed that a pose is the end of a bar, which runs "
            "along its x axis with z outwards, roll after yaw: so read all bars lie in the room; "
            "a post at each end",
            "points": "assumed: every 0.2 m of a track or bar, but for tracks under handrails",
            "boxes": "assumed: a wall behind the tracks on each side; equipment that stands out "
            "from the racks is left out",
            "cabin": "the room between the tracks",
        },
        "segments": [*rack_tracks(), *standoff_tracks(), *bars],
        "handrails": whole,
        "spacing": 0.2,
        "clearance": 0.03,
        "cabin": CABIN,
        "boxes": boxes(),
    }  # fmt: skip
