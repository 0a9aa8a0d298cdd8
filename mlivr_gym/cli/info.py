"""The command `mlivr-gym info`."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from mlivr_gym.cli.arguments import (
    chosen_graph,
    obstacle_arguments,
    output_arguments,
    world_arguments,
)
from mlivr_gym.cli.exits import SUCCESS
from mlivr_gym.cli.progress import Progress
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.pair_rows import connected_parts
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.grasp_map import GraspMap


def add_command(add: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the command by `add_parser`, which is told its name and help."""
    parser = add(
        parents=[world_arguments(), obstacle_arguments(), output_arguments()],
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Describe map, robot, thresholds and stance graph."""
    with Progress("making the stance graph", quiet=args.quiet):
        graph = chosen_graph(args)
    args.result |= told_of(graph)
    _describe_map(graph.grasp_map)
    _describe_robot(graph.robot, graph.grasp_map, graph.settings)
    print(
        f"thresholds: w_m {graph.limb_threshold:g}, w_b {graph.base_threshold:g}, "
        f"on paths w_m {graph.settings.path_floor:g}"
    )
    print(f"ordered pairs of points within span: {len(graph.pairs)}")
    if isinstance(graph, PairGraph):
        _describe_stances(graph)
        _describe_steps(graph)
    else:
        print("stance graph: worked out as it is searched (more than two limbs)")
    return SUCCESS


def told_of(graph: StanceGraph) -> dict[str, Any]:
    """A stance graph as `--json` tells it: lengths in metres."""
    grasp_map, robot = graph.grasp_map, graph.robot
    told: dict[str, Any] = {
        "map": {
            "name": grasp_map.name,
            "fingerprint": grasp_map.fingerprint,
            "points": len(grasp_map),
            "points_by_face": Counter(grasp_map.faces),
            "segments": len(grasp_map.segments),
            "handrails": len(grasp_map.handrails),
            "boxes_by_kind": Counter(box.kind for box in grasp_map.boxes),
            "cabin": grasp_map.cabin,
        },
        "robot": {
            "name": robot.name,
            "fingerprint": robot.fingerprint,
            "limbs": robot.limbs,
            "span": robot.span,
            "characteristic_length": robot.characteristic_length,
        },
        "settings": asdict(graph.settings) | {"base_threshold": graph.base_threshold},
        "obstacles": len(graph.obstacles),
        "occupied": len(graph.occupied),
    }
    if isinstance(graph, PairGraph):
        told["stances"] = len(graph)
        told["stances_reachable"] = graph.reachable
        told["stances_now"] = int((graph.mask > 0).all(axis=1).sum())
        told["longest_step"] = graph.max_step
    return told


def _describe_map(grasp_map: GraspMap) -> None:
    faces = Counter(grasp_map.faces)
    low, high = grasp_map.cabin
    print(
        f"map {grasp_map.name} ({grasp_map.fingerprint}): "
        f"{len(grasp_map)} points on {len(grasp_map.segments)} tracks"
    )
    print("  faces: " + ", ".join(f"{face} {count}" for face, count in faces.items()))
    print(f"  handrails: {len(grasp_map.handrails)}; cabin {low.tolist()} to {high.tolist()} m")


def _describe_robot(robot: RobotSpec, grasp_map: GraspMap, settings: Settings) -> None:
    """The robot, and the shapes that collision checks compare."""
    print(
        f"robot {robot.name} ({robot.fingerprint}): {robot.limbs} limbs, "
        f"mounts {robot.mount_radius:g} m from the axis, "
        f"span {robot.span:g} m, l_c {robot.characteristic_length:g} m"
    )
    kinds = Counter(box.kind for box in grasp_map.boxes)
    boxes = ", ".join(f"{kind} {count}" for kind, count in kinds.items()) or "no boxes"
    checked = (
        f"clearance {settings.clearance:g} m" if settings.collisions else "collisions not checked"
    )
    print(
        f"shapes: {len(robot.shapes)} capsules a limb and a body of {robot.body_size:g} m; "
        f"{boxes}; {checked}"
    )


def _describe_stances(graph: PairGraph) -> None:
    """How many stances there are, and why the others are none."""
    out = {
        "reach": graph.considered - graph.reachable,
        **graph.removed,
        "departure": graph.no_departure,
    }
    out["manipulability"] = graph.considered - len(graph) - sum(out.values())
    order = ("reach", "manipulability", "departure", "self", "cabin", "handrail")
    print(
        f"stance graph: {graph.reachable} of {graph.considered} pairs in reach, "
        f"{len(graph)} stances, {graph.solver.geometries} different geometries"
    )
    print("  left out by cause: " + ", ".join(f"{name} {out[name]}" for name in order))
    print(
        f"  departure: a limb cannot leave its point with w_m >= {graph.settings.path_floor:g}, "
        f"thresholds or not; farther than the span of {graph.robot.span:g} m "
        f"{graph.farther_than_span} pairs are not tried"
    )
    if graph.obstacles or graph.occupied:
        remaining = int((graph.mask > 0).all(axis=1).sum())
        print(
            f"  {len(graph.obstacles)} obstacles and {len(graph.occupied)} occupied points "
            f"leave {remaining} stances"
        )


def _describe_steps(graph: PairGraph) -> None:
    """Edges, connected parts, manipulability of the stances, and the longest step."""
    count, part = connected_parts(graph.points, len(graph.grasp_map))
    edges = int((graph.degree**2).sum() - 2 * len(graph))
    print(
        f"  {edges} steps before checks, {count} connected parts, "
        f"the largest of {int(np.bincount(part).max())} stances"
    )
    print(
        f"  w_m {graph.w_m.min():.4f} to {graph.w_m.max():.4f}, "
        f"w_b {graph.w_b.min():.6f} to {graph.w_b.max():.6f}"
    )
    print(f"  longest base displacement of a step: {graph.max_step:.3f} m")
