"""The command `mlivr-gym warmup`."""

from __future__ import annotations

import argparse
import time

from mlivr_gym.cli.progress import Progress
from mlivr_gym.compiled.cache import cache_folder, kernel_root
from mlivr_gym.planners import Planner
from mlivr_gym.stances.build import stance_graph

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)


def run(args: argparse.Namespace) -> None:
    """Compile the code that the first plan needs, once for each version of the package.

    The first plan does the same; use this command to do it beforehand, for instance while a
    container image is built.
    """
    began = time.perf_counter()
    with Progress("compiling and planning", quiet=args.quiet):
        Planner(stance_graph()).plan(START, GOAL, "steps").unwrap()
    seconds, tables = time.perf_counter() - began, cache_folder()
    args.result |= {"seconds": seconds, "machine_code": kernel_root(), "step_tables": tables}
    print(f"ready after {seconds:.1f} s")
    print(f"machine code: {kernel_root()}")
    print(f"step tables: {'not stored' if tables is None else tables}")
