"""Make the modules of the station that ship beside the JEM, and the places joined of them.

    python experiments/station_modules.py

It writes `columbus.json`, `lab.json`, `node.json`, `hatch.json` and `station.json` into
`envs_assets/` from the published figures below; `sources` and `provenance` of each file say which
figure comes from where, and what is assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from reports import plain, write_assets

from mlivr_gym.arrays import Array

PITCH, POSTS, TRACK = 1.072, 1.0168, 1.7526
"""Distance of racks along a module, of the two seat tracks of a rack, and length of a track [m], as
measured in the JEM (`jem.json`), whose racks are International Standard Payload Racks too."""

HALF, PLATE = 1.07, 0.04
"""Distance of the seat tracks from the axis of a module, as in the JEM, and thickness of walls
[m]."""

TRACK_HEIGHT = 0.013
"""Height of a seat track above the front of its rack [m], as measured in the JEM."""

OPENING = 0.6325
"""Half the edge of the opening of a hatch [m], as measured in the JEM."""

VESTIBULE = 0.4
"""Length of the vestibule between two hatches [m]: 16 inches, of which each module has half."""

ALCOVE = 0.9
"""Half the width of the alcove between the cabin of a node and a side hatch [m]: assumed."""

RAIL = 0.03
"""Distance of the rails in a passage from its walls [m]: assumed."""

HANDRAIL, BESIDE, JEM_HANDRAILS = 1.0541, 0.1, (0.536, 0.805, 0.634)
"""Length of a handrail of 41.5 inches, and its distance from the edge of a hatch, assumed; of those
in the JEM the length, and the distance from bulkhead and axis, as measured there [m]."""

RACKS = (
    "International Standard Payload Rack: 2 m high, 1.05 m wide (NASA); seat tracks as measured in "
    "the JEM, jem.json"
)
HATCH = (
    "opening as measured in the JEM, jem.json (the hatch itself is 53 inches square, "
    "collectspace.com); vestibule of the Common Berthing Mechanism 16 inches"
)
ASSUMED = {
    "cabin": "assumed: square cross-section as in the JEM",
    "points": "seat tracks on both posts of each rack, in the middle of the module, every 0.2 m; "
    "assumed: that all racks are there and their tracks free",
    "boxes": "assumed: fronts of the racks as four plane walls as long as the module, bulkheads at "
    "its ends; cones, corner plates and equipment are left out",
    "passages": "assumed: square passages with a rail along the middle of each wall, 0.03 m above "
    "it; published is only that handrails flank the hatches",
}

FACES: dict[str, tuple[Sequence[int], Sequence[int]]] = {
    "deck": ((0, 0, 1), (0, 1, 0)),
    "overhead": ((0, 0, -1), (0, 1, 0)),
    "forward": ((0, 1, 0), (0, 0, 1)),
    "aft": ((0, -1, 0), (0, 0, 1)),
}
"""Inward normal of each face, and the direction of its seat tracks."""


def corners(first: Array, second: Array) -> dict[str, list[float]]:
    """Return the lower and the upper corner of the box between two points."""
    return {"min": plain(np.minimum(first, second)), "max": plain(np.maximum(first, second))}


def tracks(racks: int, middle: float) -> list[dict[str, Any]]:
    """Return the seat tracks of the racks of all faces, the row of racks centred at `middle`."""
    found = []
    for face, (normal, along) in FACES.items():
        out, line = np.array(normal, float), np.array(along, float)
        for rack in range(racks):
            for side, letter in ((-1, "a"), (1, "b")):
                x = middle + (rack - 0.5 * (racks - 1)) * PITCH + side * 0.5 * POSTS
                place = np.array([x, 0.0, 0.0]) - HALF * out
                ends = place - 0.5 * TRACK * line, place + 0.5 * TRACK * line
                found.append(
                    {
                        "id": f"{face[0].upper()}{rack + 1}{letter}", "face": face,
                        "start": plain(ends[0]), "end": plain(ends[1]), "normal": plain(out),
                    }
                )  # fmt: skip
    return found


def frame(axis: Array) -> tuple[Array, Array]:
    """Return two axes at right angles to a given one."""
    second = np.roll(np.abs(axis), 1)
    return second, np.cross(axis, second)


def plate_with_opening(name: str, middle: Array, axis: Array, half: Array) -> list[dict[str, Any]]:
    """Return a plate of half edges `half` across an axis, around an opening in its middle."""
    out = []
    for k, (u, v) in enumerate((frame(axis), frame(axis)[::-1])):
        # The first two pieces reach over the whole plate, the others between them.
        across = half[1 - k] if k == 0 else OPENING
        for sign in (-1, 1):
            inner = middle + sign * OPENING * u - across * v - 0.5 * PLATE * axis
            outer = middle + sign * half[k] * u + across * v + 0.5 * PLATE * axis
            out.append({"id": f"{name}/plate{k}{'-+'[sign > 0]}", "kind": "bulkhead",
                        **corners(inner, outer)})  # fmt: skip
    return out


def passage(
    name: str, start: Array, axis: Array, length: float, half: float = OPENING
) -> tuple[list[Any], list[Any]]:
    """Return the walls and rails of a square passage along an axis, `half` from axis to wall."""
    walls, rails = [], []
    end = start + length * axis
    for k, (u, v) in enumerate((frame(axis), frame(axis)[::-1])):
        for sign in (-1, 1):
            label = f"{name}/{k}{'-+'[sign > 0]}"
            inner, outer = sign * half * u, sign * (half + PLATE) * u
            wall = corners(start + inner - half * v, end + outer + half * v)
            face = {-1: "deck", 1: "overhead"}.get(round(float((sign * u)[2])), "")
            walls.append({"id": f"{label}/wall", "face": face, **wall})
            rail = inner - sign * RAIL * u
            rails.append(
                {
                    "id": label, "face": name, "start": plain(start + rail),
                    "end": plain(end + rail), "normal": plain(-sign * u),
                }
            )  # fmt: skip
    return walls, rails


def module(
    name: str, description: str, length: float, racks: int, *, middle: float = 0.0,
    ends: Sequence[int] = (-1,), sides: Sequence[str] = (), at: float = 0.0, radius: float = 0.0,
    sources: dict[str, str],
) -> dict[str, Any]:  # fmt: skip
    """Return the map of a cylindrical module.

    It has hatches at some of its `ends`, -1 and 1, whose length includes half a vestibule, and on
    the faces `sides`. The latter are `at` on the axis and `radius` from it [m], half a vestibule
    inside the outer planes. The row of racks on each face is centred at `middle` on the axis [m].
    """
    x, boxes, rails = np.array([1.0, 0.0, 0.0]), [], tracks(racks, middle)
    inner = 0.5 * length - 0.5 * VESTIBULE
    wall = HALF + TRACK_HEIGHT
    for face, (normal, along) in FACES.items():
        out, line = np.array(normal, float), np.array(along, float)
        stretches = [(-inner, inner)]
        if face in sides:
            stretches = [(-inner, at - ALCOVE), (at + ALCOVE, inner)]
            place, hatch_place = at * x - wall * out, at * x - radius * out
            for sign in (-1, 1):
                first = place + sign * ALCOVE * line - ALCOVE * x
                beside = corners(first, place + sign * wall * line + ALCOVE * x - PLATE * out)
                boxes.append({"id": f"{face}/beside{'-+'[sign > 0]}", "face": face, **beside})
            depth, half = radius - wall, np.full(2, ALCOVE + PLATE)
            boxes += plate_with_opening(face, hatch_place - 0.5 * PLATE * out, -out, half)
            for label, start, deep, width in (
                (face, place, depth, ALCOVE),
                (f"{face} hatch", hatch_place, 0.5 * VESTIBULE, OPENING),
            ):
                walls, more = passage(label, start, -out, deep, width)
                boxes, rails = boxes + walls, rails + more
        for k, (low, high) in enumerate(stretches):
            boxes.append({"id": f"{face}/wall{k}", "face": face, "kind": "panel",
                          **corners(low * x - wall * (out + line),
                                    high * x - (wall + PLATE) * out + wall * line)})  # fmt: skip
    for end in (-1, 1):
        label, axis = ("aft end", "fore end")[end > 0], end * x
        place = (inner + 0.5 * PLATE) * axis
        if end in ends:
            boxes += plate_with_opening(label, place, axis, np.array([wall, wall]))
            walls, more = passage(label, inner * axis, axis, 0.5 * VESTIBULE)
            boxes, rails = boxes + walls, rails + more
        else:
            half = np.array([0.5 * PLATE, wall, wall])
            boxes.append({"id": label, "kind": "bulkhead", **corners(place - half, place + half)})
    return {
        "name": name,
        "description": description,
        "frame": "origin in the middle of the module, x along its axis, y aft, z overhead; metres",
        "sources": sources | {"racks": RACKS, "hatches": HATCH},
        "provenance": ASSUMED,
        "segments": rails,
        "spacing": 0.2,
        "cabin": {"min": [-inner, -HALF, -HALF], "max": [inner, HALF, HALF]},
        "boxes": boxes,
    }


LENGTHS = {"columbus": 6.871, "lab": 8.5, "node": 7.2}
"""Published lengths of Columbus (ESA), Destiny and Node 2 (NASA) [m]."""

NODE_RADIUS = 2.24
"""Half the published diameter of Node 2, 4.48 m."""

PORTS, NODE_RACKS = 1.6, -1.3
"""Where the side hatches and the middle of the racks of a node are on its axis [m]: assumed."""


def columbus() -> dict[str, Any]:
    """Return the map of a module like Columbus."""
    return module(
        "columbus",
        "A module like Columbus, with seat tracks on the posts of its sixteen racks.",
        LENGTHS["columbus"], 4, ends=(-1,),
        sources={"module": "ESA, European Columbus laboratory: total length 6871 mm, largest "
                 "diameter 4477 mm; DLR and ESA: sixteen racks, four on each of four sides"},
    )  # fmt: skip


def lab() -> dict[str, Any]:
    """Return the map of a module like Destiny."""
    return module(
        "lab", "A module like Destiny with seat tracks on the posts of its racks, and two hatches.",
        LENGTHS["lab"], 6, ends=(-1, 1),
        sources={"module": "NASA, Destiny: 8.5 m long, 4.3 m wide, 24 racks, six on each side"},
    )  # fmt: skip


def node() -> dict[str, Any]:
    """Return the map of a node with a hatch at each end and on two sides."""
    return module(
        "node", "A module like Node 2, with eight racks, hatches at both ends and on two sides.",
        LENGTHS["node"], 2, middle=NODE_RACKS, ends=(-1, 1), sides=("forward", "aft"), at=PORTS,
        radius=NODE_RADIUS,
        sources={"module": "NASA, Node 2 (Harmony): 7.2 m long, 4.48 m in diameter, eight racks"},
    )  # fmt: skip


def on_side(x: float, sign: int, length: float) -> dict[str, Any]:
    """Return where a module is placed at a side hatch of a node whose middle is at `x`."""
    reach = NODE_RADIUS + 0.5 * VESTIBULE + 0.5 * length
    return {
        "translation": plain(np.array([x + PORTS, sign * reach, 0.0])),
        "rotation": [[0.0, -float(sign), 0.0], [float(sign), 0.0, 0.0], [0.0, 0.0, 1.0]],
    }


def jem_on_side(x: float, sign: int) -> dict[str, Any]:
    """Return where the JEM, whose origin is in its hatch, is placed at a side hatch."""
    placed = on_side(x, sign, 0.0)
    placed["translation"][1] += 0.5 * sign * VESTIBULE
    return placed


JOINED = {
    "parts": "modules at the published distances of their hatches",
    "frame": "assumed: the order of the modules",
    "handrails": "in the JEM as measured on the mesh of jem.json; elsewhere published is only that "
    "they flank the hatches, and assumed are two of the standard length of 41.5 inches, upright on "
    "the wall around the opening, 0.1 m from its edge",
}


def flanking(
    inside: str, outside: str, middle: Array, out: Array, half: float = OPENING,
    up: Sequence[float] = (0.0, 0.0, 1.0),
) -> list[dict[str, Any]]:  # fmt: skip
    """Return the two handrails beside a hatch in the module `inside`, which `out` leads out of.

    They lie along `up`. The opening, of half width `half`, has its middle in the plane of the wall.
    """
    up, line, found = np.array(up), np.abs(np.cross(out, up)), []
    for sign in (-1, 1):
        long, deep, away, normal = HANDRAIL, RAIL, half + BESIDE, -out
        if inside.startswith("jem"):
            (long, deep, away), normal = JEM_HANDRAILS, -sign * line
        place, name = middle + sign * away * line - deep * out, f"{inside}/handrail {outside}"
        ends = {"start": plain(place - 0.5 * long * up), "end": plain(place + 0.5 * long * up)}
        name += "-+"[sign > 0]
        found.append({"id": name, "face": "handrails", **ends, "normal": plain(normal)})
    return found


def at_side(node: str, other: str, x: float, sign: int) -> list[dict[str, Any]]:
    """Return the handrails at a side hatch of a node whose middle is at `x`."""
    middle, out = (x + PORTS) * np.eye(3)[0], sign * np.eye(3)[1]
    found = flanking(node, other, middle + (HALF + TRACK_HEIGHT) * out, out, ALCOVE)
    return found + flanking(other, node, middle + (NODE_RADIUS + VESTIBULE) * out, -out)


def at_ends(before: str, after: str, x: float) -> list[dict[str, Any]]:
    """Return the handrails at the hatch between two modules in the row, whose ends meet at `x`."""
    axis = np.eye(3)[0]
    found = flanking(before, after, (x - 0.5 * VESTIBULE) * axis, axis)
    return found + flanking(after, before, (x + 0.5 * VESTIBULE) * axis, -axis)


def cover(name: str, middle: Array, axis: Array) -> dict[str, Any]:
    """Return a closed hatch."""
    u, v = frame(axis)
    half = OPENING * (np.abs(u) + np.abs(v)) + 0.5 * PLATE * np.abs(axis)
    return {"id": name, "kind": "bulkhead", **corners(middle - half, middle + half)}


def closed(x: float, ends: Sequence[int], sides: Sequence[int], name: str) -> list[dict[str, Any]]:
    """Return the closed hatches of a node whose middle is at `x`."""
    axis, side = np.eye(3)[:2]
    reach = NODE_RADIUS + 0.5 * VESTIBULE
    return [
        *(cover(f"{name} end {'-+'[e > 0]}", (x + 0.5 * e * LENGTHS["node"]) * axis, axis)
          for e in ends),
        *(cover(f"{name} side {'-+'[s > 0]}", (x + PORTS) * axis + s * reach * side, side)
          for s in sides),
    ]  # fmt: skip


def hatch() -> dict[str, Any]:
    """Return the map of Columbus at a side hatch of a node."""
    return {
        "name": "hatch",
        "description": "A node and a module like Columbus, with a hatch between.",
        "frame": "that of the node; metres",
        "sources": {"parts": "node.json and columbus.json"},
        "provenance": JOINED,
        "parts": [
            {"id": "node", "map": "node.json"},
            {"id": "columbus", "map": "columbus.json", **on_side(0.0, 1, LENGTHS["columbus"])},
        ],
        "segments": at_side("node", "columbus", 0.0, 1),
        "boxes": closed(0.0, (-1, 1), (-1,), "node"),
    }


def station() -> dict[str, Any]:
    """Return the map of three nodes, two labs between them, and five modules on their sides."""
    apart = LENGTHS["node"] + LENGTHS["lab"]
    parts, boxes, rails = [], [], []
    sides = {"node1": ("columbus1", "columbus2"), "node2": ("jem1", "columbus3"),
             "node3": ("jem2", None)}  # fmt: skip
    for k, (name, modules) in enumerate(sides.items()):
        x, free = k * apart, []
        parts.append({"id": name, "map": "node.json", "translation": plain(np.array([x, 0, 0]))})
        if k < 2:
            place, between = plain(np.array([x + 0.5 * apart, 0.0, 0.0])), f"lab{k + 1}"
            parts.append({"id": between, "map": "lab.json", "translation": place})
            rails += at_ends(name, between, x + 0.5 * LENGTHS["node"])
            rails += at_ends(between, f"node{k + 2}", x + apart - 0.5 * LENGTHS["node"])
        for sign, given in zip((-1, 1), modules, strict=True):
            if given is None:
                free.append(sign)
                continue
            rails += at_side(name, given, x, sign)
            if given.startswith("jem"):
                parts.append({"id": given, "map": "jem", **jem_on_side(x, sign)})
            else:
                where = on_side(x, sign, LENGTHS["columbus"])
                parts.append({"id": given, "map": "columbus.json", **where})
        boxes += closed(x, [e for e in (-1, 1) if k + e not in range(3)], free, name)
    return {
        "name": "station",
        "description": "Ten modules: three nodes in a row, two labs between them, and on their "
        "sides three modules like Columbus and two JEM.",
        "frame": "that of the first node, x along the row; metres",
        "sources": {"parts": "node.json, lab.json, columbus.json and jem.json"},
        "provenance": JOINED,
        "parts": parts,
        "segments": rails,
        "boxes": boxes,
    }


FILES = {"columbus": columbus, "lab": lab, "node": node, "hatch": hatch, "station": station}
"""Files by name, and what makes them."""


if __name__ == "__main__":
    write_assets(FILES)
