"""Figure of configurations on their map, for machines without GL."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.pictures.figures import (
    add_heading,
    add_legend,
    draw_base_path,
    draw_goal,
    map_axes,
    save_figure,
)
from mlivr_gym.pictures.flat_views import number
from mlivr_gym.pictures.robot_shapes import draw_robot, robot_parts
from mlivr_gym.pictures.route import Route
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.world.grasp_map import GraspMap


def configuration_figure(
    grasp_map: GraspMap,
    robot: RobotSpec,
    configurations: Sequence[Configuration],
    path: str | Path,
    title: str,
    route: Route | None = None,
) -> None:
    """Draw a robot on its map in one or several configurations, and what there is of a plan.

    Args:
        grasp_map: The map.
        robot: The robot.
        configurations: Where it is.
        path: PNG file to write; no SVG beside it, since this stands for a picture that is rendered.
        title: Heading.
        route: What is shown of a plan.
    """
    figure, axes = map_axes(grasp_map)
    for configuration in configurations:
        draw_robot(axes, robot_parts(robot, configuration))
    if route is not None:
        draw_base_path(axes, route.line, route.stances, "base path")
        draw_goal(axes, route.goal.tolist(), route.goal_tolerance)
        number(axes, route.stances)
        add_legend(figure)
    add_heading(figure, title)
    save_figure(figure, path, vector=False)
