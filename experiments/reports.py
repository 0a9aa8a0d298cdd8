"""Shared parts of the experiments: command line, tables, result files, timing, workers, graphs."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from mlivr_gym import GraspMap, Settings, jem_map, stance_graph
from mlivr_gym.files import write_whole
from mlivr_gym.paper import CASES, case_graph, default_setup
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

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


def write_assets(files: dict[str, Callable[[], dict[str, Any]]]) -> None:
    """Write the files that ship of maps and robots, by name and by what makes them."""
    for name, make in files.items():
        text = json.dumps(make(), indent=1) + "\n"
        write_whole(ROOT / "envs_assets" / f"{name}.json", text)


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


class Processes(NamedTuple):
    """A number of worker processes, and a folder in which their results are stored."""

    workers: int
    """Number of processes."""
    keep: Path | None = None
    """Folder with one file of results for each study; they are valid for the code that made
    them."""

    def answers(self, work: Callable[[int], Any], seeds: range, what: str) -> Iterator[Any]:
        """Yield the results for all seeds in order, as plain data.

        Stored results are not computed again. `work` is called with a seed and may use global data
        that exist before the processes are forked. `what` is the name of the study and of its file.
        """
        path = None if self.keep is None else self.keep / f"{what.replace(' ', '_')}.jsonl"
        known: dict[int, Any] = {}
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            for line in path.read_text().splitlines() if path.exists() else ():
                seed, answer = json.loads(line)
                known[seed] = answer
        todo = [seed for seed in seeds if seed not in known]
        with ProcessPoolExecutor(self.workers, mp_context=get_context("fork")) as pool:
            done = pool.map(work, todo, chunksize=1)
            for seed in tqdm(seeds, desc=what, mininterval=5.0):
                if seed not in known:
                    line = json.dumps([seed, next(done)])
                    known[seed] = json.loads(line)[1]
                    if path is not None:
                        with path.open("a", encoding="utf-8") as file:
                            file.write(line + "\n")
                yield known[seed]


def two_limb_graph(grasp_map: GraspMap | None = None, **settings: Any) -> TwoLimbGraph:
    """Return the stance graph of two limbs, by default on the map of the JEM."""
    graph = stance_graph(grasp_map or jem_map(), settings=Settings(**settings))
    assert isinstance(graph, TwoLimbGraph)
    return graph


def case_3() -> tuple[StanceGraph, Plan]:
    """Return graph and plan of Case 3 of the paper's Table I, with collisions checked."""
    setup = default_setup()
    graph, face = case_graph(3, setup, "collisions"), setup["goal_face"]
    found = Planner(graph).plan(setup["start"], setup["goal"], CASES[3].cost, goal_face=face)
    return graph, found.unwrap()
