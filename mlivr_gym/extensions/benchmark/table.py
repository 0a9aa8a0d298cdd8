"""The table of the benchmark's entries in Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mlivr_gym.extensions.benchmark.entry import BenchmarkEntry
from mlivr_gym.extensions.benchmark.protocol import ENVIRONMENT_IDS


def markdown_table(entries: Mapping[str, BenchmarkEntry]) -> str:
    """Return a table of entries by name, the best mean score first.

    For each environment it has the score, with percentiles over seeds if there are several, and the
    success; then the time a task, and steps and processor time of an environment and seed.
    """
    costs = "time a task [ms]", "steps", "processor [s]"
    head = ["entry", "budget", "uses", *ENVIRONMENT_IDS, *costs]
    rows = []
    for name, entry in entries.items():
        told, results = entry.summary, entry.summary["results"]
        cells, scores, times = [], [], []
        for env in ENVIRONMENT_IDS:
            one = results.get(env)
            cells.append("" if one is None else _score(one))
            if one is not None:
                scores.append(one["score"])
                times.append(one["milliseconds_a_task"])
        mean = sum(scores) / len(ENVIRONMENT_IDS)
        time = f"{sum(times) / max(len(times), 1):.3g}"
        steps = f"{max(told['environment_steps'], default=0):,}"
        seconds = told["processor_seconds"]
        spent = f"{sum(seconds) / max(len(seconds), 1):.3g}"
        budget = told["budget"] if told["budget"] == "planner" else f"MLIVR-{told['budget']}"
        rows.append((mean, [name, budget, told["uses"], *cells, time, steps, spent]))
    rows.sort(key=lambda row: -row[0])
    lines = [head, ["---"] * len(head), *(cells for _, cells in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _score(result: Mapping[str, Any]) -> str:
    """Return the cell of an environment."""
    low, high = result["score_percentiles"]
    interval = f" [{low:.3f}, {high:.3f}]" if result["seeds"] > 1 else ""
    return f"{result['score']:.3f}{interval} ({100 * result['success']:.0f} %)"
