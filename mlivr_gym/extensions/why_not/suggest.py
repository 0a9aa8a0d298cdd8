"""The command `mlivr-gym suggest`: the smallest changes with which a plan exists."""

from __future__ import annotations

import argparse

from mlivr_gym.cli.arguments import (
    chosen_graph,
    chosen_task,
    obstacle_options,
    option,
    world_options,
)
from mlivr_gym.cli.progress import Progress
from mlivr_gym.extensions.why_not.smallest_change import smallest_changes


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    obstacle_options(parser)
    option(parser, "--start POINT...", "ids of the points held at the start, one for each limb")
    option(parser, "--goal X Y Z", "goal position of the base [m]", type=float)
    option(parser, "--tolerance M", "radius of the goal region [m]", 0.2)
    option(parser, "--goal-face FACE", "face whose points all limbs must hold at the goal")


def run(args: argparse.Namespace) -> None:
    """Say with how few obstacles less, or which lower threshold of w_m, a plan exists.

    It is for queries of two limbs that have no plan; `mlivr-gym plan` says which rule excludes it.
    """
    graph = chosen_graph(args)
    start, goal = chosen_task(graph, args)
    with Progress("trying changes", quiet=args.quiet):
        changes = smallest_changes(
            graph, start, goal, goal_tolerance=args.tolerance, goal_face=args.goal_face
        )
    args.result |= {"changes": [change._asdict() for change in changes]}
    if not changes:
        print("no change of one kind would help: obstacles or limb_threshold")
    for change in changes:
        print(f"a plan of {change.steps} steps exists {change.message}")
