"""Orthographic views of a map along one axis of the module, to scale."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR, map_axes, point_colours
from mlivr_gym.pictures.robot_shapes import GHOST_PALENESS, Part, outline, pale
from mlivr_gym.world.grasp_map import GraspMap

FROM_ABOVE, FROM_THE_SIDE = (0, 1), (0, 2)
"""Axes of the module that a view shows, to the right and upwards."""

View = tuple[int, int]

VIEW_NAMES = {FROM_ABOVE: "from above", FROM_THE_SIDE: "from the side"}
"""Titles of the views."""

VIEW_DIRECTIONS = {FROM_ABOVE: (0.0, 0.0, 1.0), FROM_THE_SIDE: (0.0, -1.0, 0.0)}
"""Direction of the viewer in each view."""

CROWDED = 0.25
"""Distance below which the numbers of two stances are written on different sides [m]."""


def map_views(grasp_map: GraspMap) -> tuple[Any, Any, dict[View, Any]]:
    """Return a figure of a map, its 3-D axes, and the axes of the two flat views below."""
    figure, axes = map_axes(grasp_map)
    figure.set_size_inches(12.8, 9.6)
    axes.set_position((-0.06, 0.22, 1.08, 0.82))
    flats = {}
    for edge, view in ((0.05, FROM_ABOVE), (0.54, FROM_THE_SIDE)):
        flat = flats[view] = figure.add_axes((edge, 0.06, 0.42, 0.22))
        flat.scatter(*grasp_map.positions[:, view].T, s=3, color=point_colours(grasp_map), zorder=1)
        flat.set_aspect("equal")
        flat.set_xlabel("xyz"[view[0]] + " [m]", fontsize=8)
        flat.set_ylabel("xyz"[view[1]] + " [m]", fontsize=8)
        flat.tick_params(labelsize=8)
        flat.spines[["top", "right"]].set_visible(False)
        flat.set_title(VIEW_NAMES[view], fontsize=9.5, loc="left", color="0.25")
    return figure, axes, flats


def draw_flat_path(axes: Any, view: View, line: Array, stances: Array) -> None:
    """Draw a base path, shape (k, 3), and numbered base positions of stances, shape (s, 3) [m]."""
    axes.plot(*line[:, view].T, color=BASE_COLOUR, linewidth=2.0, zorder=3)
    axes.scatter(*stances[:, view].T, color=BASE_COLOUR, marker="s", s=16, zorder=3)
    number_stances(axes, stances[:, view])


def draw_flat_goal(axes: Any, view: View, goal: Sequence[float], tolerance: float) -> None:
    """Draw the goal region."""
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    middle = np.array(goal)[list(view)]
    ring = middle[:, None] + tolerance * np.array([np.cos(angle), np.sin(angle)])
    axes.fill(*ring, facecolor=GOAL_COLOUR, alpha=0.25, linewidth=0.0, zorder=1.5)
    axes.plot(*ring, color=GOAL_COLOUR, linewidth=1.0, zorder=2)


def draw_flat_ghost(axes: Any, view: View, parts: Sequence[Part]) -> None:
    """Draw parts of a robot pale and behind everything else, the more distant ones first."""
    toward = np.array(VIEW_DIRECTIONS[view])
    for part in sorted(parts, key=lambda part: float(part.faces.mean(axis=(0, 1)) @ toward)):
        colour = pale(part.colour, GHOST_PALENESS)
        edge = outline(part.faces, np.eye(3)[list(view)])
        axes.fill(*edge.T, facecolor=colour, edgecolor=colour, linewidth=0.3, zorder=0.5)


def number_stances(axes: Any, positions: Array) -> None:
    """Write the numbers of stances above their base positions, shape (k, 2 or 3) [m].

    Of two consecutive stances that are close to each other, the lower one has its number below.
    """
    above = [True] * len(positions)
    for k, (before, position) in enumerate(pairwise(positions), 1):
        if float(np.linalg.norm(position - before)) < CROWDED:
            above[k - 1 if position[-1] > before[-1] else k] = False
    for k, position in enumerate(positions):
        shift = np.zeros(len(position))
        shift[-1] = 0.07 if above[k] else -0.07
        side = "bottom" if above[k] else "top"
        axes.text(*(position + shift), str(k), fontsize=8, ha="center", va=side, zorder=8)
