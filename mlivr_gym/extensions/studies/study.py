"""The command `mlivr-gym study`: many runs over robots, maps, settings and tasks."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from importlib.machinery import PathFinder
from pathlib import Path
from statistics import fmean, median
from typing import Any

from mlivr_gym.cli.arguments import THREADS, option, refuse_without_effect
from mlivr_gym.cli.outputs import check_outputs
from mlivr_gym.cli.progress import Progress
from mlivr_gym.compiled.cache import PACKAGE
from mlivr_gym.engines import ENGINES
from mlivr_gym.extensions.studies.design import StudyDesign, is_function
from mlivr_gym.extensions.studies.rows import succeeded
from mlivr_gym.extensions.studies.run import read_study, run_study
from mlivr_gym.schema import Choice


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    parser.add_argument("file", metavar="STUDY.toml", help="design of the study")
    option(parser, "--out FOLDER", "folder of the study (default: the name of the file)")
    text = "what computes the runs: processes of this machine, or Dask"
    option(parser, "--engine ENGINE", text, "local", Choice(ENGINES))
    text = "number of processes (default: one for each core)"
    option(parser, "--workers N", text, valid=THREADS)
    text = "address of a running Dask scheduler (default: one is started on this machine)"
    option(parser, "--scheduler ADDRESS", text)


def run(args: argparse.Namespace) -> None:
    """Run a study.

    A study consists of all combinations of the levels of some factors, such as robots, maps and
    thresholds, each with random tasks. The design is read from a TOML file. Results go to
    FOLDER/study.parquet, with one row for each run. If the command is interrupted, run it again to
    continue.
    """
    if args.engine == "local":
        refuse_without_effect(args, "with --engine local", "scheduler")
    if args.scheduler is not None:
        refuse_without_effect(args, "with --scheduler", "workers")
    design = StudyDesign.from_file(args.file)
    if is_function(design.kind):
        # Last, so that no file beside a study hides an installed module of its name.
        if PathFinder.find_spec("mlivr_gym") is None:  # installed for editing, and found after it
            sys.path.append(str(PACKAGE.parent))
        sys.path.append(str(Path(args.file).resolve().parent))
    folder = Path(args.out or Path(args.file).with_suffix(""))
    check_outputs(folder=folder)
    total = len(design.combinations) * design.tasks
    with Progress("runs", total, args.quiet) as progress:
        file = run_study(
            design, folder, args.engine,
            workers=args.workers,
            scheduler=args.scheduler,
            progress=lambda done, total: progress.show(done),
            notify=lambda address: print(f"dashboard: {address}", file=sys.stderr, flush=True),
        )  # fmt: skip
    found = list(combination_means(design, read_study(folder)))
    args.result |= {"file": file, "runs": total, "combinations": found}
    for means in found:
        levels = ", ".join(f"{name} {level}" for name, level in means["levels"].items())
        steps = "" if means["mean_steps"] is None else f", {means['mean_steps']:.2f} steps"
        failed = f", {means['errors']} refused ({means['error']})" if means["errors"] else ""
        print(
            f"{levels or design.kind}: {means['successes']} of {means['runs']}{steps}, "
            f"median {means['median_seconds']:.3g} s{failed}"
        )
    print(f"results: {file}")


def combination_means(design: StudyDesign, rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield counts and means of the runs of each combination of levels."""
    for k, levels in enumerate(design.combinations):
        runs = rows[k * design.tasks : (k + 1) * design.tasks]
        steps = [row["steps"] for row in runs if row.get("steps") is not None]
        seconds = [row["seconds"] for row in runs if row.get("seconds") is not None]
        errors = [row["error"] for row in runs if row["error"]]
        yield {
            "levels": {name: levels[name] for name in design.factors},
            "runs": len(runs),
            "successes": sum(succeeded(row) for row in runs),
            "mean_steps": fmean(steps) if steps else None,
            "median_seconds": median(seconds) if seconds else 0.0,
            "errors": len(errors),
            "error": errors[0] if errors else "",
        }
