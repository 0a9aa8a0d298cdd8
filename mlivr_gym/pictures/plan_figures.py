"""Figures of a plan, of a walk or of configurations on their map, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mlivr_gym.arguments import TupleOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.figures import box_corners, save_figure
from mlivr_gym.pictures.map_views import IN_SPACE, MapViews
from mlivr_gym.pictures.robot_shapes import Part, pale, robot_parts
from mlivr_gym.pictures.route import Route, base_paths, plan_base_path
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.robot.visuals import LIMB_COLOURS
from mlivr_gym.schema import Integer, ListOf, Numbers, OrNone
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

MAX_EXPLORED = 3000
"""Maximum number of explored base paths that are drawn; of more, every k-th is drawn."""

MAX_TREE_ROWS = 10**8
"""Maximum number of explored base paths that are accepted."""

GHOST_PALENESS = 0.72
"""Share of white in the colours of a ghost."""

PLAN_COLOURS = ("#9c36b5", "#e8590c", "#0b7285", "#862e9c", "#5c940d")
"""Colours of the abandoned parts of plans, in order; none is the colour of a base path."""

OCCUPIED_COLOUR, BOX_COLOUR = "#d00000", "#a5785a"
"""Colours of occupied points and of obstacles."""


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
    views = MapViews(grasp_map)
    explored = np.zeros((0, 2, 3)) if tree is None else tree
    drawn = explored[:: max(1, -(-len(explored) // MAX_EXPLORED))]
    _draw_explored(views, drawn)
    _draw_footholds(views, grasp_map, plan)
    for k in ghost_stances(plan):
        parts = robot_parts(plan.world.robot, plan.configuration(k))
        ghost = [part._replace(colour=pale(part.colour, GHOST_PALENESS)) for part in parts]
        views.solids(ghost, zorder=1.2)
    views.base_path(plan_base_path(plan), plan.motion.base_positions, "base path")
    views.goal(plan.query.goal, plan.query.goal_tolerance)
    count = f" ({len(drawn)} of {len(explored)} drawn)" if len(drawn) < len(explored) else ""
    views.head(
        title or "Plan",
        f"{len(plan.steps)} steps, base translation {plan.base_translation:.2f} m, "
        f"minimum $w_m$ {plan.w_m_min:.3f}, minimum $w_b$ {plan.w_b_min:.4f}, "
        f"{plan.statistics.expanded} states expanded{count}",
    )
    save_figure(views.figure, path)


@checked({**ARGUMENTS, "plans": ListOf(TupleOf((ARGUMENTS["plan"], Integer(0, 10**6))), 1)})
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


@checked(ARGUMENTS)
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
    views = MapViews(grasp_map)
    for configuration in configurations:
        views.solids(robot_parts(robot, configuration), zorder=5)
    if route is not None:
        views.base_path(route.line, route.stances, "base path")
        views.goal(route.goal.tolist(), route.goal_tolerance)
    views.head(title)
    save_figure(views.figure, path, vector=False)


def ghost_stances(plan: Plan) -> list[int]:
    """Return the stances in which the robot is drawn: the first, a middle one and the last."""
    return sorted({0, len(plan.stances) // 2, len(plan.stances) - 1})


def _draw_explored(views: MapViews, paths: Array) -> None:
    """Draw explored base paths in space as straight lines, shape (e, 2, 3) [m]."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    if len(paths):
        style = {"colors": "0.5", "linewidths": 0.4, "alpha": 0.2, "zorder": 1.5}
        lines = Line3DCollection(paths, label="explored base paths", **style)
        views.views[IN_SPACE].add_collection3d(lines)


def _draw_footholds(views: MapViews, grasp_map: GraspMap, plan: Plan) -> None:
    """Draw the footholds of each limb in its colour, and lines from the base to them."""
    for limb, points in enumerate(zip(*plan.stances, strict=True)):
        held = grasp_map.positions[[grasp_map.index(point) for point in points]]
        colour = LIMB_COLOURS[limb]
        for ends in np.stack([plan.motion.base_positions, held], axis=1):
            views.line(ends, color=colour, linewidth=0.7, alpha=0.6, zorder=4)
        views.line(held, color=colour, linewidth=0.9, linestyle=":", zorder=4)
        style = {"color": colour, "edgecolor": "white", "label": f"footholds of limb {limb}"}
        views.dots(held, s=46, zorder=6, **style)
