"""Things in the module that a robot's map lacks: boxes in the cabin, and plates over points."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.schema import Integer
from mlivr_gym.stances import TRIES, StanceGraph, State
from mlivr_gym.world import Box

BOXES, PLATES = 5, 10
"""Number of unknown boxes, and of points covered by unknown plates."""

HALF_SIZES = 0.08, 0.25
"""Smallest and largest half of an edge of a box [m]."""

PLATE_HALF_SIZES = 0.02, 0.06
"""Half thickness of a plate, and half of its edges [m]."""


@checked({"boxes": Integer(0, 1000), "plates": Integer(0, 1000)})
def unknown_things(
    graph: StanceGraph,
    start: State,
    rng: np.random.Generator,
    boxes: int = BOXES,
    plates: int = PLATES,
) -> tuple[Box, ...]:
    """Return random boxes and plates that touch the robot at the start on none of its branches.

    Each box lies anywhere among the points, each plate on a point of its own that the robot does
    not hold. The graph is left as it was. Raises a `SettingError` if there are fewer points than
    plates, and a `StanceError` if not so many things find a place.
    """
    graph.check(start)
    grasp_map, found = graph.grasp_map, list[Box]()
    low, high = grasp_map.positions.min(axis=0), grasp_map.positions.max(axis=0)
    points = rng.permutation([k for k in range(len(grasp_map)) if k not in start.stance]).tolist()
    if plates > len(points):
        raise SettingError(f"plates is {plates}; it must be at most {len(points)}, the free points")
    for _ in range(TRIES):
        if len(found) == boxes + plates:
            return tuple(found)
        if len(found) < boxes:
            half = rng.uniform(*HALF_SIZES, 3)
            middle = rng.uniform(low + half, high - half)
        elif not points:
            break
        else:
            point, (thin, wide) = points.pop(), PLATE_HALF_SIZES
            normal = grasp_map.normals[point]
            half = wide - (wide - thin) * np.abs(normal)
            middle = grasp_map.positions[point] + thin * normal
        corners = (middle - half).tolist(), (middle + half).tolist()
        box = Box.between(f"thing{len(found)}", "obstacle", *corners)
        if _is_clear_of(graph, start, box):
            found.append(box)
    raise StanceError(
        f"only {len(found)} of {boxes} boxes and {plates} plates found a place on map "
        f"{grasp_map.name!r}, clear of the robot at the start"
    )


def _is_clear_of(graph: StanceGraph, start: State, box: Box) -> bool:
    """Return whether a box leaves a robot all branches of its start."""
    graph.add_obstacles([box])
    try:
        return graph.state(start.stance) == start
    except StanceError:
        return False
    finally:
        graph.remove_obstacles([box.id])
