"""The command `mlivr-gym warmup`."""

from __future__ import annotations

import argparse
import time

from mlivr_gym.cli.arguments import Add, command
from mlivr_gym.cli.progress import Progress
from mlivr_gym.compiled.cache import cache_folder, kernel_root
from mlivr_gym.planners import Planner
from mlivr_gym.stances.build import stance_graph

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)


def add_command(add: Add) -> None:
    """Add the command by `add_parser`, which is told its name and help."""
    command(
        add,
        run,
        description="Compile for this machine what a first plan needs, once for each version. "
        "The first plan does the same; an image or an installation can do it beforehand.",
    )


def run(args: argparse.Namespace) -> None:
    """Plan once, so that all is compiled."""
    began = time.perf_counter()
    with Progress("compiling and planning", quiet=args.quiet):
        Planner(stance_graph()).plan(START, GOAL, "steps").unwrap()
    seconds, tables = time.perf_counter() - began, cache_folder()
    args.result |= {"seconds": seconds, "machine_code": kernel_root(), "step_tables": tables}
    print(f"ready after {seconds:.1f} s")
    print(f"machine code: {kernel_root()}")
    print(f"step tables: {'not kept' if tables is None else tables}")
