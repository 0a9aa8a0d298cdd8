"""The making of a stance graph."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.collisions.always_close import told_always_close
from mlivr_gym.collisions.distances import CABIN, CLEAR, HANDRAIL, OBSTACLE, SELF
from mlivr_gym.errors import RobotError
from mlivr_gym.postures import solver
from mlivr_gym.postures.postures import FIELDS, Postures
from mlivr_gym.robot.specification import ROBOT_OR_NAME, RobotSpec, robot_spec
from mlivr_gym.schema import OrNone
from mlivr_gym.settings import Settings
from mlivr_gym.stances.graph_table import COUNTS, GraphTable, ListedStances
from mlivr_gym.stances.node_edges import EdgeSet, NodePair, count_node_pairs, with_edges
from mlivr_gym.stances.node_table import is_exact
from mlivr_gym.stances.node_table_build import table_of_listed
from mlivr_gym.stances.parts import PartArrays, Parts
from mlivr_gym.stances.stance_graph import TOUCHED, StanceGraph
from mlivr_gym.stances.table_file import TABLES
from mlivr_gym.world.grasp_map import MAP, GraspMap, as_map

LEAST_STORED = 10_000
"""Number of pairs of points from which on the stances of a graph are stored in the cache folder: to
compute those of the JEM takes a second, to read them a hundredth."""

REMOVED = {"self": (SELF,), "cabin": (CABIN, OBSTACLE), "handrail": (HANDRAIL,)}
"""Causes of collisions that remove a stance from the graph; obstacles are here those of the map."""


@checked({"grasp_map": MAP, "robot": ROBOT_OR_NAME, "settings": OrNone(InstanceOf(Settings))})
def stance_graph(
    grasp_map: str | Path | GraspMap | dict[str, Any] | None = None,
    robot: str | RobotSpec | dict[str, Any] = "mlivr2",
    settings: Settings | None = None,
) -> StanceGraph:
    """Return the stance graph of a robot on a map.

    The map is the name of one that ships, the path of a JSON or CSV file, a map, or plain data, by
    default the measured JEM; the robot is a name, the path of a JSON, URDF or MJCF file, plain
    data, or a description. The settings are by default those of the paper, with steps checked. For
    two limbs the graph has all stances; for more limbs a search takes the table that ships or was
    built, and without one nodes are computed on demand. Raises an `MlivrError` if the map or the
    robot is faulty, or the robot cannot hold any stance on the map.


    Examples
    --------
    >>> graph = stance_graph()
    >>> len(graph.grasp_map)
    331
    """
    world, robot, settings = as_map(grasp_map), robot_spec(robot), settings or Settings()
    graph = StanceGraph(world, robot, settings)
    if is_exact(robot.limbs):
        list_stances(graph)
        if not len(graph):
            raise RobotError(
                f"robot {robot.name!r} cannot hold any stance on map {world.name!r}: "
                f"{_why_empty(graph)}"
            )
    return graph


def list_stances(graph: StanceGraph) -> None:
    """Give a graph its table: all stances from a file, or computed; steps only from a file."""
    found = TABLES.find(graph)
    if found is not None:
        graph.graph_table = found[1]
        return
    # They are the first part of a table, whether or not its steps are ever computed.
    is_large = len(graph.pairs) >= LEAST_STORED
    parts = Parts.of(graph, solver.__file__) if is_large else Parts(None)
    points, counts, *fields = parts.get("stances", lambda: _computed(graph))
    postures = Postures(**dict(zip(FIELDS, fields, strict=True)))
    listed = ListedStances(postures, dict(zip(COUNTS, counts.tolist(), strict=True)))
    # Until they are checked, limbs are taken to be released on every branch, and steps to keep all.
    sets = listed.postures.branch_sets
    table = table_of_listed(points, listed.postures, sets, np.zeros_like(sets))
    pairs = count_node_pairs(table, NodePair.before(table, 0), len(table.offset) - 1)
    every, none = np.ones(pairs, dtype=np.bool_), np.zeros(pairs, dtype=np.bool_)
    nodes = with_edges(table, EdgeSet(every, none, np.zeros(0, dtype=np.uint64)))
    graph.graph_table = GraphTable(nodes, not graph.settings.transitions, listed)


def _computed(graph: StanceGraph) -> PartArrays:
    """Compute the points of all stances, shape (n, N), the numbers of `COUNTS`, and `FIELDS`."""
    postures = graph.postures(graph.pairs)
    node = graph.is_node(postures)
    clear, w_b = postures.cause == CLEAR, postures.w_b
    stuck = ~node & clear & (w_b > 0.0) & (w_b >= graph.base_threshold)
    no_departure = (stuck & (postures.w_m >= graph.limb_threshold).all(axis=1)).sum()
    counts = [len(graph.pairs), int(postures.reachable.sum()), int(no_departure)]
    counts += [int(np.isin(postures.cause[~node], causes).sum()) for causes in REMOVED.values()]
    listed = postures.take(node)
    return [graph.pairs[node], np.array(counts), *(getattr(listed, name) for name in FIELDS)]


def in_same_world(
    graph: StanceGraph,
    *,
    grasp_map: GraspMap | None = None,
    robot: RobotSpec | None = None,
    settings: Settings | None = None,
) -> StanceGraph:
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


def _why_empty(graph: StanceGraph) -> str:
    """Return why a graph without stances has none."""
    counts = graph.listed.counts
    reachable = counts["reachable"]
    if not reachable:
        robot = graph.robot
        where = "" if robot.mounts else f" mounted {robot.mount_radius:g} m from the axis"
        return (
            f"no base pose at heights {robot.heights} m lets limbs{where} reach two points; give "
            "the robot other heights"
        )
    touching = ", ".join(
        f"{counts[name]} touch {TOUCHED[causes[0]]}"
        for name, causes in REMOVED.items()
        if counts[name]
    )
    thresholds = (
        f"w_m >= {graph.limb_threshold:g} and w_b >= {graph.base_threshold:g} with limbs that can "
        f"depart at w_m >= {graph.settings.path_floor:g}"
    )
    if touching:
        told = told_always_close(graph.robot, graph.settings.clearance)
        return (
            f"of {reachable} stances in reach none is left; of those that meet {thresholds} "
            f"{touching}{': ' if told else ''}{told}"
        )
    return (
        f"of {counts['reachable']} stances in reach none meets {thresholds}; lower limb_threshold"
    )
