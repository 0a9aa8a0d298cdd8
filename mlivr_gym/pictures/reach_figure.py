"""Figure of the points that can be grasped from a start, by the number of steps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.pictures.figures import new_figure, save_figure
from mlivr_gym.planners.reach import NOT_REACHED, Reach
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.world.grasp_map import GraspMap

WIDTH, MARGIN, GAP, HEAD, FOOT = 12.8, 0.75, 0.8, 1.05, 0.65
"""Width of the figure, margins, gap between rows of panels, heights of heading and legend [inch].
"""

WIDE = 15.0
"""Width of a map from which on there is one panel in a row [m]."""

MOST_COLOURS = 12
"""Maximum number of steps that have colours of their own."""

COLOURS = "viridis_r"
"""Colours of points by steps."""


@checked({**ARGUMENTS, "reach": InstanceOf(Reach)})
def reach_figure(grasp_map: GraspMap, reach: Reach, path: str | Path, title: str = "") -> None:
    """Draw every point of a map in a colour for the fewest steps after which it is grasped.

    Points whose normals have the same main direction are drawn in one panel, seen along it. All
    panels have the same scale. Points out of reach are crosses, those held at the start have rings.
    `reach` is the result of `reach_from`; `path` is that of the PNG file, beside which an SVG of
    the same name is written. Raises a `FileError` if a file cannot be written.
    """
    panels = panels_of(grasp_map)
    low, high = grasp_map.positions.min(axis=0) - 0.2, grasp_map.positions.max(axis=0) + 0.2
    widest = max(high[view[0]] - low[view[0]] for view, _ in panels.values())
    columns = 2 if widest < WIDE else 1
    scale = ((WIDTH - MARGIN) / columns - MARGIN) / widest
    tallest = scale * max(high[view[1]] - low[view[1]] for view, _ in panels.values())
    rows = -(-len(panels) // columns)
    total = HEAD + rows * (tallest + GAP) + FOOT
    figure = new_figure(WIDTH, total)
    most = int(reach.steps.max())
    for k, (name, (view, points)) in enumerate(panels.items()):
        width, height = (scale * (high[axis] - low[axis]) for axis in view)
        x = MARGIN + k % columns * (WIDTH - MARGIN) / columns
        y = total - HEAD - k // columns * (tallest + GAP) - height
        place = x / WIDTH, y / total, width / WIDTH, height / total
        axes = figure.add_axes(place)
        _draw_panel(axes, grasp_map, reach, points, view)
        axes.set(
            xlim=(low[view[0]], high[view[0]]),
            ylim=(low[view[1]], high[view[1]]),
            xlabel="xyz"[view[0]] + " [m]",
            ylabel="xyz"[view[1]] + " [m]",
        )
        axes.set_title(name, fontsize=9.5, loc="left", color="0.25")
    _legend(figure, most, len(reach.start), total)
    reached = int((reach.steps != NOT_REACHED).sum())
    others = "the others are out of reach" if reach.is_complete else "the others were not reached"
    rest = f"; {others}" if reached < len(grasp_map) else ""
    remark = (
        f"from {' '.join(reach.start)} the robot can grasp {reached} of {len(grasp_map)} points, "
        f"the last of them after {most} steps{rest}"
    )
    for text, size, below in ((title or "Reach", 13, 0.35), (remark, 9.5, 0.6)):
        style: dict[str, Any] = {"fontsize": size, "parse_math": False}
        figure.text(0.02, 1.0 - below / total, text, **style)
    save_figure(figure, path)


def panels_of(grasp_map: GraspMap) -> dict[str, tuple[tuple[int, int], IntArray]]:
    """Return the axes to the right and upwards, and the points, of each panel by its title."""
    normals = grasp_map.normals
    axis = np.abs(normals).argmax(axis=1)
    sign = np.sign(normals[np.arange(len(axis)), axis]).astype(int)
    extent = np.ptp(grasp_map.positions, axis=0)
    panels = {}
    for main, side in ((2, 1), (2, -1), (1, -1), (1, 1), (0, 1), (0, -1)):
        points = np.flatnonzero((axis == main) & (sign == side))
        if len(points):
            right, up = sorted(set(range(3)) - {main}, key=lambda k: (-extent[k], k))
            faces = sorted({grasp_map.faces[p] for p in points})
            named = ", ".join(faces[:3]) + (", ..." if len(faces) > 3 else "")
            title = f"{named}: normals towards {'+' if side > 0 else '-'}{'xyz'[main]}"
            panels[title] = (right, up), points
    return panels


def _draw_panel(
    axes: Any, grasp_map: GraspMap, reach: Reach, points: IntArray, view: tuple[int, int]
) -> None:
    """Draw some points in one view."""
    from matplotlib import colormaps

    flat: Array = grasp_map.positions[points][:, view]
    steps = reach.steps[points]
    found = steps != NOT_REACHED
    colours = colormaps[COLOURS](np.minimum(steps[found] / max(1, reach.steps.max()), 1.0))
    axes.scatter(*flat[found].T, s=20, color=colours, linewidths=0.0, zorder=2)
    axes.scatter(*flat[~found].T, s=24, marker="x", color="#d00000", linewidths=1.0, zorder=3)
    for limb, name in enumerate(reach.start):
        here = np.flatnonzero(points == grasp_map.index(name))
        if len(here):
            ring = {"facecolor": "none", "edgecolor": LIMB_COLOURS[limb], "linewidth": 1.6}
            axes.scatter(*flat[here[0]], s=110, zorder=4, **ring)
    axes.set_aspect("equal")
    axes.grid(color="0.93", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _legend(figure: Any, most: int, limbs: int, total: float) -> None:
    """Draw the colour of each number of steps at the foot of the figure."""
    from matplotlib import colormaps
    from matplotlib.lines import Line2D

    shown = np.unique(np.linspace(0, most, min(most + 1, MOST_COLOURS)).round().astype(int))
    dot: dict[str, Any] = {"marker": "o", "linestyle": "none", "markersize": 6}
    handles = [
        Line2D([], [], color=colormaps[COLOURS](k / max(1, most)), label=str(k), **dot)
        for k in shown.tolist()
    ]
    ring: dict[str, Any] = {
        **dot,
        "markersize": 10,
        "markerfacecolor": "none",
        "markeredgewidth": 1.6,
    }
    handles += [
        Line2D([], [], label=f"limb {limb} at the start", color=LIMB_COLOURS[limb], **ring)
        for limb in range(limbs)
    ]
    cross: dict[str, Any] = {**dot, "marker": "x", "color": "#d00000"}
    handles.append(Line2D([], [], label="not reached", **cross))
    figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0.02, 0.1 / total),
        ncols=len(handles),
        title="fewest steps after which a limb holds the point",
        alignment="left",
        fontsize=9,
        title_fontsize=9,
        frameon=False,
        handletextpad=0.2,
    )
