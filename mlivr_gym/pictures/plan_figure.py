"""Figures of a plan or of configurations on their map, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.figures import (
    add_heading,
    add_legend,
    draw_base_path,
    draw_goal,
    map_axes,
    save_figure,
)
from mlivr_gym.pictures.flat_views import (
    View,
    draw_flat_ghost,
    draw_flat_goal,
    draw_flat_path,
    map_views,
    number_stances,
)
from mlivr_gym.pictures.robot_shapes import draw_ghost, draw_robot, robot_parts
from mlivr_gym.pictures.route import Route, plan_base_path
from mlivr_gym.robot.specification import LIMB_COLOURS, RobotSpec
from mlivr_gym.schema import Numbers, OrNone
from mlivr_gym.world.grasp_map import GraspMap

MAX_EXPLORED = 3000
"""Maximum number of explored base paths that are drawn; of more, every k-th is drawn."""

MAX_TREE_ROWS = 10**8
"""Maximum number of explored base paths that are accepted."""


@checked({**ARGUMENTS, "tree": OrNone(Numbers((None, 2, 3), rows=(0, MAX_TREE_ROWS)))})
def plan_figure(
    grasp_map: GraspMap, plan: Plan, path: str | Path, tree: Array | None = None, title: str = ""
) -> None:
    """Draw a plan in space, from above and from the side, with numbered stances.

    Explored base paths are thin lines, the planned one is thick and green, footholds have the
    limb's colour, and the goal region is a ball. The robot is drawn pale in its first stance, a
    middle one and the last. `tree` has the base positions at both ends of each explored step, shape
    (e, 2, 3) [m]; `path` is that of the PNG file, beside which an SVG of the same name is written.

    Raises a `FileError` if a file cannot be written.

    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> from mlivr_gym.planners import Planner
    >>> graph = stance_graph()
    >>> plan = Planner(graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), cost="steps").unwrap()
    >>> plan_figure(graph.grasp_map, plan, "plan.png")
    """
    figure, axes, flats = map_views(grasp_map)
    explored = np.zeros((0, 2, 3)) if tree is None else tree
    drawn = explored[:: max(1, -(-len(explored) // MAX_EXPLORED))]
    _draw_explored(axes, drawn)
    _draw_footholds(axes, grasp_map, plan)
    for k in ghost_stances(plan):
        draw_ghost(axes, robot_parts(plan.world.robot, plan.configuration(k)))
    draw_base_path(axes, plan_base_path(plan), plan.motion.base_positions, "base path")
    draw_goal(axes, plan.query.goal, plan.query.goal_tolerance)
    number_stances(axes, plan.motion.base_positions)
    for view, flat in flats.items():
        _draw_flat(flat, view, grasp_map, plan)
    count = f" ({len(drawn)} of {len(explored)} drawn)" if len(drawn) < len(explored) else ""
    add_heading(
        figure,
        title or "Plan",
        f"{len(plan.steps)} steps, base translation {plan.base_translation:.2f} m, "
        f"minimum $w_m$ {plan.w_m_min:.3f}, minimum $w_b$ {plan.w_b_min:.4f}, "
        f"{plan.statistics.expanded} states expanded{count}",
    )
    add_legend(figure)
    save_figure(figure, path)


def configuration_figure(
    grasp_map: GraspMap,
    robot: RobotSpec,
    configurations: Sequence[Configuration],
    path: str | Path,
    title: str,
    route: Route | None = None,
) -> None:
    """Draw a robot in configurations, for machines on which MuJoCo cannot render.

    With a route, that of a plan is drawn, too. The PNG file is written without an SVG. Raises a
    `FileError` if it cannot be written.
    """
    figure, axes = map_axes(grasp_map)
    for configuration in configurations:
        draw_robot(axes, robot_parts(robot, configuration))
    if route is not None:
        draw_base_path(axes, route.line, route.stances, "base path")
        draw_goal(axes, route.goal.tolist(), route.goal_tolerance)
        number_stances(axes, route.stances)
        add_legend(figure)
    add_heading(figure, title)
    save_figure(figure, path, vector=False)


def _draw_flat(axes: Any, view: View, grasp_map: GraspMap, plan: Plan) -> None:
    """Draw a plan in a flat view."""
    base = plan.motion.base_positions
    for k in ghost_stances(plan):
        draw_flat_ghost(axes, view, robot_parts(plan.world.robot, plan.configuration(k)))
    for limb, held in enumerate(_held(grasp_map, plan)):
        colour = LIMB_COLOURS[limb]
        for ends in np.stack([base, held], axis=1):
            axes.plot(*ends[:, view].T, color=colour, linewidth=0.7, alpha=0.6, zorder=2)
        axes.scatter(*held[:, view].T, s=26, color=colour, edgecolor="white", zorder=4)
    draw_flat_path(axes, view, plan_base_path(plan), base)
    draw_flat_goal(axes, view, plan.query.goal, plan.query.goal_tolerance)


def ghost_stances(plan: Plan) -> list[int]:
    """Return the stances in which the robot is drawn: the first, a middle one and the last."""
    return sorted({0, len(plan.stances) // 2, len(plan.stances) - 1})


def _held(grasp_map: GraspMap, plan: Plan) -> list[Array]:
    """Return the positions of the points that each limb holds, by stance, shapes (k, 3) [m]."""
    index = {point: i for i, point in enumerate(grasp_map.ids)}
    return [
        grasp_map.positions[[index[stance[limb]] for stance in plan.stances]]
        for limb in range(plan.world.robot.limbs)
    ]


def _draw_explored(axes: Any, paths: Array) -> None:
    """Draw explored base paths as straight lines, shape (e, 2, 3) [m]."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    if len(paths):
        style = {"colors": "0.5", "linewidths": 0.4, "alpha": 0.2, "zorder": 1.5}
        axes.add_collection3d(Line3DCollection(paths, label="explored base paths", **style))


def _draw_footholds(axes: Any, grasp_map: GraspMap, plan: Plan) -> None:
    """Draw the footholds of each limb in its colour, and lines from the base to them."""
    for limb, held in enumerate(_held(grasp_map, plan)):
        colour = LIMB_COLOURS[limb]
        for position, point in zip(plan.motion.base_positions, held, strict=True):
            axes.plot(
                *np.array([position, point]).T, color=colour, linewidth=0.7, alpha=0.6, zorder=4
            )
        axes.plot(*held.T, color=colour, linewidth=0.9, linestyle=":", zorder=4)
        style = {"color": colour, "edgecolor": "white", "depthshade": False, "zorder": 6}
        axes.scatter(*held.T, s=46, label=f"footholds of limb {limb}", **style)
