"""Figure of what configurations touch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration, Contact, capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.pictures.figures import FACES, box_corners, write_figure
from mlivr_gym.robot.specification import LIMB_COLOURS, RobotSpec
from mlivr_gym.world.boxes import BOX, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

HALF_SIDE = 1.1
"""Half the side of the cube that a panel shows [m]."""

LARGEST_OFFSET = 1.3
"""Boxes all of whose corners lie within this of the centre, in each coordinate, are drawn [m]."""

MOST_CONTACTS = 4
"""Most contacts that are named in a panel."""


def blocked_figure(
    grasp_map: GraspMap,
    robot: RobotSpec,
    panels: list[tuple[str, list[Configuration], list[Contact]]],
    obstacles: Sequence[Box],
    path: str | Path,
) -> None:
    """What configurations touch: the robot's capsules, and in red what touches and is touched.

    Args:
        grasp_map: The map.
        robot: The robot.
        panels: For each picture its heading, configurations along a motion (the last one is drawn
            in full, the others thin), and what the last one touches.
        obstacles: Boxes besides the map's.
        path: PNG file to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4 * len(panels), 6.8), dpi=110)
    FigureCanvasAgg(figure)
    shapes = LimbShapes(robot)
    boxes = list({box.id: box for box in (*grasp_map.boxes, *obstacles)}.values())
    for k, (title, configurations, touching) in enumerate(panels):
        axes: Any = figure.add_subplot(
            1, len(panels), k + 1, projection="3d", computed_zorder=False
        )
        names = {name for contact in touching for name in (contact.first, contact.second)}
        for configuration in configurations[:-1]:
            _draw_thin(axes, robot, shapes, configuration)
        _draw_full(axes, robot, shapes, configurations[-1], names)
        centre = configurations[-1][0]
        _draw_boxes(axes, boxes, centre, names)
        _label(axes, title, centre, touching)
    figure.subplots_adjust(left=0.03, right=0.97, bottom=0.12, top=0.92, wspace=0.02)
    write_figure(figure, path)


def _draw_thin(
    axes: Any, robot: RobotSpec, shapes: LimbShapes, configuration: Configuration
) -> None:
    """Draw the capsules' axes of a configuration."""
    for i, limb in enumerate(capsule_ends(robot, shapes, configuration)):
        for ends in limb:
            axes.plot(
                *ends.T,
                color=LIMB_COLOURS[i],
                solid_capstyle="round",
                linewidth=1.0,
                alpha=0.35,
                zorder=4,
            )


def _draw_full(
    axes: Any,
    robot: RobotSpec,
    shapes: LimbShapes,
    configuration: Configuration,
    touching: set[str],
) -> None:
    """Draw body and capsules of a configuration, those whose names are given in red."""
    for i, limb in enumerate(capsule_ends(robot, shapes, configuration)):
        for c, name in enumerate(shapes.names):
            hit = f"limb{i}/{name}/{shapes.names[:c].count(name)}" in touching
            axes.plot(
                *limb[c].T,
                color="#d00000" if hit else LIMB_COLOURS[i],
                solid_capstyle="round",
                linewidth=150.0 * shapes.radii[c],
                alpha=0.9,
                zorder=6 if hit else 5,
            )
    axes.scatter(*configuration[0], s=260, marker="s", color="0.25", depthshade=False, zorder=5)


def _draw_boxes(axes: Any, boxes: Sequence[Box], centre: Array, touching: set[str]) -> None:
    """Draw the boxes round a centre, those whose names are given in red."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    for box in boxes:
        hit = scene_name(BOX, box.id) in touching
        corners = box_corners(box)
        inside = bool((np.abs(corners - centre) < LARGEST_OFFSET).all())
        if not hit and (box.kind not in ("track", "handrail", "obstacle") or not inside):
            continue
        corners = np.clip(corners, centre - HALF_SIDE, centre + HALF_SIDE)
        faces = [[corners[v] for v in face] for face in FACES]
        colour = "#d00000" if hit else "#1a59bf" if box.kind == "handrail" else "0.55"
        axes.add_collection3d(
            Poly3DCollection(
                faces, facecolor=colour, edgecolor=colour, linewidths=0.6, alpha=0.12, zorder=3
            )
        )


def _label(axes: Any, title: str, centre: Array, touching: list[Contact]) -> None:
    """Set limits, labels and view of a panel, and name the contacts."""
    for name, a, b in zip("xyz", centre - HALF_SIDE, centre + HALF_SIDE, strict=True):
        getattr(axes, f"set_{name}lim")(a, b)
        getattr(axes, f"set_{name}label")(f"{name} [m]")
    axes.set_box_aspect((1, 1, 1), zoom=1.12)
    axes.tick_params(labelsize=7)
    axes.view_init(elev=14, azim=-66)
    axes.set_title(title, fontsize=11, loc="left")
    lines = [
        f"{c.first} to {c.second}: {1000.0 * c.distance:.0f} mm" for c in touching[:MOST_CONTACTS]
    ]
    if len(touching) > MOST_CONTACTS:
        lines.append(f"and {len(touching) - MOST_CONTACTS} more pairs")
    axes.text2D(
        0.0,
        0.985,
        "\n".join(lines),
        transform=axes.transAxes,
        fontsize=8.5,
        color="#a00000",
        va="top",
    )
