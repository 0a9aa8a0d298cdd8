"""Report of `benchmark_planning.py`, and the rows of it that README and docs show."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from reports import NOTHING, table

OFF = "collisions off"

BEFORE = {
    "steps, new goal": f"0.91, 1.20 ({OFF})",
    "base, new goal": f"3.30, 90.1 ({OFF})",
    "steps, known goal": f"1.41, 1.80 ({OFF})",
    "base, known goal": f"1.64, 2.00 ({OFF})",
    "base, exact cost-to-go": f"0.90 ({OFF})",
    "base, prepare": "14.0",
    "points": "2.45, 2.73",
    "box": "66.5, 123.5",
    "compiled": "41.4",
    "again": "1.74",
    "one environment": "45,900 (all steps known)",
    "copies": "730,000 (1024 sub-environments)",
}
"""Speed of version 0.1.0 as published by its benchmarks, in `results/` of commit 2f4e2068; steps
per second of commit 3fb4419c. Measured on two cores of an AMD EPYC, Python 3.11.7, Numba 0.68.1."""

COSTS = {"steps": "the fewest steps", "base": "least translation"}
"""Costs, and what their plans minimise."""


Figure = tuple[str, str, str, str]
"""Name, target, measured value and value of version 0.1.0, as a row of the table of speeds."""


def figures(data: dict[str, Any]) -> Iterator[Figure]:
    """Yield the speeds with default settings, collisions on, on the table that ships."""

    def row(what: str, key: str, found: dict[str, Any] | None, target: str, unit: str) -> Figure:
        """Return the row of a time; for times in seconds it states only the median."""
        measured = NOTHING
        if found is not None:
            times = [found["median"] / 1e3] if unit == "s" else [found["median"], found["p95"]]
            measured = ", ".join(f"{float(f'{time:.3g}'):,g}" for time in times)
        words = f"{what} [s]" if unit == "s" else f"{what}, median and 95 % [ms]"
        return words, target, measured, BEFORE.get(key, NOTHING)

    found = {cost: data["collisions on"].get(cost, {}) for cost in COSTS}
    for name, target in (("new goal", "3, 30"), ("known goal", "0.5")):
        for cost, words in COSTS.items():
            key = f"{cost}, {name}"
            yield row(f"plan with {words}, {name}", key, found[cost].get(name), target, "ms")
    base = found["base"]
    cut_off = base.get("unreachable goal")
    yield row("answer that there is no plan", "", cut_off, "3, 30", "ms")
    exact, prepared = base.get("exact cost-to-go"), base.get("prepare")
    yield row("exact cost-to-go of a new goal", "base, exact cost-to-go", exact, "0.3", "s")
    yield row("`Planner.prepare`", "base, prepare", prepared, "1", "s")
    changes = {"points": ("ten points newly occupied", "1"), "box": ("a new box", "40")}
    for name, (words, target) in changes.items():
        yield row(f"new plan after {words}", name, data["replanning"].get(name), target, "ms")


def library_times(data: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield name and median [ms] of A* in the graph libraries on the same tasks."""
    for name, row in data["libraries"].items():
        if name != "this planner":
            yield f"A* of {name} on the same table, median [ms]", f"{row['A*']['median']:.3g}"


def targets(data: dict[str, Any]) -> str:
    """Return the table of targets, measured values and values of version 0.1.0."""
    rows = list(figures(data))
    rows += [(words, NOTHING, measured, NOTHING) for words, measured in library_times(data)]
    return table("default settings | target | measured | version 0.1.0", rows)


def series(data: dict[str, Any]) -> Iterator[list[Any]]:
    """Yield the table rows of all series of queries."""
    for collisions in ("on", "off"):
        for cost, found in data.get(f"collisions {collisions}", {}).items():
            for name, row in found.items():
                more = [
                    f"{row['search']:.2f}", f"{row['expanded']:.0f}", row["unsolved"]
                ] if "search" in row else [NOTHING] * 3  # fmt: skip
                yield [
                    collisions, cost, name, row["count"],
                    f"{row['median']:.2f}", f"{row['p95']:.2f}", *more,
                ]  # fmt: skip


def library_rows(data: dict[str, Any]) -> Iterator[list[str]]:
    """Yield the table rows of this planner and of both libraries."""
    for program, row in data["libraries"].items():
        for method in ("A*", "A*, consistent", "Dijkstra"):
            if method in row:
                build = [f"{row['build']:.1f}", f"{row['memory']:.0f}"] if "build" in row else []
                cost = f"{row['lower']} | {row['higher']}" if build else f"{NOTHING} | {NOTHING}"
                words = [f"{row[method][figure]:.1f}" for figure in ("median", "p95")]
                yield [program, method, *words, *(build or [NOTHING] * 2), cost]


SERIES = "collisions | cost | series | queries | median | 95 % | search | expanded | without a plan"
LIBRARIES = "program | method | median | 95 % | build [s] | memory [MB] | lower | higher"
"""Heads of the tables."""


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    host, known = data["machine"], data["table"]
    packages = ", ".join(f"{name} {number}" for name, number in host["packages"].items())
    return f"""# Planning benchmark

{host["processor"]}, {host["cores"]} cores, Python {host["python"]}, {packages}.

Two limbs, collisions on, the table that ships: {known["stances"]} stances and {known["steps"]} \
valid steps, {known["memory"]:.0f} MB in memory. Two figures are \
median and 95th percentile. Values of version 0.1.0 were measured on two cores of an AMD EPYC, \
Python 3.11.7, Numba 0.68.1, its queries with collisions off; a dash marks what it did not measure.

{targets(data)}
## Queries

Each goal is new to the planner unless the series is called *known goal*; unreachable goals are
drawn in the cabin. *Search* is the part of the median without start and motion. Replanning after
changes of the world has a prepared goal. Times in ms.

{table(SERIES, series(data))}
## The same table in graph libraries

The same tasks in the same run, base cost: nodes are the stances, edges the valid steps, the goal a
virtual node joined to every goal stance. A* of the libraries has the consistent heuristic. They
have no labels for branches, so their paths may cost less than any executable walk (*lower*).
Attaching the goal is not timed; for this planner the whole call is timed, including the motion of
the plan. Times in ms.

{table(LIBRARIES, library_rows(data))}"""
