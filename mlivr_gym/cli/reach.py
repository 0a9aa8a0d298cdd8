"""The command `mlivr-gym reach`."""

from __future__ import annotations

import argparse

import numpy as np

from mlivr_gym.cli.arguments import (
    LIMIT,
    chosen_graph,
    chosen_task,
    obstacle_options,
    option,
    world_options,
)
from mlivr_gym.cli.outputs import check_outputs, input_files
from mlivr_gym.cli.progress import Progress
from mlivr_gym.pictures.figures import figure_files
from mlivr_gym.planners.query import EXPANSIONS, MAX_EXPANSIONS
from mlivr_gym.planners.reach import NOT_REACHED, reach_from
from mlivr_gym.schema import Integer
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    obstacle_options(parser)
    option(parser, "--start POINT...", "ids of the points held at the start, one for each limb")
    text, steps = "maximum number of steps (default: no limit)", Integer(0, MAX_EXPANSIONS)
    option(parser, "--most-steps K", text, valid=steps)
    option(parser, "--limit LIMIT", "maximum number of states expanded", EXPANSIONS, LIMIT)
    option(parser, "--picture FILE", "draw the points to a PNG file and an SVG file of that name")


def run(args: argparse.Namespace) -> None:
    """Count after how many steps at least each point can be grasped from a start stance."""
    pictures = figure_files(args.picture) if args.picture is not None else ()
    check_outputs(*pictures, inputs=input_files(args))
    graph = chosen_graph(args)
    args.goal, args.tolerance = (0.0, 0.0, 0.0), 0.2
    start = chosen_task(graph, args)[0]
    expanded = "states expanded"
    if isinstance(graph, TwoLimbGraph) and not graph.is_complete:
        expanded += ", without a table of steps (see mlivr-gym build)"
    with Progress(expanded, quiet=args.quiet) as progress:
        reach = reach_from(graph, start, args.most_steps, args.limit, progress.show)
    steps, ids = reach.steps, np.array(graph.grasp_map.ids)
    args.result |= {
        "start": reach.start,
        "steps": dict(zip(ids.tolist(), steps.tolist(), strict=True)),
        "expanded": reach.expanded,
        "is_complete": reach.is_complete,
        "files": list(pictures),
    }
    print(f"from {' '.join(reach.start)}, by the fewest steps after which a limb holds a point:")
    for k in range(int(steps.max()) + 1):
        print(f"  {k}: {(steps == k).sum()} points, {' '.join(ids[steps == k])}")
    rest = ids[steps == NOT_REACHED]
    if len(rest):
        name = "out of reach" if reach.is_complete else "not reached"
        print(f"  {name}: {len(rest)} points, {' '.join(rest)}")
    if pictures:
        from mlivr_gym.pictures.reach_figure import reach_figure  # imports matplotlib

        title = f"Reach of {graph.robot.name} on {graph.grasp_map.name}"
        reach_figure(graph.grasp_map, reach, args.picture, title)
        print(f"picture: {pictures[0]}, {pictures[1]}")
