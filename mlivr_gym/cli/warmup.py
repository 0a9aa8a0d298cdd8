"""The command `mlivr-gym warmup`."""

from __future__ import annotations

import argparse
import time

import numpy as np

from mlivr_gym.cli.progress import Progress
from mlivr_gym.compiled.cache import cache_folder, kernel_root
from mlivr_gym.compiled.kernels import LateEntry
from mlivr_gym.planners import Planner
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.world.grasp_map import jem_map

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)

FEW = ("F3a:2", "F3a:4", "F3b:2", "F3b:4")
"""Points of a map for which no table ships, so that a first plan on an own map is compiled too."""


def run(args: argparse.Namespace) -> None:
    """Compile all that plans run, once for each version of the package.

    The first plans compile what takes little time, and have the rest interpreted, which takes a
    second of each, until it is worth to compile it. Use this command to compile all beforehand,
    for instance while a container image is built.
    """
    began, LateEntry.patience = time.perf_counter(), 0.0
    with Progress("planning", quiet=args.quiet):
        graph = stance_graph()
        few = stance_graph(jem_map().subset(np.isin(graph.grasp_map.ids, FEW), "four points"))
        start, goal = few.ids(few.points[0]), few.base_position[-1].tolist()
        for cost in ("steps", "base"):
            Planner(graph).plan(START, GOAL, cost).unwrap()
            Planner(few).plan(start, goal, cost, goal_tolerance=0.05).unwrap()
    seconds, tables = time.perf_counter() - began, cache_folder()
    args.result |= {"seconds": seconds, "machine_code": kernel_root(), "step_tables": tables}
    print(f"ready after {seconds:.1f} s")
    print(f"machine code: {kernel_root()}")
    print(f"step tables: {'not stored' if tables is None else tables}")
