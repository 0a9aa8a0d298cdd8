"""The command `mlivr-gym roadmap`."""

from __future__ import annotations

import argparse
from pathlib import Path

from mlivr_gym.cli.arguments import Commands, chosen_graph, command, option
from mlivr_gym.cli.outputs import claim, make_folder
from mlivr_gym.cli.progress import PER_CENT, Progress
from mlivr_gym.compiled.cache import CACHE_VARIABLE, cache_folder
from mlivr_gym.errors import SettingError
from mlivr_gym.planners.roadmap import roadmap_files
from mlivr_gym.planners.roadmap_build import MOST, build
from mlivr_gym.stances.lazy_graph import LazyGraph


def add_command(commands: Commands) -> None:
    """Add the command to the parser's."""
    parser = command(
        commands,
        run,
        groups=("world",),
        help="work out for a robot of three or four limbs what makes its first plans quick",
        description="Explore the stance graph of a robot with three or four limbs, and keep the "
        "stances and steps found: first plans of that robot, map and settings then come from "
        "there among obstacles, or where there is no table of nodes. Those of mlivr3 and mlivr4 on "
        "the JEM ship with the package. The more stances are expanded, the more starts can be "
        "joined, and the fewer steps plans take; 10,000 take minutes. Of those found the ones are "
        "kept through which most short walks pass.",
    )
    option(parser, "--expansions N", "stances whose steps are worked out", 10_000)
    option(parser, "--stances N", "most stances that are kept", MOST)
    option(parser, "--out FILE", "file (default: the package's cache folder)", type=Path)


def run(args: argparse.Namespace) -> None:
    """Build a roadmap and keep it."""
    for name in ("expansions", "stances"):
        if not 1 <= getattr(args, name) <= 10_000_000:
            raise SettingError(
                f"--{name} is {getattr(args, name)}; it must be between 1 and 10,000,000"
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
        roadmap = build(graph, args.expansions, args.stances, progress.show_share)
    if not args.out:
        make_folder(path.parent)
    roadmap.write(path)
    args.result |= {"file": path, "stances": len(roadmap), "steps": len(roadmap.pairs.rows)}
    print(f"{len(roadmap)} stances, {len(roadmap.pairs.rows)} steps between them: {path}")
