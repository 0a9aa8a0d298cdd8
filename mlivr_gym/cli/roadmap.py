"""The command `mlivr-gym roadmap`."""

from __future__ import annotations

import argparse
from pathlib import Path

from mlivr_gym.cli.arguments import chosen_graph, output_arguments, world_arguments
from mlivr_gym.cli.exits import SUCCESS
from mlivr_gym.cli.outputs import claim, make_folder
from mlivr_gym.cli.progress import PER_CENT, Progress
from mlivr_gym.compiled.cache import CACHE_VARIABLE, cache_folder
from mlivr_gym.errors import SettingError
from mlivr_gym.planners.roadmap import roadmap_files
from mlivr_gym.planners.roadmap_build import build
from mlivr_gym.stances.lazy_graph import LazyGraph


def add_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser's."""
    parser = commands.add_parser(
        "roadmap",
        parents=[world_arguments(), output_arguments()],
        help="work out for a robot of three or four limbs what makes its first plans quick",
        description="Explore the stance graph of a robot with three or four limbs, and keep the "
        "stances and steps found: first plans of that robot, map and settings then come from "
        "there. Those of mlivr3 and mlivr4 on the JEM ship with the package. The more stances are "
        "expanded, the more starts can be joined, and the fewer steps plans take; 10,000 take "
        "minutes.",
    )
    parser.add_argument(
        "--expansions",
        type=int,
        default=10_000,
        metavar="N",
        help="stances whose steps are worked out (default: %(default)s)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="file (default: the package's cache folder)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Build a roadmap and keep it."""
    if not 1 <= args.expansions <= 10_000_000:
        raise SettingError(
            f"--expansions is {args.expansions}; it must be between 1 and 10,000,000"
        )
    graph = chosen_graph(args)
    if not isinstance(graph, LazyGraph):
        raise SettingError(
            f"robot {graph.robot.name!r} has two limbs, whose stances are all known: a roadmap is "
            f"for three or four"
        )
    folder = cache_folder()
    if args.out is None and folder is None:
        raise SettingError(f"{CACHE_VARIABLE} is empty, so nothing is kept: name a file with --out")
    path = args.out or roadmap_files(graph)[0]
    claim(path, folder=None if args.out else folder)
    with Progress("exploring and joining [%]", PER_CENT, quiet=args.quiet) as progress:
        roadmap = build(graph, args.expansions, progress.show_share)
    if not args.out:
        make_folder(path.parent)
    roadmap.write(path)
    args.result |= {"file": path, "stances": len(roadmap), "steps": len(roadmap.pairs)}
    print(f"{len(roadmap)} stances, {len(roadmap.pairs)} steps between them: {path}")
    return SUCCESS
