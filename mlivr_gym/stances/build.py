"""The making of a stance graph."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.collisions.always_close import told_always_close
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.specification import ROBOT_OR_NAME, RobotSpec, robot_spec
from mlivr_gym.schema import OrNone
from mlivr_gym.settings import Settings
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.stance_graph import TOUCHED, StanceGraph
from mlivr_gym.stances.two_limb_graph import REMOVED, TwoLimbGraph
from mlivr_gym.world.grasp_map import MAP, GraspMap, as_map


@checked({"grasp_map": MAP, "robot": ROBOT_OR_NAME, "settings": OrNone(InstanceOf(Settings))})
def stance_graph(
    grasp_map: str | Path | GraspMap | dict[str, Any] | None = None,
    robot: str | RobotSpec | dict[str, Any] = "mlivr2",
    settings: Settings | None = None,
) -> TwoLimbGraph | ImplicitGraph:
    """Return the stance graph of a robot on a map.

    The map is the name of one that ships, the path of a JSON or CSV file, a map, or plain data, by
    default the measured JEM; the robot is a name, the path of a JSON, URDF or MJCF file, plain
    data, or a description. The settings are by default those of the paper, with steps checked. For
    two limbs the graph has all stances; for more limbs nodes are computed on demand. Raises an
    `MlivrError` if the map or the robot is faulty, or the robot cannot hold any stance on the map.


    Examples
    --------
    >>> graph = stance_graph()
    >>> len(graph.grasp_map)
    331
    """
    world, robot, settings = as_map(grasp_map), robot_spec(robot), settings or Settings()
    if robot.limbs > 2:
        return ImplicitGraph(world, robot, settings)
    graph = TwoLimbGraph(world, robot, settings)
    if not len(graph):
        raise RobotError(
            f"robot {robot.name!r} cannot hold any stance on map {world.name!r}: "
            f"{_why_empty(graph)}"
        )
    return graph


def in_same_world(
    graph: StanceGraph,
    *,
    grasp_map: GraspMap | None = None,
    robot: RobotSpec | None = None,
    settings: Settings | None = None,
) -> TwoLimbGraph | ImplicitGraph:
    """Return the graph of another map, robot or settings in the world of a graph.

    It has the obstacles and the occupied points of the graph; another map has the graph's points
    first. Raises as `stance_graph` does.
    """
    made = stance_graph(
        grasp_map or graph.grasp_map, robot or graph.robot, settings or graph.settings
    )
    made.add_obstacles(graph.obstacles)
    made.occupy(sorted(graph.occupied))
    return made


def _why_empty(graph: TwoLimbGraph) -> str:
    """Return why a graph without stances has none."""
    if not graph.reachable:
        robot = graph.robot
        where = "" if robot.mounts else f" mounted {robot.mount_radius:g} m from the axis"
        return (
            f"no base pose at heights {robot.heights} m lets limbs{where} reach two points; give "
            "the robot other heights"
        )
    touching = ", ".join(
        f"{count} touch {TOUCHED[REMOVED[name][0]]}"
        for name, count in graph.removed.items()
        if count
    )
    thresholds = (
        f"w_m >= {graph.limb_threshold:g} and w_b >= {graph.base_threshold:g} with limbs that can "
        f"depart at w_m >= {graph.settings.path_floor:g}"
    )
    if touching:
        told = told_always_close(graph.robot, graph.settings.clearance)
        return (
            f"of {graph.reachable} stances in reach none is left; of those that meet {thresholds} "
            f"{touching}{': ' if told else ''}{told}"
        )
    return f"of {graph.reachable} stances in reach none meets {thresholds}; lower limb_threshold"
