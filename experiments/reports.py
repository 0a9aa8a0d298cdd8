"""Shared parts of the experiments: command line, tables, result files, timing and Case 3."""

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
"""Root folder of the repository."""

NOTHING = "\N{EN DASH}"
"""Content of a table cell without a value."""


def command_line(description: str | None, out: str = "results") -> argparse.ArgumentParser:
    """Return a parser with the option `--out`; `description` is the docstring of the script."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path(out), help="folder (default: %(default)s)")
    return parser


def table(head: str, rows: Iterable[Sequence[Any]]) -> str:
    """Return a table in Markdown; the titles in `head` are separated by ` | `."""
    names = head.split(" | ")
    lines = [f"| {' | '.join(map(str, row))} |" for row in (names, *rows)]
    return "\n".join([lines[0], "|---" * len(names) + "|", *lines[1:]]) + "\n"


def counted(counts: dict[str, int]) -> str:
    """Return counts as text, sorted by name."""
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items()))


def read(out: Path, name: str) -> dict[str, Any]:
    """Return the stored results of an experiment, or an empty dictionary if no file exists."""
    path = out / f"{name}.json"
    data: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.exists() else {}
    return data


def keep(out: Path, name: str, data: Any, indent: int | None = 1) -> None:
    """Write the results of an experiment as JSON."""
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / f"{name}.json", json.dumps(data, indent=indent) + "\n")


def publish(
    out: Path, name: str, data: Any, markdown: Callable[[Any], str], indent: int | None = 1
) -> None:
    """Write the results of an experiment as JSON, and the page that `markdown` makes of them."""
    keep(out, name, data, indent)
    write_whole(out / f"{name}.md", markdown(data))


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return the duration of a call [s] and its value."""
    start = time.perf_counter()
    value = call()
    return time.perf_counter() - start, value


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Return the median and the 95th percentile of durations [ms], and their number."""
    median, p95 = 1e3 * np.percentile(seconds, (50, 95))
    return {"median": float(median), "p95": float(p95), "count": len(seconds)}


def pair_graph(grasp_map: GraspMap | None = None, **settings: Any) -> PairGraph:
    """Return the stance graph of two limbs, by default on the map of the JEM."""
    graph = stance_graph(grasp_map or jem_map(), settings=Settings(**settings))
    assert isinstance(graph, PairGraph)
    return graph


def case_3() -> tuple[StanceGraph, Plan]:
    """Return graph and plan of Case 3 of the paper's Table I, with collisions checked."""
    setup = default_setup()
    graph, face = case_graph(3, setup, "collisions"), setup["goal_face"]
    found = Planner(graph).plan(setup["start"], setup["goal"], CASES[3].cost, goal_face=face)
    return graph, found.unwrap()
