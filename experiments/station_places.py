"""Make the places and the robot outside and inside the station that ship beside the JEM.

    python experiments/station_places.py

It writes `truss.json`, `uslab.json` and `ssrms2.json` into `envs_assets/` from the published
figures below; `source` and `sources` of each file say which figure comes from where, and what is
assumed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from reports import ROOT, table, write_assets
from us_lab import uslab

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MapError
from mlivr_gym.files import read_json
from mlivr_gym.robot.ssrms_limb import ELBOW, PITCH, SsrmsLimb
from mlivr_gym.world.grasp_map import PLACES, as_map

SEGMENTS = {"P1": (-20.4, -6.7), "S0": (-6.7, 6.7), "S1": (6.7, 20.4)}
"""Ends of the truss segments along x [m]: S0 is 13.4 m long, P1 and S1 13.7 m (NASA)."""

WIDTH, HEIGHT = 4.6, 4.0
"""Cross-section of the truss along y and z [m], 15 ft by 13 ft (NASA, P1)."""

FIXTURES, PITCH_OF_FIXTURES = 12, 3.4
"""Grapple fixtures along each face, and their distance [m]: assumed."""

FACES = {
    "forward": ((0.0, 1.0, 0.0), 0.5 * WIDTH),
    "zenith": ((0.0, 0.0, 1.0), 0.5 * HEIGHT),
    "aft": ((0.0, -1.0, 0.0), 0.5 * WIDTH),
    "nadir": ((0.0, 0.0, -1.0), 0.5 * HEIGHT),
}
"""Outward normals of the faces of the truss, and their distance from its axis [m]."""

ROOM = 16.0
"""How far from the truss the base may be [m]: the reach of an arm."""


def truss() -> dict[str, Any]:
    """Return the map of three segments of the integrated truss."""
    points = []
    for face, (normal, distance) in FACES.items():
        for k in range(FIXTURES):
            along = (k - 0.5 * (FIXTURES - 1)) * PITCH_OF_FIXTURES
            place = np.array([along, 0.0, 0.0]) + distance * np.array(normal)
            points.append(
                {
                    "id": f"{face}:{k}", "face": face, "position": np.round(place, 6).tolist(),
                    "normal": list(normal), "rail": [1.0, 0.0, 0.0],
                }
            )  # fmt: skip
    half = (0.5 * WIDTH, 0.5 * HEIGHT)
    ends = min(x for x, _ in SEGMENTS.values()), max(x for _, x in SEGMENTS.values())
    low, high = [ends[0], -half[0], -half[1]], [ends[1], *half]
    return {
        "name": "truss",
        "description": "Segments P1, S0 and S1 of the station's integrated truss, each a box, with "
        "grapple fixtures on its four long faces.",
        "frame": "origin in the middle of S0, x starboard along the truss, y forward, z zenith; "
        "metres",
        "sources": {
            "segments": "NASA, STS-110 cargo (S0: 13.4 m long, 4.6 m wide) and STS-113 (P1: 13.7 m "
            "long, 4.6 m wide, 4 m high), spaceflight.nasa.gov; S1 as P1 (NASA KSC-99PP-1185: 45 "
            "ft long, 15 ft wide)",
        },
        "provenance": {
            "points": "assumed: a grapple fixture every 3.4 m along the middle of each face. The "
            "station's own fixtures are fewer, on modules and on the mobile base, whose eight "
            "worksites lie along the forward face",
            "boxes": "assumed: full boxes in place of open trusswork and its equipment",
        },
        "points": points,
        "cabin": {"min": (np.array(low) - ROOM).tolist(), "max": (np.array(high) + ROOM).tolist()},
        "boxes": [
            {
                "id": name, "min": [start, -half[0], -half[1]], "max": [end, *half],
            }
            for name, (start, end) in SEGMENTS.items()
        ],
    }  # fmt: skip


BODY_EDGE, BODY_MASS = 1.0, 500.0
"""Edge [m] and mass [kg] of the body between the arms: assumed."""

MASSES = (243.66, 105.98, 105.98, 314.88, 279.2, 105.98, 105.98, 243.66)
"""Masses of the bodies B1 to B8 of the SSRMS [kg] (Nguyen and Hughes 1994)."""

INERTIAS = (
    (9.336, 44.413, 44.413, 0.0),
    (12.19, 12.13, 3.061, 0.0),
    (8.088, 3.061, 8.446, 0.0),
    (15.41, 2094.71, 2103.19, 49.52),
    (9.522, 1966.28, 1966.28, -39.95),
    (8.305, 3.061, 8.0386, 0.0),
    (12.13, 12.13, 3.061, 0.0),
    (9.336, 44.41, 44.41, 0.0),
)
"""Their inertias xx, yy, zz, xy in their published axes [kg m^2]."""

TORQUE, SPEED = 2332.0, 0.0698132
"""Largest torque [N m] and speed of each joint, 4 degrees a second [rad/s]."""

ROTOR = 0.1
"""Inertia of the rotors through their gears [kg m^2]: not published, far below that of the links.
"""

AXES = ("xyz", "xyz", "xzY", "xzY", "xzY", "yxZ", "yzx")
"""Axes of the limb's frames of B2 (its base) to B8 as published axes, a capital runs backwards."""

_D4, _SECOND = 2.0 * PITCH + ELBOW, PITCH + ELBOW

ORIGINS = (
    (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, PITCH, 0.0), (0.0, _SECOND, 0.0), (0.0, -PITCH, 0.0),
    (0.0, 0.0, -0.7026), (1.3589, 0.0, 0.0),
)  # fmt: skip
"""Origins of those frames in the published ones [m]."""

MIDDLES = (
    (0.0, 0.0, 0.3513), (0.0, -0.5 * PITCH, 0.0), (3.555, 0.0, 0.0), (3.555, 0.0, 0.0),
    (0.0, -0.5 * PITCH, 0.0), (0.0, 0.0, -0.3513), (0.67945, 0.0, 0.0),
)  # fmt: skip
"""Middles of B2 to B8 in the published frames [m], where their centres of mass are assumed."""

SCALE = 17.4
"""Length of the two booms, as a multiple of upper arm and forearm of the UR5e."""

HELD_ANGLE = round(0.5 * np.pi, 9)
"""Angle at which the roll of the shoulder is held [rad]."""

LATCH = 0.4
"""Length of the end effector that counts as the gripper [m]: assumed."""


def tensor(inertia: tuple[float, ...]) -> Array:
    """Return the inertia of a published body, shape (3, 3) [kg m^2]."""
    xx, yy, zz, xy = inertia
    return np.array([[xx, xy, 0.0], [xy, yy, 0.0], [0.0, 0.0, zz]])


def in_link(k: int) -> tuple[float, Array, Array]:
    """Return mass, centre and inertia of body B2 + k in the frame of link k of the limb."""
    letters = AXES[k]
    turn = np.stack([np.eye(3)["xyz".index(a.lower())] * (-1) ** a.isupper() for a in letters])
    centre = turn @ (np.array(MIDDLES[k]) - ORIGINS[k])
    return MASSES[k + 1], centre, turn @ tensor(INERTIAS[k + 1]) @ turn.T


def upper(inertia: Array) -> list[float]:
    """Return xx, yy, zz, xy, xz, yz of an inertia, shape (3, 3)."""
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    return (np.round(inertia[rows, columns], 4) + 0.0).tolist()


def base() -> tuple[float, Array, Array]:
    """Return mass, centre and inertia of B1 and B2, which joint 1 holds together."""
    parts = [(MASSES[0], np.array([-0.67945, 0.0, 0.0]), tensor(INERTIAS[0])), in_link(0)]
    mass = sum(part[0] for part in parts)
    middle = sum(m * centre for m, centre, _ in parts) / mass
    whole = np.zeros((3, 3))
    for m, centre, inertia in parts:
        away = centre - middle
        whole += inertia + m * (away @ away * np.eye(3) - np.outer(away, away))
    return mass, middle, whole


def dynamics() -> dict[str, Any]:
    """Return the masses, inertias and limits of an arm."""
    links = [in_link(k) for k in range(1, 7)]
    mass, middle, inertia = base()
    return {
        "base_mass": round(mass, 4),
        "base_centre": np.round(middle, 6).tolist(), "base_inertia": upper(inertia),
        "masses": [mass for mass, _, _ in links],
        "centres": [(np.round(centre, 6) + 0.0).tolist() for _, centre, _ in links],
        "inertias": [upper(inertia) for _, _, inertia in links],
        "torque_limits": [TORQUE] * 6, "speed_limits": [SPEED] * 6,
        "rotor_inertias": [ROTOR] * 6,
    }  # fmt: skip


def ssrms2() -> dict[str, Any]:
    """Return the robot of two SSRMS-type arms on a small body."""
    limb, tip = SsrmsLimb(held_angle=HELD_ANGLE), 0.18
    capsules = [
        {"link": c.link, "start": list(c.start), "end": list(c.end), "radius": c.radius}
        for c in limb.link_capsules[:-1]
    ]
    capsules += [
        {"link": "wrist_3", "start": [0, 0, -limb.d6], "end": [0, 0, -LATCH], "radius": tip},
        {"link": "gripper", "start": [0, 0, -LATCH], "end": [0, 0, -tip], "radius": tip},
    ]
    return {
        "name": "ssrms2",
        "limb": {"family": "ssrms", "held_angle": HELD_ANGLE},
        "mount_radius": 0.5 * BODY_EDGE,
        "tool_length": 0.0,
        "characteristic_length": round(0.87 * SCALE, 2),
        "grasp_separation": 1.0,
        "span": round(2.4 * SCALE, 1),
        "heights": [6.0, 8.0, 10.0, 12.0],
        "lift": 1.0,
        "capsules": capsules,
        "body_size": BODY_EDGE,
        "body_mass": BODY_MASS,
        "gripper_mass": 0.0,
        "dynamics": dynamics(),
        "source": "figures of the SSRMS by Nguyen and Hughes (1994), as in TraceableRobotModels; "
        "assumed: middles as mass centres, rotors, capsules 0.36 m thick, body; planning lengths: "
        "17.4 of the UR5e's",
    }  # fmt: skip


SOURCES = {
    "jem": "NASA's mesh of the JEM, measured",
    "truss": "NASA's dimensions of S0, S1 and P1",
    "uslab": "NASA's mesh of the US Lab, measured; handrail poses of Chunting/r2_planning (BSD)",
    "columbus": "ESA's dimensions; racks as measured in the JEM",
    "hatch": "as `columbus`; NASA's dimensions of Node 2",
    "station": "as `hatch` and `jem`; NASA's dimensions of Destiny",
}
"""Where the figures of each map come from, in short; its file has the whole."""


def places() -> str:
    """Return the table of the maps that ship."""
    rows = []
    for name in PLACES:
        place = as_map(name)
        size = " x ".join(f"{edge:.1f}" for edge in place.cabin[1] - place.cabin[0])
        data = read_json(ROOT / "envs_assets" / f"{name}.json", "map", MapError)
        rows.append(
            (f"`{name}`", len(place), size, len(place.boxes), data["description"], SOURCES[name])
        )
    return table("name | points | where the base may be [m] | boxes | what it is | source", rows)


FILES = {"truss": truss, "uslab": uslab, "ssrms2": ssrms2}
"""Files by name, and what makes them."""


if __name__ == "__main__":
    write_assets(FILES)
