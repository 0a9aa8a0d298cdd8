"""The command `mlivr-gym nodes`."""

from __future__ import annotations

import argparse
from pathlib import Path

from mlivr_gym.cli.arguments import chosen_graph, output_arguments, world_arguments
from mlivr_gym.cli.exits import SUCCESS
from mlivr_gym.cli.outputs import claim, make_folder
from mlivr_gym.cli.progress import PER_CENT, Progress
from mlivr_gym.compiled.cache import CACHE_VARIABLE, cache_folder
from mlivr_gym.errors import SettingError
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_files import small_name, unpacked_path, write_table, write_unpacked
from mlivr_gym.stances.node_table_build import build
from mlivr_gym.stances.stance_sets import key_of


def add_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser's."""
    parser = commands.add_parser(
        "nodes",
        parents=[world_arguments(), output_arguments()],
        help="work out for a robot of three or four limbs what its plans come from",
        description="Work out every node of the stance graph of a robot with three or four limbs, "
        "and what each step between them keeps at most: its plans are then found over these, and "
        "bounded. On the JEM that takes two processes most of an hour or more.",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="small file to pass on, which planners find in the cache folder under the name that "
        "is printed (default: unpacked, in the package's cache folder)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Work the nodes out and keep them."""
    graph = chosen_graph(args)
    if not isinstance(graph, LazyGraph):
        raise SettingError(
            f"robot {graph.robot.name!r} has two limbs, whose stances are all known: nodes are "
            f"worked out for three or four"
        )
    folder, path = cache_folder(), args.out or unpacked_path(key_of(graph))
    if path is None:
        raise SettingError(f"{CACHE_VARIABLE} is empty, so nothing is kept: name a file with --out")
    claim(path, folder=None if args.out else folder)
    with Progress("nodes [%]", PER_CENT, quiet=args.quiet) as progress:
        table = build(graph, progress.show_share)
    if args.out:
        write_table(table, graph, path)
    else:
        make_folder(path.parent)
        write_unpacked(table, path)
    args.result |= {"file": path, "nodes": len(table.points)}
    name = f" (in a cache folder: {small_name(key_of(graph))})" if args.out else ""
    print(f"{len(table.points)} nodes: {path}{name}")
    return SUCCESS
