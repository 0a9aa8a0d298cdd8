"""Measure how long planning takes, and compare it with networkx and rustworkx.

    python experiments/benchmark_planning.py [--out results] [--queries 200]

All series run in one process on the table of nodes and edges that ships: plans to new, known and
unreachable goals, replanning after changes of the world, and the same table in graph libraries.
Writes `benchmark_planning.json` and `benchmark_planning.md` in about four minutes.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from graph_libraries import LIBRARIES
from reports import NOTHING, experiment, spread, table, timed, two_limb_graph

from mlivr_gym import Box, State
from mlivr_gym.arrays import Array
from mlivr_gym.envs import sample_task
from mlivr_gym.paper import default_setup
from mlivr_gym.planners import Cost, Planner, PlanningResult, SearchOptions
from mlivr_gym.planners.query import DEFAULT_OPTIONS
from mlivr_gym.stances import StanceGraph

COSTS = {"steps": "the fewest steps", "base": "least translation"}
"""Costs, and what their plans minimise."""

GOALS, STARTS = 16, 5
"""Number of known goals, as many as a planner remembers, and of starts for each."""

CHANGES = 50
"""Number of changes of the world of each kind, after each of which a plan is made."""

LIBRARY_QUERIES = 10

TOLERANCE = 0.2
"""Radius of the goal region [m]."""

Task = tuple[State, Array]


def resident() -> float:
    """Return the resident memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def machine() -> dict[str, Any]:
    """Return processor, cores and versions of the packages."""
    info = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    models = [line.split(":", 1)[1].strip() for line in info if line.startswith("model name")]
    packages = ("numpy", "scipy", "numba", "networkx", "rustworkx")
    return {
        "processor": models[0] if models else platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "packages": {name: version(name) for name in packages},
    }


def query_times(
    planner: Planner, tasks: Iterable[Task], cost: str, options: SearchOptions = DEFAULT_OPTIONS
) -> dict[str, Any]:
    """Time `Planner.plan` and its search over queries; count expansions and missing plans."""
    whole, results = [], []
    for start, goal in tasks:
        seconds, result = timed(partial(planner.plan, start.stance, goal, cost, options=options))
        whole.append(seconds)
        results.append(result)
    return spread(whole) | {
        "search": spread([result.search_time for result in results])["median"],
        "expanded": float(np.median([result.expanded for result in results])),
        "unsolved": sum(result.plan is None for result in results),
    }


def out_of_reach(graph: StanceGraph, rng: np.random.Generator) -> Iterator[Task]:
    """Yield random starts with goals in the cabin that no walk from them reaches."""
    low, high = graph.base_position.min(axis=0), graph.base_position.max(axis=0)
    while True:
        start, goal = sample_task(graph, rng, TOLERANCE).start, rng.uniform(low, high)
        if not Planner(graph).plan(start.stance, goal, "steps"):
            yield start, goal


def query_series(graph: StanceGraph, tasks: Sequence[Task], cost: str) -> dict[str, Any]:
    """Measure new goals, known goals and unreachable goals."""
    cut_off = list(islice(out_of_reach(graph, np.random.default_rng(0)), len(tasks) // 2))
    knowing, goals = Planner(graph), [goal for _, goal in tasks[:GOALS]]
    for start, goal in tasks[:GOALS]:
        knowing.plan(start.stance, goal, cost)
    known = [(start, goal) for goal in goals for start, _ in tasks[-STARTS:]]
    exact = [timed(partial(Planner(graph).cost_to_go, goal, cost))[0] for goal in goals]
    return {
        "new goal": query_times(Planner(graph), tasks, cost),
        "known goal": query_times(knowing, known, cost),
        "unreachable goal": query_times(Planner(graph), cut_off, cost),
        "exact cost-to-go": spread(exact),
    }


def changes(
    planner: Planner, start: tuple[str, ...], goal: Array, kind: str, count: int
) -> Iterator[tuple[list[str], list[Box]]]:
    """Yield points that become occupied, five of them on the plan, or a box in its way."""
    rng = np.random.default_rng(0)
    free, ids = planner.plan(start, goal).unwrap(), planner.graph.grasp_map.ids
    used = sorted({point for stance in free.stances for point in stance} - set(start))
    others = [point for point in ids if point not in used and point not in start]
    for _ in range(count):
        if kind == "points":
            few = rng.choice(used, min(5, len(used)), replace=False).tolist()
            yield [*few, *rng.choice(others, 10 - len(few), replace=False).tolist()], []
        else:
            middle = 0.5 * (free.motion.base_positions[0, 0] + goal[0])
            x, z = middle + rng.uniform(-0.6, 0.6), rng.choice([-1.0, 0.2])
            yield [], [Box.between("box", "obstacle", (x, -1.0, z), (x + 0.3, 1.0, z + 0.8))]


def replanning(planner: Planner, start: tuple[str, ...], goal: Array, count: int) -> dict[str, Any]:
    """Return the time from ten newly occupied points, or a new box, to the new plan [ms]."""
    graph, out = planner.graph, {}

    def replan(taken: list[str], boxes: list[Box]) -> PlanningResult:
        if taken:
            graph.occupy(taken)
        graph.add_obstacles(boxes)
        return planner.plan(start, goal)

    for kind in ("points", "box"):
        times, unsolved = [], 0
        for change in changes(planner, start, goal, kind, count):
            seconds, result = timed(partial(replan, *change))
            times.append(seconds)
            unsolved += result.plan is None
            graph.vacate()
            graph.remove_obstacles()
        out[kind] = spread(times) | {"unsolved": unsolved}
    return out


def libraries(graph: StanceGraph, tasks: Sequence[Task], name: str) -> dict[str, Any]:
    """Measure queries of a cost in two graph libraries on the table, and in this planner."""
    cost = Cost.named(name)
    known = [Planner(graph).plan(start.stance, goal, name).unwrap() for start, goal in tasks]
    series = {"A*": SearchOptions(), "A*, consistent": SearchOptions(heuristic="consistent")}
    series["Dijkstra"] = SearchOptions(method="dijkstra")
    ours = {key: query_times(Planner(graph), tasks, name, how) for key, how in series.items()}
    out: dict[str, Any] = {"this planner": ours}
    for library, kind in LIBRARIES.items():
        before = resident()
        build, made = timed(partial(kind, graph, cost))
        out[library] = {"build": build, "memory": resident() - before, "lower": 0, "higher": 0}
        times: dict[str, list[float]] = {"A*": [], "Dijkstra": []}
        for (start, goal), plan in zip(tasks, known, strict=True):
            away = np.linalg.norm(graph.base_position - goal, axis=1)
            first = graph.find(start.stance)
            h = [
                *cost.heuristic("consistent", away, TOLERANCE, graph.max_displacement).tolist(),
                0.0,
            ]
            for method, heuristic in (("A*", h), ("Dijkstra", None)):
                goals = np.flatnonzero(away <= TOLERANCE).tolist()
                seconds, path = made.search(first, goals, heuristic)
                times[method].append(seconds)
            spent = cost.of_path(graph.base_position[path], graph.points[path])
            out[library]["lower"] += bool(spent < plan.statistics.cost - 1e-9)
            out[library]["higher"] += bool(spent > plan.statistics.cost + 1e-9)
        out[library] |= {method: spread(seconds) for method, seconds in times.items()}
        del made
    return out


def measured(queries: int) -> dict[str, Any]:
    """Run all measurements in order."""
    count, setup, rng = max(queries, STARTS), default_setup(), np.random.default_rng(2026)
    start, goal = tuple(setup["start"]), np.array(setup["goal"])
    Planner(two_limb_graph()).plan(start, goal).unwrap()  # compiles, or loads, all kernels
    data: dict[str, Any] = {"machine": machine()}
    graph = two_limb_graph()
    assert graph.table is not None
    data["table"] = {
        "stances": len(graph),
        "steps": int(np.bitwise_count(graph.table.joined).sum()),
        "memory": sum(array.nbytes for array in graph.table) / 1e6,
    }
    tasks = [sample_task(graph, rng, TOLERANCE) for _ in range(count)]
    print("queries", flush=True)
    data["collisions on"] = {cost: query_series(graph, tasks, cost) for cost in COSTS}
    without = two_limb_graph(collisions=False)
    others = [sample_task(without, rng, TOLERANCE) for _ in range(count)]
    data["collisions off"] = {cost: query_series(without, others, cost) for cost in COSTS}
    print("replanning", flush=True)
    planner = Planner(graph)
    data["replanning"] = replanning(planner, start, goal, min(CHANGES, count))
    print("graph libraries", flush=True)
    data["libraries"] = libraries(graph, tasks[:LIBRARY_QUERIES], "base")
    return data


OFF = "collisions off"

BEFORE = {
    "steps, new goal": f"0.91, 1.20 ({OFF})",
    "base, new goal": f"3.30, 90.1 ({OFF})",
    "steps, known goal": f"1.41, 1.80 ({OFF})",
    "base, known goal": f"1.64, 2.00 ({OFF})",
    "base, exact cost-to-go": f"0.90 ({OFF})",
    "points": "2.45, 2.73",
    "box": "66.5, 123.5",
    "compiled": "41.4",
    "again": "1.74",
    "one environment": "45,900 (all steps known)",
    "copies": "730,000 (1024 sub-environments)",
}
"""Speed of version 0.1.0 as published by its benchmarks, in `results/` of commit 2f4e2068; steps
per second of commit 3fb4419c. Measured on two cores of an AMD EPYC, Python 3.11.7, Numba 0.68.1."""

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
    exact = base.get("exact cost-to-go")
    yield row("exact cost-to-go of a new goal", "base, exact cost-to-go", exact, "0.3", "s")
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
LIBRARY_HEAD = "program | method | median | 95 % | build [s] | memory [MB] | lower | higher"
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
changes of the world has a goal to which the planner has planned. Times in ms.

{table(SERIES, series(data))}
## The same table in graph libraries

The same tasks in the same run, base cost: nodes are the stances, edges the valid steps, the goal a
virtual node joined to every goal stance. A* of the libraries has the consistent heuristic. They
have no labels for branches, so their paths may cost less than any executable walk (*lower*).
Attaching the goal is not timed; for this planner the whole call is timed, including the motion of
the plan. Times in ms.

{table(LIBRARY_HEAD, library_rows(data))}"""


if __name__ == "__main__":
    experiment("benchmark_planning", __doc__, measured, markdown, queries=200)
