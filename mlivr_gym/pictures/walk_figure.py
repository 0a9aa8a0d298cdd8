"""Figure of a walk among obstacles on which the robot planned anew several times."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.figures import box_corners, save_figure
from mlivr_gym.pictures.map_views import IN_SPACE, MapViews
from mlivr_gym.pictures.robot_shapes import Part
from mlivr_gym.pictures.route import base_paths
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

PLAN_COLOURS = ("#9c36b5", "#e8590c", "#0b7285", "#862e9c", "#5c940d")
"""Colours of the abandoned parts of plans, in order; none is the colour of a base path."""

OCCUPIED_COLOUR, BOX_COLOUR = "#d00000", "#a5785a"
"""Colours of occupied points and of obstacles."""


def walk_figure(
    grasp_map: GraspMap,
    plans: Sequence[tuple[Plan, int]],
    path: str | Path,
    obstacles: Sequence[Box] = (),
) -> None:
    """Draw a walk among obstacles in space, from above and from the side, as PNG and SVG.

    `plans` are those of a `ClosedLoopRecord`, each with the number of its steps that were taken.
    The executed path is thick and green; the abandoned part of each plan is dashed, in a separate
    colour. Goal and occupied points are those of the last plan.
    """
    views, last = MapViews(grasp_map), plans[-1][0]
    views.solids([Part(box.id, BOX_COLOUR, box_corners(box)) for box in obstacles], 3.0, 0.35)
    for box in obstacles:
        words = {"fontsize": 9, "color": BOX_COLOUR, "zorder": 8, "parse_math": False}
        views.views[IN_SPACE].text(*box_corners(box).max(axis=0), box.id, **words)
    occupied = grasp_map.positions[[grasp_map.index(point) for point in last.world.occupied]]
    crosses = {"color": OCCUPIED_COLOUR, "marker": "x", "label": "points occupied"}
    views.dots(occupied, s=50, zorder=6, **crosses)
    for k, (plan, taken) in enumerate(plans[:-1]):
        views.line(
            parts_of(plan, taken)[1], label=f"plan {k + 1}, abandoned", linewidth=1.8, zorder=4,
            color=PLAN_COLOURS[k % len(PLAN_COLOURS)], linestyle=("--", "-.", ":")[k % 3],
        )  # fmt: skip
    bases = [plan.motion.base_positions[: taken + 1] for plan, taken in plans]
    stances = np.concatenate([bases[0][:1], *(base[1:] for base in bases)])
    line = np.concatenate([parts_of(*walked)[0] for walked in plans])
    views.base_path(line, stances, "base path walked")
    ring = {"marker": "o", "facecolor": "none", "edgecolor": "black"}
    replans = np.array([base[-1] for base in bases[:-1]]).reshape(-1, 3)
    views.dots(replans, s=130, label="plan abandoned here", zorder=7, **ring)
    views.goal(last.query.goal, last.query.goal_tolerance)
    times = {1: "", 2: " interrupted once", 3: " interrupted twice"}
    many = f" interrupted {len(plans) - 1} times"
    length = np.linalg.norm(np.diff(stances, axis=0), axis=1).sum()
    views.head(
        f"A walk{times.get(len(plans), many)}",
        f"{len(stances) - 1} steps, base translation {length:.2f} m",
    )
    save_figure(views.figure, path)


def parts_of(plan: Plan, taken: int) -> tuple[Array, Array]:
    """Return the base positions along the steps that were taken, and along the others (k, 3)."""
    bases, paths = plan.motion.base_positions, base_paths(plan)
    return (
        np.concatenate([bases[:1], *paths[:taken]]),
        np.concatenate([bases[taken : taken + 1], *paths[taken:]]),
    )
