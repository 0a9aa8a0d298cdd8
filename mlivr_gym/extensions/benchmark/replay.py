"""Check of an entry of the benchmark: its actions are replayed, and what it tells must follow."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

from mlivr_gym.extensions.benchmark.entry import (
    BenchmarkEntry,
    BenchmarkError,
    EpisodeRow,
    results_of,
)
from mlivr_gym.extensions.benchmark.protocol import BUDGETS, TASKS, held_out_tasks
from mlivr_gym.extensions.benchmark.runner import FunctionPolicy
from mlivr_gym.settings import check_rules

TOLERANCE = 1e-6
"""Largest difference between a cost that is told and the replayed one."""


def check(
    folder: str | Path, tasks: int = TASKS, progress: Callable[[int], None] | None = None
) -> BenchmarkEntry:
    """Return the entry in a folder if it adds up.

    Each environment must have the first `tasks` tasks for each seed. Their actions are replayed;
    success, cost, reference and what the summary tells must follow. `progress` is called with the
    number of checked episodes. Raises a `BenchmarkError` that names the first fault.
    """
    entry = BenchmarkEntry.read(folder)
    summary, rows = entry.summary, entry.rows
    check_rules("the entry", summary["graph_rules"], "run it again", BenchmarkError)
    if summary["tasks"] != tasks:
        raise BenchmarkError(f"the entry has {summary['tasks']} tasks; it must have {tasks}")
    seeds = {name: result["seeds"] for name, result in results_of(rows).items()}
    expected = [(name, *at) for name, n in seeds.items() for at in product(range(n), range(tasks))]
    if [row[:3] for row in rows] != expected or not rows:
        raise BenchmarkError(f"the episodes are not those of {tasks} tasks and each seed in turn")
    _same("seeds", summary["seeds"], max(seeds.values()))
    most = max(summary["environment_steps"], default=0)
    if most > BUDGETS[summary["budget"]]:
        raise BenchmarkError(f"it learned from {most} steps, more than {summary['budget']} has")
    for k, row in enumerate(rows):
        _check_row(row)
        if progress is not None:
            progress(k + 1)
    _same("results", summary["results"], results_of(rows))
    return entry


def _check_row(row: EpisodeRow) -> None:
    """Replay an episode; the error names what does not follow."""
    place = f"{row.environment}, seed {row.seed}, task {row.task}: "
    actions = iter(row.actions)
    replay = FunctionPolicy(lambda observation, mask: next(actions))
    try:
        episode, reference = held_out_tasks(row.environment).run(replay, row.task)
    except StopIteration:
        text = f"{place}the episode goes on after its {len(row.actions)} actions"
        raise BenchmarkError(text) from None
    told = {"actions": len(row.actions), "success": row.success, "times": len(row.milliseconds)}
    count = len(episode.actions)
    _same(f"{place}end", told, {"actions": count, "success": episode.success, "times": count})
    for name, told_cost, cost in (
        ("cost", row.cost, -episode.total_reward),
        ("reference", row.reference, reference.cost),
        ("bound", row.bound, reference.bound),
    ):
        if not abs(told_cost - cost) <= TOLERANCE:
            raise BenchmarkError(f"{place}{name} is {told_cost!r}; the replay gives {cost!r}")


def _same(place: str, told: Any, found: Any) -> None:
    """Refuse what is told if it differs from what was found."""
    if told != found:
        raise BenchmarkError(f"{place} is told as {told!r}; the replay gives {found!r}")
