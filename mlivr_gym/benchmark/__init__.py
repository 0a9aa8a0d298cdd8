"""A benchmark with held-out tasks, known optima, budgets and one score; see `docs/benchmark.md`."""

from mlivr_gym.benchmark.check import check
from mlivr_gym.benchmark.entry import BenchmarkError, Entry
from mlivr_gym.benchmark.protocol import BUDGETS, ENVIRONMENTS, TrainingEnv
from mlivr_gym.benchmark.run import run
from mlivr_gym.benchmark.table import markdown_table

__all__ = [
    "BUDGETS",
    "ENVIRONMENTS",
    "BenchmarkError",
    "Entry",
    "TrainingEnv",
    "check",
    "markdown_table",
    "run",
]
