"""The command `mlivr-gym benchmark`."""

from __future__ import annotations

import argparse
from pathlib import Path

from mlivr_gym.cli.arguments import option, refuse_without_effect
from mlivr_gym.cli.outputs import check_outputs
from mlivr_gym.cli.progress import Progress
from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.benchmark.entry import (
    EPISODES,
    PICTURE,
    SUMMARY,
    BenchmarkEntry,
    markdown_table,
)
from mlivr_gym.extensions.benchmark.protocol import BUDGETS, ENVIRONMENT_IDS, TASKS
from mlivr_gym.extensions.benchmark.runner import check
from mlivr_gym.extensions.benchmark.runner import run as run_policy
from mlivr_gym.schema import Choice, Integer

OF_RUN = ("policy", "budget", "seeds", "environment", "tasks", "out")
"""Options of `run` alone."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    parser.add_argument("action", choices=("run", "check", "table"), metavar="run|check|table")
    parser.add_argument("folders", nargs="*", metavar="DIR", help="entries to check or to list")
    text = "run: function of observation and mask, or class, as MODULE:NAME"
    option(parser, "--policy POLICY", text)
    text = "run: environment steps from which it may learn, or planner for one that does not learn"
    option(parser, "--budget BUDGET", text, valid=Choice(tuple(BUDGETS)))
    text = "run: number of training seeds (default: 3, or 1 for a policy that is not trained)"
    option(parser, "--seeds N", text, valid=Integer(1, 100))
    text = "run: the only environment (default: all of the benchmark)"
    option(parser, "--environment ID", text, valid=Choice(ENVIRONMENT_IDS))
    text = f"run: number of tasks of each environment, for a trial (default: {TASKS})"
    option(parser, "--tasks N", text, valid=Integer(1, TASKS))
    option(parser, "--out DIR", "run: folder of the entry")


def run(args: argparse.Namespace) -> None:
    """Run a policy through the benchmark, check entries, or list them in a table.

    `run` trains or loads a policy, evaluates it on the 200 held-out tasks of each environment, and
    writes summary.json, episodes.csv and scores.png. It does so after each environment and seed,
    and goes on with the entry that is in the folder. `check` replays the actions of entries and
    refuses those that do not add up. `table` prints the Markdown table of entries.
    """
    if args.action == "run":
        _run(args)
        return
    refuse_without_effect(args, f"with {args.action}", *OF_RUN)
    if not args.folders:
        raise SettingError(f"{args.action} needs the folder of an entry")
    if args.action == "table":
        args.result["table"] = markdown_table(
            {Path(f).name: BenchmarkEntry.read(f) for f in args.folders}
        )
        print(args.result["table"], end="")
        return
    for folder in args.folders:
        with Progress(f"episodes of {folder}", quiet=args.quiet) as progress:
            entry = check(folder, progress=progress.show)
        args.result[folder] = entry.summary["results"]
        print(f"{folder}: {len(entry.rows)} episodes add up")


def _run(args: argparse.Namespace) -> None:
    """Run a policy through the benchmark."""
    if args.folders:
        raise SettingError("run takes no folders; give the folder of the entry with --out")
    missing = [f"--{name}" for name in ("policy", "budget", "out") if getattr(args, name) is None]
    if missing:
        raise SettingError(f"run needs {', '.join(missing)}")
    folder = Path(args.out)
    files = [folder / name for name in (SUMMARY, EPISODES, PICTURE)]
    entry = BenchmarkEntry.read(folder) if files[0].exists() else None
    if entry is None:
        check_outputs(*files, folder=folder)
    names = ENVIRONMENT_IDS if args.environment is None else (args.environment,)
    with Progress("episodes", quiet=args.quiet) as progress:
        entry = run_policy(
            args.policy, args.budget, args.seeds, names, args.tasks or TASKS,
            entry=entry, save=lambda entry: entry.write(folder), progress=progress.show,
        )  # fmt: skip
    args.result |= {"folder": folder, "results": entry.summary["results"]}
    for name, result in entry.summary["results"].items():
        print(f"{name}: score {result['score']:.3f}, success {100 * result['success']:.0f} %")
    print(f"entry: {folder}")
