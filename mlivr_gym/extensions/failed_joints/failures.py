"""The command `mlivr-gym failures`: what a robot still reaches with each joint of a limb locked."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from mlivr_gym.cli.arguments import SEED, chosen_graph, obstacle_options, option, world_options
from mlivr_gym.cli.progress import Progress
from mlivr_gym.errors import RobotError, SettingError
from mlivr_gym.extensions.failed_joints.failed_joints import reach_without
from mlivr_gym.schema import Integer
from mlivr_gym.stances import random_state


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    obstacle_options(parser)
    option(parser, "--start POINT...", "ids of the points held (default: drawn)")
    option(parser, "--limb LIMB", "number of the limb", 0, Integer(0, 1))
    option(parser, "--goals N", "number of goals that are drawn", 8, Integer(1, 1000))
    option(parser, "--seed N", "seed of what is drawn", 0, SEED)


def run(args: argparse.Namespace) -> None:
    """Count the stances and the goals that are left when a joint fails, for each joint of a limb.

    The joint is locked at its angle at the start. A limb of seven joints then holds it in place of
    that which it held; one of six can only stay where it is.
    """
    graph = chosen_graph(args)
    if not graph.lists_all:
        raise SettingError(f"failures needs two limbs; {graph.robot.name!r} has {graph.limbs}")
    rng = np.random.default_rng(args.seed)
    start = random_state(graph, rng) if args.start is None else graph.state(args.start)
    drawn = graph.points[rng.integers(len(graph), size=args.goals)]
    goals = graph.postures(drawn).base_position
    joints = len(graph.robot.every_limb[args.limb].joint_limits)
    rows = list[dict[str, Any]]()
    for joint in range(1, joints + 1):
        try:
            with Progress(f"joint {joint}", quiet=args.quiet):
                found = reach_without(graph, start, args.limb, joint, goals)
        except RobotError as fault:
            rows.append({"joint": joint, "reason": str(fault)})
            print(f"  joint {joint}: {fault}")
            continue
        rows.append({"joint": joint, **found._asdict()})
        print(
            f"  joint {joint}: {found.stances} of {len(graph)} stances, "
            f"{found.goals} of {len(goals)} goals"
        )
    args.result |= {"start": graph.ids(start.stance), "stances": len(graph), "joints": rows}
