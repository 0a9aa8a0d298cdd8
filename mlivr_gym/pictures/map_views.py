"""Views of a map, to scale: in space, from above and from the side.

Each method of `MapViews` draws an element in all three.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR, new_figure, point_colours
from mlivr_gym.pictures.robot_shapes import Part, outline, shaded_faces
from mlivr_gym.values import Triple
from mlivr_gym.world.grasp_map import GraspMap

View = tuple[int, ...]
"""Axes of the module that a view shows; a flat one shows one to the right and one upwards."""

IN_SPACE, FROM_ABOVE, FROM_THE_SIDE = (0, 1, 2), (0, 1), (0, 2)

VIEW_NAMES: dict[View, str] = {FROM_ABOVE: "from above", FROM_THE_SIDE: "from the side"}
"""Titles of the flat views."""

VIEW_DIRECTIONS: dict[View, Triple] = {FROM_ABOVE: (0.0, 0.0, 1.0), FROM_THE_SIDE: (0.0, -1.0, 0.0)}
"""Direction of the viewer in each flat view."""

EDGE_COLOUR = "0.6"
"""Colour of the outlines of shapes in flat views, since the body is nearly white."""

FLAT_SCALE = 0.6
"""Size of markers and lines in flat views, relative to those in space."""

CROWDED = 0.25
"""Distance below which the numbers of two stances are written on different sides [m]."""


class MapViews:
    """A `figure` of a map with one axes for each of its `views`."""

    def __init__(self, grasp_map: GraspMap) -> None:
        """Draw tracks as thin lines, and points as dots."""
        self.figure = new_figure(12.8, 9.6)
        self.views: dict[View, Any] = {IN_SPACE: _space(self.figure, grasp_map.positions)}
        for edge, view in ((0.05, FROM_ABOVE), (0.54, FROM_THE_SIDE)):
            self.views[view] = flat_axes(self.figure, (edge, 0.06, 0.42, 0.22), view)
        for segment in grasp_map.segments:
            ends = np.array([segment.start, segment.end])
            self.line(ends, color="0.82", linewidth=1.2, zorder=1)
        colours = point_colours(grasp_map)
        self.dots(grasp_map.positions, s=4, color=colours, label="graspable points", zorder=2)

    def line(self, positions: Array, *, linewidth: float, **style: Any) -> None:
        """Draw a polyline, shape (k, 3) [m]."""
        for view, axes in self.views.items():
            width = linewidth * (1.0 if view == IN_SPACE else FLAT_SCALE)
            axes.plot(*positions[:, view].T, linewidth=width, **style)

    def dots(self, positions: Array, *, s: float, **style: Any) -> None:
        """Draw markers of a size `s` [pt^2] at positions, shape (k, 3) [m]."""
        for view, axes in self.views.items():
            more: dict[str, Any] = {"depthshade": False, "s": s}
            axes.scatter(
                *positions[:, view].T,
                **style | (more if view == IN_SPACE else {"s": FLAT_SCALE * s}),
            )

    def solids(self, parts: Sequence[Part], zorder: float, alpha: float = 1.0) -> None:
        """Draw convex shapes, shaded in space; in flat views the more distant ones first."""
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        for view, axes in self.views.items():
            if view != IN_SPACE:
                fill_parts(axes, view, parts, zorder=zorder, alpha=alpha)
            elif parts:
                faces, colours = zip(*map(shaded_faces, parts), strict=True)
                style = {"facecolors": np.concatenate(colours), "linewidths": 0.3, "alpha": alpha}
                if alpha == 1.0:
                    style["edgecolors"] = style["facecolors"]
                axes.add_collection3d(
                    Poly3DCollection(np.concatenate(faces), zorder=zorder, **style)
                )

    def base_path(self, path: Array, stances: Array, label: str) -> None:
        """Draw a base path, shape (k, 3), and numbered bases of stances, shape (s, 3) [m]."""
        self.line(path, color=BASE_COLOUR, linewidth=3.0, zorder=5, label=label)
        self.dots(stances, color=BASE_COLOUR, marker="s", s=30, zorder=5)
        for view, axes in self.views.items():
            _number(axes, stances[:, view])

    def goal(self, goal: Sequence[float], tolerance: float) -> None:
        """Draw a goal position [m] as a star, and the goal region as a ball."""
        position = np.array(goal)
        style = {"color": GOAL_COLOUR, "edgecolor": "black", "zorder": 7}
        self.dots(position[None], s=150, marker="*", label="goal", **style)
        angle, rise = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 17), np.linspace(0.0, np.pi, 9))
        ball = np.stack([np.cos(angle) * np.sin(rise), np.sin(angle) * np.sin(rise), np.cos(rise)])
        ball = position[:, None, None] + tolerance * ball
        wires = {"color": GOAL_COLOUR, "linewidth": 0.4, "alpha": 0.7, "zorder": 4}
        self.views[IN_SPACE].plot_wireframe(*ball, **wires)
        turn = np.linspace(0.0, 2.0 * np.pi, 61)
        for view in (FROM_ABOVE, FROM_THE_SIDE):
            ring = position[list(view), None] + tolerance * np.array([np.cos(turn), np.sin(turn)])
            self.views[view].fill(*ring, facecolor=GOAL_COLOUR, alpha=0.25, zorder=1.5)
            self.views[view].plot(*ring, color=GOAL_COLOUR, linewidth=1.0, zorder=2)

    def head(self, title: str, remark: str = "") -> None:
        """Write a heading with a remark below it, and a legend to its right."""
        self.figure.suptitle(title, x=0.02, y=0.975, ha="left", fontsize=13, parse_math=False)
        self.figure.text(0.02, 0.91, remark, fontsize=9.5, color="0.25")
        legend = self.figure.legend(
            *self.views[IN_SPACE].get_legend_handles_labels(), loc="upper right",
            bbox_to_anchor=(0.985, 0.985), ncols=2, fontsize=8.5, frameon=False,
        )  # fmt: skip
        for handle in legend.legend_handles:
            handle.set_alpha(1.0)


def _space(figure: Any, positions: Array) -> Any:
    """Add 3-D axes, to scale, in which positions (k, 3) [m] are seen."""
    axes = figure.add_axes((-0.06, 0.22, 1.08, 0.82), projection="3d", computed_zorder=False)
    low, high = positions.min(axis=0), positions.max(axis=0)
    span = np.maximum(high - low, 0.3)
    axes.set_box_aspect(span.copy(), zoom=1.3)  # the array is changed in place
    for name, a, b in zip("xyz", low, low + span, strict=True):
        getattr(axes, f"set_{name}lim")(a - 0.05, b + 0.05)
    axes.set_xlabel("x [m] (Node 2 to airlock)", labelpad=18)
    axes.set_ylabel("y [m]", labelpad=2)
    axes.set_zlabel("z [m]", labelpad=-2)
    axes.set(yticks=(-1, 0, 1), zticks=(-1, 0, 1))
    axes.tick_params(labelsize=8)
    axes.view_init(elev=18, azim=-72)
    return axes


def flat_axes(figure: Any, place: tuple[float, float, float, float], view: View) -> Any:
    """Add axes of a flat view at a place, left, bottom, width and height, of a figure."""
    axes = figure.add_axes(place, aspect="equal")
    axes.set_xlabel("xyz"[view[0]] + " [m]", fontsize=8)
    axes.set_ylabel("xyz"[view[1]] + " [m]", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(VIEW_NAMES[view], fontsize=9.5, loc="left", color="0.25")
    return axes


def fill_parts(axes: Any, view: View, parts: Sequence[Part], **style: Any) -> None:
    """Draw the outlines of convex shapes in a flat view, the more distant ones first."""
    toward: Array = np.array(VIEW_DIRECTIONS[view])
    for part in sorted(parts, key=lambda part: float(part.corners.mean(axis=0) @ toward)):
        edge = outline(part.corners, np.eye(3)[list(view)])
        colours = {"facecolor": part.colour, "edgecolor": EDGE_COLOUR, "linewidth": 0.3}
        axes.fill(*edge.T, **colours | style)


def _number(axes: Any, positions: Array) -> None:
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
