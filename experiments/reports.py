"""What the experiments share: their command line, tables in Markdown, files of results, Case 3."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym import GraspMap, Settings, jem_map, stance_graph
from mlivr_gym.files import write_whole
from mlivr_gym.paper import CASES, case_graph, default_setup
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph

ROOT = Path(__file__).parent.parent
"""The repository."""

NOTHING = "\N{EN DASH}"
"""What a cell without a figure shows."""


def command_line(description: str | None) -> argparse.ArgumentParser:
    """A parser with the option `--out`; `told` is the docstring of the script."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("results"), help="folder for the results")
    return parser


def table(head: str, rows: Iterable[Sequence[Any]]) -> str:
    """A table in Markdown; the names in `head` are separated by ` | `."""
    names = head.split(" | ")
    lines = [f"| {' | '.join(map(str, row))} |" for row in (names, *rows)]
    return "\n".join([lines[0], "|---" * len(names) + "|", *lines[1:]]) + "\n"


def counted(counts: dict[str, int]) -> str:
    """Counts in words, by name."""
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items()))


def read(out: Path, name: str) -> dict[str, Any]:
    """What was measured so far; nothing if there is no file."""
    path = out / f"{name}.json"
    data: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.exists() else {}
    return data


def keep(out: Path, name: str, data: Any, indent: int | None = 1) -> None:
    """Write what was measured so far."""
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / f"{name}.json", json.dumps(data, indent=indent) + "\n")


def publish(
    out: Path, name: str, data: Any, markdown: Callable[[Any], str], indent: int | None = 1
) -> None:
    """Write what was measured, and its page."""
    keep(out, name, data, indent)
    write_whole(out / f"{name}.md", markdown(data))


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds that a call takes, and what it returns."""
    start = time.perf_counter()
    value = call()
    return time.perf_counter() - start, value


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Median and 95th percentile [ms], and how many."""
    median, p95 = 1e3 * np.percentile(seconds, (50, 95))
    return {"median": float(median), "p95": float(p95), "count": len(seconds)}


def pair_graph(grasp_map: GraspMap | None = None, **settings: Any) -> PairGraph:
    """The stance graph of two limbs, in the JEM if no map is given."""
    graph = stance_graph(grasp_map or jem_map(), settings=Settings(**settings))
    assert isinstance(graph, PairGraph)
    return graph


def case_3() -> tuple[StanceGraph, Plan]:
    """Case 3 of the paper's Table I, collisions checked: its graph and its plan."""
    setup = default_setup()
    graph, face = case_graph(3, setup, "collisions"), setup["goal_face"]
    found = Planner(graph).plan(setup["start"], setup["goal"], CASES[3].cost, goal_face=face)
    return graph, found.unwrap()
