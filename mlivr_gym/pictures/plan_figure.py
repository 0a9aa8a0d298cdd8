"""Figure of a plan on its map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.figures import (
    BASE_COLOUR,
    GOAL_COLOUR,
    add_heading,
    add_legend,
    draw_base_path,
    map_axes,
    save_figure,
    tints,
)
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.world.grasp_map import GraspMap

MOST_EXPLORED = 4000
"""Explored base paths drawn at most; of more, an even selection is drawn."""


def plan_figure(
    grasp_map: GraspMap, plan: Plan, path: str | Path, tree: Array | None = None, title: str = ""
) -> None:
    """Picture of a plan: in space, from above and from the side, its stances numbered.

    Explored base paths are thin, the chosen one thick and green, footholds in the limb's colour,
    the goal region a ball.

    Args:
        grasp_map: The map.
        plan: The plan.
        path: PNG file to write.
        tree: Base positions at both ends of each explored step, shape (e, 2, 3) [m].
        title: Heading.
    """
    figure, axes = map_axes(grasp_map)
    figure.set_size_inches(12.8, 9.6)
    axes.set_position((-0.06, 0.22, 1.08, 0.82))
    explored = np.zeros((0, 2, 3)) if tree is None else tree
    drawn = explored[:: max(1, -(-len(explored) // MOST_EXPLORED))]
    _draw_explored(axes, drawn)
    _draw_footholds(axes, grasp_map, plan)
    draw_base_path(axes, plan.motion.base_positions, plan.query.goal, "base path")
    _draw_goal_region(axes, plan)
    _number(axes, plan.motion.base_positions)
    for place, depth, name in ((0.05, 2, "from above"), (0.54, 1, "from the side")):
        flat = figure.add_axes((place, 0.06, 0.42, 0.22))
        _draw_flat(flat, grasp_map, plan, depth)
        flat.set_title(name, fontsize=9.5, loc="left", color="0.25")
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


def _draw_goal_region(axes: Any, plan: Plan) -> None:
    """Draw the ball in which the base is to end."""
    turn, rise = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 17), np.linspace(0.0, np.pi, 9))
    ball = np.stack([np.cos(turn) * np.sin(rise), np.sin(turn) * np.sin(rise), np.cos(rise)])
    ball = np.array(plan.query.goal)[:, None, None] + plan.query.goal_tolerance * ball
    axes.plot_wireframe(*ball, color=GOAL_COLOUR, linewidth=0.4, alpha=0.7, zorder=4)


def _number(axes: Any, places: Array) -> None:
    """Write the numbers of stances at base positions, shape (k, 2 or 3) [m]."""
    for k, place in enumerate(places):
        shift = np.zeros(len(place))
        shift[-1] = 0.07
        axes.text(*(place + shift), str(k), fontsize=8, ha="center", zorder=8)


def _draw_flat(axes: Any, grasp_map: GraspMap, plan: Plan, depth: int) -> None:
    """Draw the plan seen along axis `depth` of the module, equal scale."""
    across = (0, 3 - depth)
    axes.scatter(*grasp_map.positions[:, across].T, s=3, color=tints(grasp_map), zorder=1)
    base = plan.motion.base_positions[:, across]
    for limb, held in enumerate(_held(grasp_map, plan)):
        colour = LIMB_COLOURS[limb]
        for a, b in zip(base, held[:, across], strict=True):
            axes.plot(*np.array([a, b]).T, color=colour, linewidth=0.7, alpha=0.6, zorder=2)
        axes.scatter(*held[:, across].T, s=26, color=colour, edgecolor="white", zorder=4)
    axes.plot(*base.T, color=BASE_COLOUR, linewidth=2.0, marker="s", markersize=4, zorder=3)
    ball = np.array(plan.query.goal)[list(across)]
    turn = np.linspace(0.0, 2.0 * np.pi, 61)
    ring = ball[:, None] + plan.query.goal_tolerance * np.array([np.cos(turn), np.sin(turn)])
    axes.plot(*ring, color=GOAL_COLOUR, linewidth=1.0, zorder=2)
    _number(axes, base)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]", fontsize=8)
    axes.set_ylabel("xyz"[across[1]] + " [m]", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _held(grasp_map: GraspMap, plan: Plan) -> list[Array]:
    """Points that each limb holds in each stance, shapes (k, 3) [m]."""
    index = {point: i for i, point in enumerate(grasp_map.ids)}
    return [
        grasp_map.positions[[index[stance[limb]] for stance in plan.stances]]
        for limb in range(plan.world.robot.limbs)
    ]


def _draw_explored(axes: Any, paths: Array) -> None:
    """Draw explored base paths, shape (e, 2, 3) [m]."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    if len(paths):
        axes.add_collection3d(
            Line3DCollection(
                paths,
                colors="0.5",
                linewidths=0.4,
                alpha=0.2,
                zorder=1.5,
                label="explored base paths",
            )
        )


def _draw_footholds(axes: Any, grasp_map: GraspMap, plan: Plan) -> None:
    """Draw what each limb holds in its colour, and lines from the base to it."""
    for limb, held in enumerate(_held(grasp_map, plan)):
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
