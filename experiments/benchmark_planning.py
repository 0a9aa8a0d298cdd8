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
from planning_report import markdown
from reports import experiment, spread, timed, two_limb_graph

from mlivr_gym import Box, State
from mlivr_gym.arrays import Array
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.paper import default_setup
from mlivr_gym.planners import Planner, PlanningResult
from mlivr_gym.planners.costs import Cost
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

COSTS = ("steps", "base")
GOALS, STARTS = 16, 5
"""Number of known goals, as many as a planner keeps prepared, and of starts for each."""

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
    planner: Planner, tasks: Iterable[Task], cost: str, **options: Any
) -> dict[str, Any]:
    """Time `Planner.plan` and its search over queries; count expansions and missing plans."""
    whole, results = [], []
    for start, goal in tasks:
        seconds, result = timed(partial(planner.plan, start.stance, goal, cost, **options))
        whole.append(seconds)
        results.append(result)
    return spread(whole) | {
        "search": spread([result.search_time for result in results])["median"],
        "expanded": float(np.median([result.expanded for result in results])),
        "unsolved": sum(result.plan is None for result in results),
    }


def out_of_reach(graph: TwoLimbGraph, rng: np.random.Generator) -> Iterator[Task]:
    """Yield random starts with goals in the cabin that no walk from them reaches."""
    low, high = graph.base_position.min(axis=0), graph.base_position.max(axis=0)
    while True:
        start, goal = sample_task(graph, rng, TOLERANCE).start, rng.uniform(low, high)
        if not Planner(graph).plan(start.stance, goal, "steps"):
            yield start, goal


def query_series(graph: TwoLimbGraph, tasks: Sequence[Task], cost: str) -> dict[str, Any]:
    """Measure new goals, prepared goals and unreachable goals."""
    cut_off = list(islice(out_of_reach(graph, np.random.default_rng(0)), len(tasks) // 2))
    knowing, goals = Planner(graph), [goal for _, goal in tasks[:GOALS]]
    preparing = [timed(partial(knowing.prepare, goal, cost))[0] for goal in goals]
    known = [(start, goal) for goal in goals for start, _ in tasks[-STARTS:]]
    exact = [timed(partial(Planner(graph).cost_to_go, goal, cost))[0] for goal in goals]
    return {
        "new goal": query_times(Planner(graph), tasks, cost),
        "known goal": query_times(knowing, known, cost),
        "unreachable goal": query_times(Planner(graph), cut_off, cost),
        "exact cost-to-go": spread(exact),
        "prepare": spread(preparing),
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


def libraries(graph: TwoLimbGraph, tasks: Sequence[Task]) -> dict[str, Any]:
    """Measure queries of the base cost in two graph libraries on the table, and in this planner."""
    known = [Planner(graph).plan(start.stance, goal).unwrap() for start, goal in tasks]
    series = {"A*": {}, "A*, consistent": {"heuristic": "consistent"}}
    series["Dijkstra"] = {"method": "dijkstra"}
    ours = {name: query_times(Planner(graph), tasks, "base", **how) for name, how in series.items()}
    out: dict[str, Any] = {"this planner": ours}
    for name, library in LIBRARIES.items():
        before = resident()
        build, table = timed(partial(library, graph))
        out[name] = {"build": build, "memory": resident() - before, "lower": 0, "higher": 0}
        times: dict[str, list[float]] = {"A*": [], "Dijkstra": []}
        for (start, goal), plan in zip(tasks, known, strict=True):
            away = np.linalg.norm(graph.base_position - goal, axis=1)
            cost, first = Cost.named("base"), graph.find(start.stance)
            h = [
                *cost.heuristic("consistent", away, TOLERANCE, graph.max_displacement).tolist(),
                0.0,
            ]
            for method, heuristic in (("A*", h), ("Dijkstra", None)):
                goals = np.flatnonzero(away <= TOLERANCE).tolist()
                seconds, path = table.search(first, goals, heuristic)
                times[method].append(seconds)
            length = np.linalg.norm(np.diff(graph.base_position[path], axis=0), axis=1).sum()
            out[name]["lower"] += bool(length < plan.statistics.cost - 1e-9)
            out[name]["higher"] += bool(length > plan.statistics.cost + 1e-9)
        out[name] |= {method: spread(seconds) for method, seconds in times.items()}
        del table
    return out


def measured(queries: int) -> dict[str, Any]:
    """Run all measurements in order."""
    count, setup, rng = max(queries, STARTS), default_setup(), np.random.default_rng(2026)
    start, goal = tuple(setup["start"]), np.array(setup["goal"])
    Planner(two_limb_graph()).plan(start, goal).unwrap()  # compiles, or loads, all kernels
    data: dict[str, Any] = {"machine": machine()}
    graph = two_limb_graph()
    steps = graph.steps.edges
    arrays = [array for array in vars(graph).values() if isinstance(array, np.ndarray)]
    data["table"] = {
        "stances": len(graph),
        "steps": int((steps["kept"] != 0).sum()),
        "memory": (sum(array.nbytes for array in arrays) + steps.nbytes) / 1e6,
    }
    tasks = [sample_task(graph, rng, TOLERANCE) for _ in range(count)]
    print("queries", flush=True)
    data["collisions on"] = {cost: query_series(graph, tasks, cost) for cost in COSTS}
    without = two_limb_graph(collisions=False)
    others = [sample_task(without, rng, TOLERANCE) for _ in range(count)]
    data["collisions off"] = {cost: query_series(without, others, cost) for cost in COSTS}
    print("replanning", flush=True)
    planner = Planner(graph)
    planner.prepare(goal)
    data["replanning"] = replanning(planner, start, goal, min(CHANGES, count))
    print("graph libraries", flush=True)
    data["libraries"] = libraries(graph, tasks[:LIBRARY_QUERIES])
    return data


if __name__ == "__main__":
    experiment("benchmark_planning", __doc__, measured, markdown, queries=200)
