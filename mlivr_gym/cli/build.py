"""The command `mlivr-gym build`."""

from __future__ import annotations

import argparse
from pathlib import Path

from mlivr_gym.cli.arguments import Add, chosen_graph, command, option
from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.outputs import check_outputs, file_size, rough_duration
from mlivr_gym.cli.progress import PER_CENT, Progress
from mlivr_gym.compiled.cache import CACHE_VARIABLE, cache_folder
from mlivr_gym.errors import SettingError
from mlivr_gym.stances.table_build import build_table, estimate_table, name_of, write_built


def add_command(add: Add) -> None:
    """Add the command by `add_parser`, which is told its name and help."""
    parser = command(
        add,
        run,
        groups=("world",),
        description="Work out the complete table of a robot on a map and keep it in the package's "
        "cache folder, where plans and environments find it: of two limbs all steps, of three and "
        "four all nodes and what each step between them keeps at most. Before it begins it tells "
        "about how long that takes. What was stopped goes on where it was.",
    )
    told = "file to pass on, too, which is found in a cache folder under the name that is printed"
    option(parser, "--out FILE", told, type=Path)


def run(args: argparse.Namespace) -> int:
    """Work the table out and keep it."""
    graph, folder = chosen_graph(args), cache_folder()
    name = name_of(graph)
    if folder is None and args.out is None:
        raise SettingError(f"{CACHE_VARIABLE} is empty, so nothing is kept: name a file with --out")
    check_outputs(args.out)
    with Progress("looking what is to do", quiet=args.quiet):
        needed = estimate_table(graph)
    if needed is not None:
        if folder is not None and args.out is None:
            check_outputs(folder / f".{name}", folder=folder)  # whether it may be written
        args.result |= {"about_seconds": needed.seconds, "about_bytes": needed.size}
        print(
            f"{needed.candidates}: about {rough_duration(needed.seconds)}, "
            f"and a file of about {file_size(needed.size)}"
            + (f"; {needed.done} parts are done already" if needed.done else ""),
            flush=True,
        )
    with Progress("building [%]", PER_CENT, quiet=args.quiet) as progress:
        path = build_table(graph, progress.show_share)
    if args.out:
        write_built(graph, args.out)
        print(f"{args.out} (in a cache folder: {name})")
    if path is not None:
        print(f"{'kept' if needed else 'there already'}: {path}")
    args.result |= {"file": args.out or path, "kept": path, "name": name}
    return SUCCESS if path or args.out else FAILED
