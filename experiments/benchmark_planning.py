"""How long planning takes, beside a plain reference, networkx and rustworkx.

    python experiments/benchmark_planning.py [--out results] [--queries 200]
        [--reference-seconds 60] [--quick]

writes `benchmark_planning.md` and `benchmark_planning.json`. A longer limit lets the plain
reference finish; see `reference_planner.py` for what it does.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_collisions import collisions
from graph_libraries import networkx_build, networkx_query, rustworkx_build, rustworkx_query
from planning_report import report
from reference_planner import TOLERANCE, map_to_plan, nodes_only_graph
from stopwatch import shares, timed
from tqdm import tqdm

from mlivr_gym import GraspMap, Settings, State, jem_map, stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.files import FileError, read_json, write_whole
from mlivr_gym.paper import default_setup
from mlivr_gym.planners import Planner
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.estimates import CACHED_TABLES
from mlivr_gym.stances.pair_graph import PairGraph

FIRST_PLAN = """
import json, sys, time
marks = [time.perf_counter()]
from mlivr_gym import stance_graph
from mlivr_gym.planners import Planner
marks.append(time.perf_counter())
graph = stance_graph()
marks.append(time.perf_counter())
start, goal = json.loads(sys.argv[1])
Planner(graph).plan(start, goal).unwrap()
marks.append(time.perf_counter())
print(json.dumps([b - a for a, b in zip(marks, marks[1:])]))
"""

PAPER = Settings(collisions=False)
"""What is not by default, nor in the section on collisions, is measured without them."""

Tasks = Sequence[tuple[State, Array]]


def paper_graph(grasp_map: GraspMap) -> PairGraph:
    """Stance graph without collisions."""
    graph = stance_graph(grasp_map, settings=PAPER)
    assert isinstance(graph, PairGraph)
    return graph


def resident() -> float:
    """Resident memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Median and 95th percentile [ms]."""
    return {
        "median": 1e3 * float(np.median(seconds)),
        "p95": 1e3 * float(np.percentile(seconds, 95)),
    }


def machine() -> dict[str, Any]:
    """Processor, cores and versions."""
    info = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    models = [line.split(":", 1)[1].strip() for line in info if line.startswith("model name")]
    packages = ("numpy", "scipy", "numba", "pin", "networkx", "rustworkx")
    return {
        "processor": models[0] if models else platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "packages": {name: version(name) for name in packages},
    }


def megabytes(values: Iterable[Any]) -> float:
    """Memory of the arrays among some values [MB]."""
    return sum(a.nbytes for a in values if isinstance(a, np.ndarray)) / 1e6


def stance_set(grasp_map: GraspMap, repeats: int) -> dict[str, Any]:
    """Time and memory of the stance graph, kernels compiled beforehand."""
    times = [timed(lambda: paper_graph(grasp_map))[0] for _ in range(repeats)]
    plain = [timed(lambda: nodes_only_graph(grasp_map))[0] for _ in range(repeats)]
    graph = paper_graph(grasp_map)
    names = {
        "in_parallel": "compiled kernels",
        "base_frames": "body axes",
        "_group": "grouping by geometry",
    }
    return {
        "points": len(grasp_map),
        "pairs": graph.considered,
        "geometries": graph.solver.geometries,
        "stances": len(graph),
        "directed_steps": int((graph.degree**2).sum() - graph.degree.sum()),
        "base_poses": len(graph.robot.heights) * len(graph.robot.rolls),
        "seconds": float(np.median(times)),
        "seconds_without_step_checks": float(np.median(plain)),
        "array_mb": megabytes(vars(graph).values()) + megabytes(graph.steps),
        "edge_table_mb": megabytes([graph.steps.edges]),
        "shares": shares(lambda: paper_graph(grasp_map), names),
    }


def series(
    graph: PairGraph, tasks: Tasks, cost: str, prepare: bool = False, **options: Any
) -> dict[str, Any]:
    """Time of `Planner.plan` over tasks.

    Each task has a new planner, which knows no goal unless it is prepared.
    """
    whole, search, expanded, unsolved = [], [], [], 0
    for start, goal in tasks:
        planner = Planner(graph)
        if prepare:
            planner.prepare(goal, cost)
        seconds, result = timed(partial(planner.plan, start.stance, goal, cost, **options))
        whole.append(seconds)
        search.append(result.search_time)
        expanded.append(result.expanded)
        unsolved += result.plan is None
    return {
        "whole": spread(whole),
        "search": spread(search),
        "expanded": float(np.median(expanded)),
        "queries": len(tasks),
        "unsolved": unsolved,
    }


def by_default(grasp_map: GraspMap, count: int) -> dict[str, Any]:
    """Queries of both costs with the default settings, collisions on, nothing known beforehand."""
    graph, rng = stance_graph(grasp_map), np.random.default_rng(2026)
    assert isinstance(graph, PairGraph)
    tasks = [sample_task(graph, rng, TOLERANCE) for _ in range(max(count, 2))]
    found = {}
    for cost in ("base", "steps"):
        fresh = stance_graph(grasp_map)
        assert isinstance(fresh, PairGraph)
        found[cost] = series(fresh, tasks, cost)
    return found


def queries(grasp_map: GraspMap, tasks: Tasks, few: int, cost: str) -> dict[str, Any]:
    """All query times of one cost, on a graph whose edge table begins empty."""
    graph = paper_graph(grasp_map)
    out = {
        "new goal, cold": series(graph, tasks, cost),
        "new goal, warm": series(graph, tasks, cost),
        "known goal": series(graph, tasks, cost, prepare=True),
        "A*, heuristic consistent": series(graph, tasks[:few], cost, heuristic="consistent"),
        "Dijkstra": series(graph, tasks[:few], cost, method="dijkstra"),
    }
    names = {
        "table": "cost-to-go heuristic",
        "search": "search and step checks",
        "committed_motion": "joint angles of the plan",
        "fingerprint": "hash of the map",
    }
    out["shares"] = shares(lambda: series(graph, tasks, cost), names)
    planner, known = Planner(graph), tasks[:CACHED_TABLES]
    for _, goal in known:
        planner.prepare(goal, cost)
    out["shares known"] = shares(lambda: [planner.plan(s.stance, g, cost) for s, g in known], names)
    return out


def oracle(grasp_map: GraspMap, tasks: Tasks) -> dict[str, float]:
    """Seconds of the exact cost-to-go table for two goals; only the first checks every step."""
    planner = Planner(paper_graph(grasp_map))
    first, second = (timed(partial(planner.cost_to_go, goal))[0] for _, goal in tasks[:2])
    return {"first": first, "second": second}


def libraries(grasp_map: GraspMap, tasks: Tasks, advance: Callable[[str], None]) -> dict[str, Any]:
    """The roadmap without step checks in two graph libraries: the same queries, base cost."""
    graph = nodes_only_graph(grasp_map)
    ours = {
        name: series(graph, tasks, "base", heuristic=name) for name in ("cost_to_go", "consistent")
    }
    build_seconds, _ = timed(lambda: nodes_only_graph(grasp_map))
    array_mb = sum(a.nbytes for a in vars(graph).values() if isinstance(a, np.ndarray)) / 1e6
    out: dict[str, Any] = {"ours": {"build_seconds": build_seconds, "memory_mb": array_mb, **ours}}
    least = [
        Planner(graph).plan(start.stance, goal).unwrap().statistics.cost for start, goal in tasks
    ]
    for name, build, query in (
        ("rustworkx", rustworkx_build, rustworkx_query),
        ("networkx", networkx_build, networkx_query),
    ):
        advance(name)
        before = resident()
        seconds, roadmap = timed(partial(build, graph))
        grown = resident() - before
        times, error = [], 0.0
        for (start, goal), cost in zip(tasks, least, strict=True):
            away = np.linalg.norm(graph.base_in_world - goal, axis=1)
            h = [
                *Cost.named("base")
                .heuristic("consistent", away, TOLERANCE, graph.max_step)
                .tolist(),
                0.0,
            ]
            spent, path = query(
                roadmap, graph.find(start.stance), np.flatnonzero(away <= TOLERANCE).tolist(), h
            )
            length = np.linalg.norm(np.diff(graph.base_in_world[path], axis=0), axis=1).sum()
            times.append(spent)
            error = max(error, abs(float(length) - cost))
        out[name] = {
            "build_seconds": seconds,
            "memory_mb": grown,
            "queries": len(times),
            "query": spread(times),
            "largest_cost_difference": error,
        }
        del roadmap
    return out


def first_plan(start: tuple[str, ...], goal: Array, runs: Sequence[str]) -> dict[str, Any]:
    """Seconds that a new process takes to make one plan.

    Args:
        start: Point ids.
        goal: Goal position, shape (3,) [m].
        runs: `"empty"`, `"filled"` or both: what the cache of compiled kernels holds at the start.
    """
    out = {}
    with tempfile.TemporaryDirectory() as folder:
        cache = {} if "empty" not in runs else {"NUMBA_CACHE_DIR": folder}
        command = [sys.executable, "-c", FIRST_PLAN, json.dumps([list(start), goal.tolist()])]
        for run in runs:
            wall, done = timed(
                lambda: subprocess.run(
                    command,
                    cwd=folder,
                    env=os.environ | cache,
                    capture_output=True,
                    text=True,
                    check=True,
                )
            )
            imports, build, plan = json.loads(done.stdout)
            out[run] = {"wall": wall, "imports": imports, "stance_graph": build, "plan": plan}
    return out


def measure(quick: bool, count: int, limit: float) -> dict[str, Any]:
    """Everything, in order."""
    setup = default_setup()
    grasp_map, start, goal = jem_map(), tuple(setup["start"]), np.array(setup["goal"])
    whole = paper_graph(grasp_map)
    origin = whole.posture(whole.indices(start)).base_position[0]
    close = origin + (goal - origin) / np.linalg.norm(goal - origin)
    if quick:
        grasp_map = grasp_map.subset(
            np.abs(grasp_map.positions[:, 0] - origin[0]) < 0.7, "part of the JEM"
        )
        part = paper_graph(grasp_map)
        task = sample_task(part, np.random.default_rng(0), TOLERANCE, part.state(start))
        goal = close = task.goal
    bar = tqdm(total=16, mininterval=0.5)

    def advance(stage: str) -> None:
        bar.set_description(stage)
        bar.update()

    draw, rng = paper_graph(grasp_map), np.random.default_rng(2026)
    tasks = [sample_task(draw, rng, TOLERANCE) for _ in range(max(count, 2))]
    for cost in ("base", "steps"):
        Planner(draw).plan(start, goal, cost)
    few = 3 if quick else 20
    advance("stance set")
    data: dict[str, Any] = {"machine": machine(), "quick": quick, "reference_seconds": limit}
    advance("default settings")
    data["by default"] = by_default(grasp_map, count)
    data["stance set"] = stance_set(grasp_map, 2 if quick else 7)
    for cost in ("base", "steps"):
        advance(f"queries, {cost}")
        data[cost] = queries(grasp_map, tasks, few, cost)
    advance("exact cost-to-go")
    data["cost-to-go"] = oracle(grasp_map, tasks)
    data["resident_mb"] = resident()
    advance("first plan in a new process")
    data["first plan"] = first_plan(
        start, np.array(setup["goal"]), ("filled",) if quick else ("empty", "filled")
    )
    asked = start, np.array(setup["goal"])
    if quick:  # on part of the map the goal may be out of reach with collisions
        task = sample_task(stance_graph(grasp_map), rng, TOLERANCE)
        asked = tuple(grasp_map.ids[p] for p in task.start.stance), task.goal
    data["collisions"] = collisions(grasp_map, *asked, 2 if quick else 7, advance)
    data["libraries"] = libraries(grasp_map, tasks[:few], advance)
    data["near"] = map_to_plan(grasp_map, start, close, limit, advance)
    if not quick:
        data["case 2"] = map_to_plan(grasp_map, start, goal, limit, advance)
    bar.close()
    return data


def main() -> None:
    """Measure and write both files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("results"), help="folder for the results")
    parser.add_argument("--queries", type=int, default=200, help="random start and goal pairs")
    parser.add_argument(
        "--reference-seconds",
        type=float,
        default=60.0,
        help="limit of each run of the reference [s]",
    )
    parser.add_argument("--quick", action="store_true", help="part of the map and few queries")
    parser.add_argument(
        "--by-default", action="store_true", help="queries with default settings anew, no more"
    )
    args = parser.parse_args()
    count, limit = (3, 1.5) if args.quick else (args.queries, args.reference_seconds)
    if args.by_default:
        data = read_json(args.out / "benchmark_planning.json", "benchmark", FileError)
        data["by default"] = by_default(jem_map(), count)
    else:
        data = measure(args.quick, count, limit)
    args.out.mkdir(parents=True, exist_ok=True)
    write_whole(args.out / "benchmark_planning.json", json.dumps(data, indent=1) + "\n")
    write_whole(args.out / "benchmark_planning.md", report(data))
    print(report(data))


if __name__ == "__main__":
    main()
