"""Which parts of a query take its time; part of `benchmark_planning.py`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np

from mlivr_gym.planners import planner, table_search
from mlivr_gym.stances.obstacles import ChangingWorld
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

PARTS: dict[str, tuple[Any, str]] = {
    "stances near the change": (ChangingWorld, "_set_obstacles"),
    "lower bounds and labels": (table_search, "cheapest_path"),
    "checks of steps": (TwoLimbGraph, "kept_branches"),
    "branches, angles and swings of the plan": (planner, "committed_motion"),
}
"""Parts of a query, each with the function that does it; all else is arguments and the start."""

OTHER = "arguments and start"


@contextmanager
def measured() -> Iterator[dict[str, float]]:
    """Add up the time spent in each part [s], without the parts that it calls."""
    spent = dict.fromkeys(PARTS, 0.0)
    inner = [0.0]

    def timed(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            inner.append(0.0)
            began = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.perf_counter() - began
                spent[name] += took - inner.pop()
                inner[-1] += took

        return call

    with ExitStack() as stack:
        for name, (owner, attribute) in PARTS.items():
            changed = timed(name, getattr(owner, attribute))
            stack.enter_context(patch.object(owner, attribute, changed))
        yield spent


def time_shares(query: Callable[[], Any]) -> dict[str, float]:
    """Return the time that each part of a query takes [ms]."""
    with measured() as spent:
        began = time.perf_counter()
        query()
        whole = time.perf_counter() - began
    return {name: 1e3 * spent[name] for name in PARTS} | {
        OTHER: 1e3 * (whole - sum(spent.values()))
    }


def medians(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the median time of each part over queries [ms]."""
    return {name: float(np.median([row[name] for row in rows])) for name in rows[0]}
