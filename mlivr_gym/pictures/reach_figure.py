"""Figure of the points that can be grasped from a start, by the number of steps."""

from __future__ import annotations

from collections.abc import Iterator
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

WIDTH, HEAD, FOOT = 12.8, 1.05, 0.75
"""Width of the figure, heights of heading and legend [inch]."""

WIDE = 15.0
"""Width of a map from which on there is one panel in a row [m]."""

MOST_COLOURS = 12
"""Maximum number of steps that the legend names."""

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
    figure, panels = map_panels(grasp_map)
    for axes, points, flat in panels:
        _draw_panel(axes, reach, [grasp_map.ids[p] for p in points], flat, reach.steps[points])
    figure.legend(
        *axes.get_legend_handles_labels(), loc="lower left", ncols=MOST_COLOURS + 2, frameon=False,
        title="fewest steps after which a limb holds the point", alignment="left", fontsize=9,
        title_fontsize=9, handletextpad=0.2,
    )  # fmt: skip
    reached = int((reach.steps != NOT_REACHED).sum())
    others = "the others are out of reach" if reach.is_complete else "the others were not reached"
    rest = f"; {others}" if reached < len(grasp_map) else ""
    remark = (
        f"from {' '.join(reach.start)} the robot can grasp {reached} of {len(grasp_map)} points, "
        f"the last of them after {reach.steps.max()} steps{rest}"
    )
    for text, size, below in ((title or "Reach", 13, 0.35), (remark, 9.5, 0.6)):
        style: dict[str, Any] = {"fontsize": size, "parse_math": False}
        figure.text(0.02, 1.0 - below / figure.get_figheight(), text, **style)
    save_figure(figure, path)


def map_panels(grasp_map: GraspMap) -> tuple[Any, list[tuple[Any, IntArray, Array]]]:
    """Return a figure of a map, and axes, points and their places, shape (k, 2) [m], of its panels.

    A panel has the points whose normals have the same main direction, seen along it.
    """
    low, high = grasp_map.positions.min(axis=0) - 0.2, grasp_map.positions.max(axis=0) + 0.2
    panels = list(_panels(grasp_map))
    half = 0.5 * np.max([high[list(view)] - low[list(view)] for _, view, _ in panels], axis=0)
    columns = 2 if 2.0 * half[0] < WIDE else 1
    rows = -(-len(panels) // columns)
    total = HEAD + FOOT + rows * (0.95 + half[1] / half[0] * (WIDTH / columns - 1.2))
    figure, drawn = new_figure(WIDTH, total), []
    for k, (title, view, points) in enumerate(panels, 1):
        axes = figure.add_subplot(rows, columns, k, aspect="equal")
        middle = 0.5 * (low + high)[list(view)]
        axes.set(
            xlim=(middle[0] - half[0], middle[0] + half[0]),
            ylim=(middle[1] - half[1], middle[1] + half[1]),
            xlabel="xyz"[view[0]] + " [m]",
            ylabel="xyz"[view[1]] + " [m]",
        )
        axes.set_title(title, fontsize=9.5, loc="left", color="0.25")
        axes.grid(color="0.93", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        drawn.append((axes, points, grasp_map.positions[points][:, view]))
    figure.tight_layout(h_pad=1.5, rect=(0.0, FOOT / total, 1.0, 1.0 - 0.75 * HEAD / total))
    return figure, drawn


def _panels(grasp_map: GraspMap) -> Iterator[tuple[str, tuple[int, int], IntArray]]:
    """Yield the title, the axes to the right and upwards, and the points of each panel."""
    normals = grasp_map.normals
    axis = np.abs(normals).argmax(axis=1)
    sign = np.sign(normals[np.arange(len(axis)), axis]).astype(int)
    extent = np.ptp(grasp_map.positions, axis=0)
    for main, side in ((2, 1), (2, -1), (1, -1), (1, 1), (0, 1), (0, -1)):
        points = np.flatnonzero((axis == main) & (sign == side))
        if len(points):
            right, up = sorted(set(range(3)) - {main}, key=lambda k: (-extent[k], k))
            faces = sorted({grasp_map.faces[p] for p in points})
            named = ", ".join(faces[:3]) + (", ..." if len(faces) > 3 else "")
            title = f"{named}: normals towards {'+' if side > 0 else '-'}{'xyz'[main]}"
            yield title, (right, up), points


def _draw_panel(axes: Any, reach: Reach, ids: list[str], flat: Array, steps: IntArray) -> None:
    """Draw some points at their places in a view."""
    from matplotlib import colormaps

    most = int(reach.steps.max())
    named = np.linspace(0, most, min(most + 1, MOST_COLOURS)).round()
    for k in range(most + 1):
        colour, label = colormaps[COLOURS](k / max(1, most)), str(k) if k in named else None
        axes.scatter(*flat[steps == k].T, s=20, color=colour, linewidths=0.0, zorder=2, label=label)
    missed = flat[steps == NOT_REACHED]
    cross: dict[str, Any] = {"marker": "x", "color": "#d00000", "linewidths": 1.0}
    axes.scatter(*missed.T, s=24, zorder=3, label="not reached", **cross)
    for limb, name in enumerate(reach.start):
        ring = {"facecolor": "none", "edgecolor": LIMB_COLOURS[limb], "linewidth": 1.6}
        held, label = flat[np.array(ids) == name], f"limb {limb} at the start"
        axes.scatter(*held.T, s=110, zorder=4, label=label, **ring)
