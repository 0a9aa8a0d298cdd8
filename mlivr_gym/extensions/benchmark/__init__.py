"""A benchmark with held-out tasks, known optima, budgets and one score; see `docs/benchmark.md`."""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.extensions.benchmark.entry import BenchmarkEntry, markdown_table
    from mlivr_gym.extensions.benchmark.protocol import TrainingEnv
    from mlivr_gym.extensions.benchmark.runner import check, run

__all__ = ["BenchmarkEntry", "TrainingEnv", "check", "markdown_table", "run"]

COMMANDS = {
    "benchmark": (
        "run a policy on the held-out tasks, check entries, or list them in a table",
        "mlivr-gym benchmark run --policy my_module:act --budget planner --out my_entry",
        "mlivr-gym benchmark check my_entry",
        "mlivr-gym benchmark table my_entry benchmark/greedy",
    ),
}

__getattr__, __dir__ = lazy(__name__)
