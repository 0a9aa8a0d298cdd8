"""Figure of a plan on its map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.figures import (
    add_heading,
    add_legend,
    draw_base_path,
    map_axes,
    save_figure,
)
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.world.grasp_map import GraspMap

MOST_EXPLORED = 4000
"""Explored base paths drawn at most; of more, an even selection is drawn."""


def plan_figure(
    grasp_map: GraspMap, plan: Plan, path: str | Path, tree: Array | None = None, title: str = ""
) -> None:
    """Picture of a plan: explored base paths thin, the chosen one thick, footholds by limb.

    Args:
        grasp_map: The map.
        plan: The plan.
        path: PNG file to write.
        tree: Base positions at both ends of each explored step, shape (e, 2, 3) [m].
        title: Heading.
    """
    figure, axes = map_axes(grasp_map)
    explored = np.zeros((0, 2, 3)) if tree is None else tree
    drawn = explored[:: max(1, -(-len(explored) // MOST_EXPLORED))]
    _draw_explored(axes, drawn)
    _draw_footholds(axes, grasp_map, plan)
    draw_base_path(axes, plan.motion.base_positions, plan.query.goal, "base path")
    count = f" ({len(drawn)} of {len(explored)} drawn)" if len(drawn) < len(explored) else ""
    add_heading(
        figure,
        title or "Plan",
        f"{len(plan.steps)} steps, base translation {plan.base_translation:.2f} m, "
        f"least $w_m$ {plan.w_m_min:.3f}, least $w_b$ {plan.w_b_min:.4f}, "
        f"{plan.statistics.expanded} states explored{count}",
    )
    add_legend(figure)
    save_figure(figure, path)


def _draw_explored(axes: Any, paths: Array) -> None:
    """Draw explored base paths, shape (e, 2, 3) [m]."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    if len(paths):
        axes.add_collection3d(
            Line3DCollection(
                paths,
                colors="#2a9d8f",
                linewidths=0.4,
                alpha=0.35,
                zorder=3,
                label="explored base paths",
            )
        )


def _draw_footholds(axes: Any, grasp_map: GraspMap, plan: Plan) -> None:
    """Draw what each limb holds in its colour, and lines from the base to it."""
    index = {point: i for i, point in enumerate(grasp_map.ids)}
    for limb in range(plan.world.robot.limbs):
        held = grasp_map.positions[[index[stance[limb]] for stance in plan.stances]]
        colour = LIMB_COLOURS[limb]
        for position, point in zip(plan.motion.base_positions, held, strict=True):
            axes.plot(
                *np.array([position, point]).T, color=colour, linewidth=0.7, alpha=0.6, zorder=4
            )
        axes.plot(*held.T, color=colour, linewidth=0.9, linestyle=":", zorder=4)
        axes.scatter(
            *held.T,
            s=46,
            color=colour,
            edgecolor="white",
            depthshade=False,
            zorder=6,
            label=f"footholds of limb {limb}",
        )
