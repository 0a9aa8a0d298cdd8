"""An entry of the benchmark: every episode of a policy, what follows from them, and the table.

It is a folder with `summary.json`, `episodes.csv` and the picture `scores.png`.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import NOT_NEGATIVE
from mlivr_gym.errors import MlivrError
from mlivr_gym.extensions.benchmark.protocol import BUDGETS, ENVIRONMENT_IDS, MAX_ACTIONS
from mlivr_gym.files import make_folder, read_json, write_whole, written_together
from mlivr_gym.pictures import new_figure, save_figure
from mlivr_gym.schema import NAME, Anything, Choice, FieldPath, Fields, Integer, ListOf

SUMMARY, EPISODES, PICTURE = "summary.json", "episodes.csv", "scores.png"
"""Names of the files."""

SUMMARY_FIELDS = Fields(
    {
        "policy": NAME,
        "budget": Choice(tuple(BUDGETS)),
        "uses": Choice(("observation", "environment")),
        "seeds": Integer(1, 1000),
        "tasks": Integer(1, 1_000_000),
        "graph_rules": Anything(),
        "environment_steps": ListOf(Integer(0, 1 << 62)),
        "processor_seconds": ListOf(NOT_NEGATIVE),
        "versions": Anything(),
        "machine": Anything(),
        "results": Anything(),
    }
)
"""Validator of a summary, with the largest number of seeds; `results` has each environment's."""


class BenchmarkError(MlivrError):
    """An entry of the benchmark cannot be read, or does not add up."""


class EpisodeRow(NamedTuple):
    """One episode."""

    environment: str
    """Id of the environment."""
    seed: int
    """Seed of the training."""
    task: int
    """Number of the fixed task."""
    success: bool
    """Whether the goal was reached."""
    cost: float
    """Cost of the actions under the reward of the environment."""
    reference: float
    """Cost of the best plan known."""
    bound: float
    """Proved: no actions cost less than `reference / bound`."""
    actions: tuple[int, ...]
    """The actions."""
    milliseconds: tuple[float, ...]
    """Time in which each was chosen [ms], rounded to microseconds."""

    @property
    def score(self) -> float:
        """Success times reference over cost."""
        return self.reference / self.cost if self.success else 0.0


BY_SEED = "environment_steps", "processor_seconds"
"""What a summary has for each environment and seed."""


@dataclass(frozen=True)
class BenchmarkEntry:
    """An entry: its episodes, and what they were made with."""

    summary: dict[str, Any]
    """What `summary.json` has, see `SUMMARY_FIELDS`."""
    rows: tuple[EpisodeRow, ...]
    """The episodes, by environment, seed and task."""

    def write(self, folder: str | Path) -> None:
        """Write the files of the entry into a folder, which is made if it is missing."""
        make_folder(folder)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(EpisodeRow._fields)
        for row in self.rows:
            *simple, actions, times = row
            chosen = " ".join(map(str, actions)), " ".join(f"{t:.3f}" for t in times)
            writer.writerow((*simple, *chosen))
        with written_together():
            write_whole(Path(folder, SUMMARY), json.dumps(self.summary, indent=1) + "\n")
            write_whole(Path(folder, EPISODES), text.getvalue())
            save_figure(score_figure(self.rows), Path(folder, PICTURE), vector=False)

    @property
    def parts(self) -> dict[tuple[str, int], tuple[int, float]]:
        """Environment steps and processor time [s] of each environment and seed, by both."""
        costs = zip(*(self.summary[name] for name in BY_SEED), strict=True)
        return dict(zip(_parts(self.rows), costs, strict=True))

    def with_part(self, rows: Sequence[EpisodeRow], steps: int, seconds: float) -> BenchmarkEntry:
        """Return this entry with the episodes of one more environment and seed, and their costs."""
        every = (*self.rows, *rows)
        every = tuple(sorted(every, key=lambda row: (ENVIRONMENT_IDS.index(row[0]), *row[1:3])))
        known = self.parts | dict.fromkeys(_parts(rows), (steps, seconds))
        costs = zip(*(known[part] for part in _parts(every)), strict=True)
        more: dict[str, Any] = dict(zip(BY_SEED, map(list, costs), strict=True))
        more |= {"seeds": max(row.seed for row in every) + 1, "results": results_of(every)}
        return BenchmarkEntry(self.summary | more, every)

    @classmethod
    def read(cls, folder: str | Path) -> BenchmarkEntry:
        """Return the entry in a folder; the `BenchmarkError` names what cannot be read."""
        file = Path(folder, SUMMARY)
        place = FieldPath("", BenchmarkError)
        summary = SUMMARY_FIELDS.read(read_json(file, "summary", BenchmarkError), place)
        episodes = Path(folder, EPISODES)
        try:
            with open(episodes, encoding="utf-8", newline="") as stream:
                rows = tuple(map(_row_of, csv.DictReader(stream)))
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise BenchmarkError(f"cannot read {str(episodes)!r}: {error!r}") from None
        return cls(summary, rows)


def _parts(rows: Sequence[EpisodeRow]) -> list[tuple[str, int]]:
    """Return the environments and seeds of episodes in their order."""
    return list(dict.fromkeys((row.environment, row.seed) for row in rows))


COLUMNS: tuple[Callable[[str], Any], ...] = (
    str, int, int, {"True": True, "False": False}.__getitem__, float, float, float,
    lambda text: tuple(map(int, text.split())), lambda text: tuple(map(float, text.split())),
)  # fmt: skip
"""How each column of `EpisodeRow` is read."""


def _row_of(fields: dict[str, str]) -> EpisodeRow:
    """Return the episode of a line; a `ValueError` or `KeyError` if it is not one."""
    read = zip(COLUMNS, EpisodeRow._fields, strict=True)
    return EpisodeRow(*(column(fields[name]) for column, name in read))


def results_of(rows: Sequence[EpisodeRow]) -> dict[str, Any]:
    """Return for each environment what is reported: means over its tasks, by seed."""
    results = {}
    for name in ENVIRONMENT_IDS:
        episodes = [row for row in rows if row.environment == name]
        if not episodes:
            continue
        seeds = sorted({row.seed for row in episodes})
        scores = [np.mean([row.score for row in episodes if row.seed == seed]) for seed in seeds]
        times = [t for row in episodes for t in row.milliseconds]
        results[name] = {
            "seeds": len(seeds),
            "score": round(float(np.mean(scores)), 6),
            "score_percentiles": np.percentile(scores, (2.5, 97.5)).round(6).tolist(),
            "success": round(float(np.mean([row.success for row in episodes])), 6),
            "references_proved": round(float(np.mean([row.bound == 1.0 for row in episodes])), 6),
            "milliseconds_a_task": round(sum(times) / len(episodes), 3),
        }
    return results


def score_figure(rows: Sequence[EpisodeRow]) -> Any:
    """Return a figure of the share of tasks by score, a line for each environment."""
    figure = new_figure(6.0, 3.6)
    axes = figure.add_subplot()
    for name in ENVIRONMENT_IDS:
        scores = np.sort([row.score for row in rows if row.environment == name])[::-1]
        if len(scores):
            share = 100.0 * np.arange(1, len(scores) + 1) / len(scores)
            axes.step(share, scores, where="pre", label=f"{name}: {scores.mean():.3f}")
    axes.set(xlim=(0, 100), ylim=(0, 1.02), xlabel="tasks [%]")
    axes.set_ylabel(f"reference / cost (0: not in {MAX_ACTIONS} actions)")
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, loc="lower left")
    figure.set_layout_engine("constrained")
    return figure


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
        cells = [_score(results[env]) if env in results else "" for env in ENVIRONMENT_IDS]
        score = sum(one["score"] for one in results.values()) / len(ENVIRONMENT_IDS)
        time = np.mean([one["milliseconds_a_task"] for one in results.values()])
        steps, seconds = max(told["environment_steps"]), np.mean(told["processor_seconds"])
        budget = told["budget"] if told["budget"] == "planner" else f"MLIVR-{told['budget']}"
        spent = f"{time:.3g}", f"{steps:,}", f"{seconds:.3g}"
        rows.append((score, [name, budget, told["uses"], *cells, *spent]))
    rows.sort(key=lambda row: -row[0])
    lines = [head, ["---"] * len(head), *(cells for _, cells in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _score(result: Mapping[str, Any]) -> str:
    """Return the cell of an environment."""
    low, high = result["score_percentiles"]
    interval = f" [{low:.3f}, {high:.3f}]" if result["seeds"] > 1 else ""
    return f"{result['score']:.3f}{interval} ({100 * result['success']:.0f} %)"
