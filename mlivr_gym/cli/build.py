"""The command `mlivr-gym build`."""

from __future__ import annotations

import argparse
from pathlib import Path

from mlivr_gym.cli.arguments import chosen_graph, option, world_options
from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.outputs import check_outputs, input_files
from mlivr_gym.cli.progress import Progress
from mlivr_gym.compiled.cache import CACHE_VARIABLE, cache_folder
from mlivr_gym.errors import SettingError
from mlivr_gym.stances.table_build import build_table, find_table, write_built
from mlivr_gym.stances.table_file import TABLES


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    text = "also write the table to this file; in a cache folder it needs the name that is printed"
    option(parser, "--out FILE", text, type=Path)


def run(args: argparse.Namespace) -> int:
    """Compute the complete table of a robot on a map.

    It is stored in the cache folder, where planners and environments find it. For two limbs it
    contains all steps; for three and four limbs, all nodes and, for each step between them, an
    upper bound of the branches kept. If the command is interrupted, run it again to continue.
    """
    check_outputs(args.out, inputs=input_files(args))
    graph, folder = chosen_graph(args), cache_folder()
    name = TABLES.name(graph)
    if folder is None and args.out is None:
        raise SettingError(
            f"{CACHE_VARIABLE} is empty, so the table would not be stored; name a file with --out"
        )
    with Progress("looking for the table", quiet=args.quiet):
        was_built = find_table(graph) is not None
    if not was_built and folder is not None and args.out is None:
        check_outputs(folder / f".{name}", folder=folder)
    with Progress("computing the table [%]", 100, args.quiet) as progress:
        path = build_table(graph, lambda share: progress.show(int(100 * share)))
    if args.out:
        write_built(graph, args.out)
        print(f"table: {args.out} (name it {name} in a cache folder)")
    if path is not None:
        print(f"{'already stored' if was_built else 'stored'}: {path}")
    args.result |= {"file": args.out or path, "kept": path, "name": name}
    return SUCCESS if path or args.out else FAILED
