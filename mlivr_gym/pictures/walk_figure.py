"""Figure of a walk among obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.pictures.figures import (
    FACES,
    add_heading,
    add_legend,
    box_corners,
    draw_base_path,
    map_axes,
    save_figure,
)
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap


def walk_figure(
    grasp_map: GraspMap,
    walked: Array,
    planned: list[Array],
    path: str | Path,
    *,
    goal: Sequence[float],
    obstacles: Sequence[Box],
    occupied: Sequence[str],
) -> None:
    """Picture of a walk among obstacles: base path walked thick, what had been planned dashed.

    Args:
        grasp_map: The map.
        walked: Base positions, shape (k, 3) [m].
        planned: Base positions of each plan that was made, shape (k, 3) [m].
        path: PNG file to write.
        goal: Goal position [m].
        obstacles: Boxes besides the map's.
        occupied: Ids of points that were not to be grasped.
    """
    figure, axes = map_axes(grasp_map)
    for box in obstacles:
        _draw_obstacle(axes, box)
    if occupied:
        axes.scatter(
            *grasp_map.positions[[grasp_map.index(point) for point in occupied]].T,
            s=50,
            marker="x",
            color="#d00000",
            depthshade=False,
            zorder=6,
            label="points occupied",
        )
    for k, base in enumerate(planned):
        axes.plot(
            *base.T,
            linestyle="--",
            linewidth=1.4,
            color=LIMB_COLOURS[k + 2],
            zorder=4,
            label=f"plan {k + 1}",
        )
    draw_base_path(axes, walked, goal, "base path walked")
    length = float(np.linalg.norm(np.diff(walked, axis=0), axis=1).sum())
    add_heading(
        figure,
        "A walk interrupted twice",
        f"{len(walked) - 1} steps, base translation {length:.2f} m, {len(planned)} plans",
    )
    add_legend(figure)
    save_figure(figure, path)


def _draw_obstacle(axes: Any, box: Box) -> None:
    """Draw a box with its name."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    corners = box_corners(box)
    faces = [[corners[v] for v in face] for face in FACES]
    axes.add_collection3d(
        Poly3DCollection(faces, facecolor="#d95926", edgecolor="#d95926", alpha=0.3, zorder=3)
    )
    axes.text(*corners.max(axis=0), box.id, fontsize=9, color="#a03000", zorder=8, parse_math=False)
