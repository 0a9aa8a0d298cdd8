"""The command `mlivr-gym rank`: plans of several costs, the fastest or the gentlest first."""

from __future__ import annotations

import argparse

from mlivr_gym.cli.arguments import (
    chosen_graph,
    chosen_task,
    obstacle_options,
    option,
    world_options,
)
from mlivr_gym.cli.outputs import check_outputs, input_files
from mlivr_gym.cli.progress import Progress
from mlivr_gym.extensions.reaction.fastest import RANKS, ranked_plans
from mlivr_gym.planners import Planner
from mlivr_gym.schema import Choice


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    obstacle_options(parser)
    option(parser, "--start POINT...", "ids of the points held at the start, one for each limb")
    option(parser, "--goal X Y Z", "goal position of the base [m]", type=float)
    option(parser, "--tolerance M", "radius of the goal region [m]", 0.2)
    option(parser, "--goal-face FACE", "face whose points all limbs must hold at the goal")
    option(parser, "--by FIGURE", "which plan is best", "time", Choice(RANKS))
    option(parser, "--out FILE", "write the best plan to a JSON file")


def run(args: argparse.Namespace) -> None:
    """Plan a query for several costs, and list the plans, the best first.

    The best is the fastest (--by time), or the one with the least total impulse on the station,
    after other base poses and swings were tried (--by reaction).
    """
    check_outputs(args.out, inputs=input_files(args))
    graph = chosen_graph(args)
    start, goal = chosen_task(graph, args)
    with Progress("comparing plans", quiet=args.quiet):
        candidates = ranked_plans(
            Planner(graph), start, goal, best=args.by,
            goal_tolerance=args.tolerance, goal_face=args.goal_face,
        )  # fmt: skip
    rows = []
    for candidate in candidates:
        price = "" if candidate.price is None else f", regrasp price {candidate.price:g} m"
        print(
            f"  {candidate.seconds:5.1f} s, {candidate.impulse:4.0f} N s, "
            f"at most {candidate.peak_force:3.0f} N: {len(candidate.plan.steps)} steps, "
            f"{candidate.plan.base_translation:.3f} m "
            f"(optimal for cost {candidate.cost}{price})"
        )
        figures = candidate._asdict() | {"steps": len(candidate.plan.steps)}
        del figures["plan"]
        rows.append(figures | {"base_translation": candidate.plan.base_translation})
    args.result |= {"start": start, "goal": goal, "plans": rows}
    if args.out:
        candidates[0].plan.save(args.out)
        print(f"plan: {args.out}")
