"""The command `mlivr-gym info`."""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import asdict
from typing import Any

import numpy as np

from mlivr_gym.cli.arguments import chosen_graph, obstacle_options, world_options
from mlivr_gym.cli.progress import Progress
from mlivr_gym.stances.node_table import connected_parts
from mlivr_gym.stances.point_pairs import count_farther
from mlivr_gym.stances.stance_graph import StanceGraph


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    obstacle_options(parser)


def run(args: argparse.Namespace) -> None:
    """Describe a map, a robot, the settings and their stance graph.

    Told are numbers of points, stances and steps, and why pairs of points are not stances.
    """
    graph = chosen_graph(args)
    with Progress("counting stances and steps", quiet=args.quiet):
        summary = summary_of(graph)
    args.result |= summary
    for part, entries in summary.items():
        print(f"{part.replace('_', ' ')}:")
        for name, value in entries.items():
            print(f"  {_label(name)}: {_text(value)}")


def _label(name: str) -> str:
    """Return the name of an entry in words; w_m and w_b are symbols."""
    return name if name in ("w_m", "w_b") else name.replace("_", " ")


def _text(value: Any) -> str:
    """Format a value; a pair is a range."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {entry}" for name, entry in value.items()) or "none"
    if isinstance(value, tuple | list):
        return " to ".join(map(_text, value)) if len(value) == 2 else str(list(value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def summary_of(graph: StanceGraph) -> dict[str, dict[str, Any]]:
    """Describe a stance graph: lengths in metres, ranges as minimum and maximum."""
    grasp_map, robot = graph.grasp_map, graph.robot
    return {
        "map": {
            "name": grasp_map.name,
            "fingerprint": grasp_map.fingerprint,
            "points": len(grasp_map),
            "points_by_face": Counter(grasp_map.faces),
            "segments": len(grasp_map.segments),
            "handrails": len(grasp_map.handrails),
            "boxes_by_kind": Counter(box.kind for box in grasp_map.boxes),
            "cabin": [corner.tolist() for corner in grasp_map.cabin],
        },
        "robot": {
            "name": robot.name,
            "fingerprint": robot.fingerprint,
            "limbs": robot.limbs,
            "span": robot.span,
            "mounts": "even" if robot.mounts is None else "named, one for each limb",
            "mount_radius": robot.mount_radius,
            "characteristic_length": robot.characteristic_length,
            "body_size": robot.body_size,
            **({} if robot.cargo is None else {"cargo": asdict(robot.cargo)}),
            "capsules_of_a_limb": len(robot.mounted[0].capsules or ()),
            "masses_and_limits": robot.dynamics_source,
            **({"source": robot.source} if robot.source else {}),
        },
        "settings": asdict(graph.settings) | {"base_threshold": graph.base_threshold},
        "stance_graph": {
            "pairs_within_span": len(graph.pairs),
            "obstacles": len(graph.obstacles),
            "occupied": len(graph.occupied),
            **(_pair_summary(graph) if graph.lists_all else {"stances": "on demand"}),
        },
    }


def _pair_summary(graph: StanceGraph) -> dict[str, Any]:
    """Count stances and steps of two limbs, and the pairs of points that each rule excludes.

    The path floor of departures applies without thresholds, too. Pairs at a distance above the span
    are not evaluated.
    """
    assert graph.table is not None
    counts = dict(graph.listed.counts)
    considered, reachable = counts.pop("considered"), counts.pop("reachable")
    departure = counts.pop("no_departure")
    excluded = {"reach": considered - reachable, **counts, "departure": departure}
    excluded["manipulability"] = considered - len(graph) - sum(excluded.values())
    part, (_, row_start) = connected_parts(graph.table), graph.by_point
    sizes = np.bincount(part)
    return {
        "pairs_farther_than_span": count_farther(graph.grasp_map, graph.robot),
        "stances_reachable": reachable,
        "stances": len(graph),
        "stances_left_out": excluded,
        "stances_now": int((graph.branch_sets > 0).all(axis=1).sum()),
        "steps_before_checks": int((np.diff(row_start) ** 2).sum() - 2 * len(graph)),
        "connected_parts": int((sizes > 0).sum()),
        "stances_of_the_largest_part": int(sizes.max()),
        "w_m": [float(graph.w_m.min()), float(graph.w_m.max())],
        "w_b": [float(graph.w_b.min()), float(graph.w_b.max())],
        "longest_step": graph.max_displacement,
    }
