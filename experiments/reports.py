"""Shared parts of the experiments: command line, tables, result files, timing, studies, graphs."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from mlivr_gym import GraspMap, Settings, jem_map, stance_graph
from mlivr_gym.envs import Task, sample_task
from mlivr_gym.extensions.studies import Row, StudyDesign, read_study, run_study
from mlivr_gym.files import write_whole
from mlivr_gym.paper import CASES, case_graph, default_setup
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.stances import StanceGraph

ROOT = Path(__file__).parent.parent
"""Root folder of the repository."""

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)
"""Start and goal of the plan of the README, which several figures show."""

NOTHING = "\N{EN DASH}"
"""Content of a table cell without a value."""


def command_line(
    description: str | None, out: str | None = "results", **options: Any
) -> argparse.ArgumentParser:
    """Return a parser with options, whose defaults are given, and with `--out` unless it is None.

    `description` is the docstring of the script.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    text = "(default: %(default)s)"
    if out is not None:
        parser.add_argument("--out", type=Path, default=Path(out), help=f"folder {text}")
    for option, default in options.items():
        parser.add_argument(f"--{option}", type=type(default), default=default, help=text)
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


finished_studies: list[Path] | None = None
"""Folders of the studies that an experiment has finished, for it may yet be interrupted; None
outside of one."""


def experiment(
    name: str,
    description: str | None,
    measure: Callable[..., Any],
    markdown: Callable[[Any], str] | None = None,
    draw: Callable[[Any, Path], Any] | None = None,
    indent: int | None = 1,
    **options: Any,
) -> None:
    """Measure, and write the results as JSON, the page and the figure.

    `measure` is called with the options of the command line, whose defaults are `options`, and
    returns the results. `markdown` makes the page of the results; without it, `readme.py` shows
    them. `draw` draws the figure to a file. `description` is the docstring of the script, and
    `indent` the indent of the JSON file. With `--report`, the page and the figure of the stored
    results are written.
    """
    parser = command_line(description, **options)
    parser.add_argument("--report", action="store_true", help="only write page and figure")
    given = vars(parser.parse_args())
    out, report = given.pop("out"), given.pop("report")
    global finished_studies
    finished_studies = []
    data = read(out, name) if report else measure(**given)
    if not report:
        keep(out, name, data, indent)
    for folder in finished_studies:
        shutil.rmtree(folder, ignore_errors=True)
    finished_studies = None
    if markdown is not None:
        write_whole(out / f"{name}.md", markdown(data))
        print(markdown(data))
    if draw is not None:
        draw(data, out / f"{name}.png")


CORES = os.cpu_count() or 1
"""Number of processor cores, which is the default number of processes."""


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return the duration of a call [s] and its value."""
    start = time.perf_counter()
    value = call()
    return time.perf_counter() - start, value


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Return the median and the 95th percentile of durations [ms], and their number."""
    median, p95 = 1e3 * np.percentile(seconds, (50, 95))
    return {"median": float(median), "p95": float(p95), "count": len(seconds)}


def study_rows(
    kind: str, tasks: int, workers: int | Executor, **factors: Sequence[Any]
) -> list[Row]:
    """Return the rows of a study, which goes on where it was interrupted.

    `kind` names a function as `"script:function"`; it is called with the number of a task and a
    level of each factor. `workers` is the number of processes, or an executor. The folder
    `runs/studies` holds the rows of studies until the experiment to which they belong is finished.
    """
    name = kind.partition(":")[2]
    design = StudyDesign.from_data(
        {"kind": kind, "tasks": tasks, "factors": {key: list(one) for key, one in factors.items()}}
    )
    digest = hashlib.sha256(json.dumps(design.to_data()).encode()).hexdigest()[:8]
    folder = ROOT / "runs" / "studies" / f"{name}-{digest}"
    with tqdm(desc=name, mininterval=5.0) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        given: Any = {"engine" if isinstance(workers, Executor) else "workers": workers}
        run_study(design, folder, progress=progress, **given)
    rows = read_study(folder)
    faults = [row["error"] for row in rows if row["error"]]
    if faults or finished_studies is None:
        shutil.rmtree(folder)
    else:
        finished_studies.append(folder)
    if faults:
        raise SystemExit(f"{len(faults)} of {len(rows)} runs failed: {faults[0]}")
    return rows


def figures_of(row: Row, *factors: str) -> Row:
    """Return what a run measured, without its numbers, its error and some of its factors."""
    return {k: v for k, v in row.items() if k not in ("run", "task", "error", *factors)}


def by_level(rows: list[Row], factor: str) -> dict[str, Row]:
    """Return what was measured at each level of a factor, which one row has each."""
    return {row[factor]: figures_of(row, factor) for row in rows}


def with_interval(
    value: float, interval: Sequence[float], digits: int = 0, percent: bool = True
) -> str:
    """Return a value with its interval, by default a share as a percentage."""
    scale, unit = (100.0, " %") if percent else (1.0, "")
    middle, low, high = (f"{scale * one:.{digits}f}" for one in (value, *interval))
    return f"{middle}{unit} [{low}, {high}]"


def two_limb_graph(grasp_map: GraspMap | None = None, **settings: Any) -> StanceGraph:
    """Return the stance graph of two limbs, by default on the map of the JEM."""
    return stance_graph(grasp_map or jem_map(), settings=Settings(**settings))


@cache
def graph_and_tasks(count: int, seed: int, **settings: Any) -> tuple[StanceGraph, list[Task]]:
    """Return the graph of two limbs in the JEM, and random tasks on it, once for each process."""
    graph, rng = two_limb_graph(**settings), np.random.default_rng(seed)
    return graph, [sample_task(graph, rng, 0.2) for _ in range(count)]


def case_3() -> tuple[StanceGraph, Plan]:
    """Return graph and plan of Case 3 of the paper's Table I, with collisions checked."""
    setup = default_setup()
    graph, face = case_graph(3, setup, "collisions"), setup["goal_face"]
    found = Planner(graph).plan(setup["start"], setup["goal"], CASES[3].cost, goal_face=face)
    return graph, found.unwrap()
