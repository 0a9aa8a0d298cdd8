"""How long planning takes, beside a plain reference, networkx and rustworkx.

    python experiments/benchmark_planning.py [--out results] [--queries 200] [--reference-seconds 60] [--quick]

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
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_collisions import collision_report, collision_targets, collisions
from reference_planner import (
    MODES,
    TOLERANCE,
    map_to_plan,
    networkx_build,
    networkx_query,
    nodes_only_graph,
    rustworkx_build,
    rustworkx_query,
    shares,
    timed,
)
from tqdm import tqdm

from mlivr_gym import GraspMap, Settings, State, jem_map, stance_graph
from mlivr_gym.cli.table1 import default_setup
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.files import write_whole
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
"""All but the section on collisions is measured without them, as in the paper."""

Tasks = list[tuple[State, np.ndarray]]


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


def stance_set(grasp_map: GraspMap, repeats: int) -> dict[str, Any]:
    """Time and memory of the stance graph, kernels compiled beforehand."""
    times = [timed(lambda: stance_graph(grasp_map, settings=PAPER))[0] for _ in range(repeats)]
    plain = [timed(lambda: nodes_only_graph(grasp_map))[0] for _ in range(repeats)]
    graph = stance_graph(grasp_map, settings=PAPER)
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
        "array_mb": sum(a.nbytes for a in vars(graph).values() if isinstance(a, np.ndarray)) / 1e6,
        "edge_table_mb": graph.table.nbytes / 1e6,
        "shares": shares(lambda: stance_graph(grasp_map, settings=PAPER), names),
    }


def series(
    graph: PairGraph, tasks: Tasks, cost: str, prepare: bool = False, **options: Any
) -> dict[str, Any]:
    """Time of `Planner.plan` over tasks, each with a planner of its own that knows no goal unless prepared."""
    whole, search, expanded, unsolved = [], [], [], 0
    for start, goal in tasks:
        planner = Planner(graph)
        if prepare:
            planner.prepare(goal, cost)
        seconds, result = timed(
            lambda p=planner, s=start, g=goal: p.plan(s.stance, g, cost, **options)
        )
        whole.append(seconds)
        search.append(result.search_time)
        expanded.append(result.expanded)
        unsolved += result.plan is None
    return {
        "whole": spread(whole), "search": spread(search), "expanded": float(np.median(expanded)),
        "queries": len(tasks), "unsolved": unsolved,
    }  # fmt: skip


def queries(grasp_map: GraspMap, tasks: Tasks, few: int, cost: str) -> dict[str, Any]:
    """All query times of one cost, on a graph whose edge table begins empty."""
    graph = stance_graph(grasp_map, settings=PAPER)
    out = {
        "new goal, cold": series(graph, tasks, cost),
        "new goal, warm": series(graph, tasks, cost),
        "known goal": series(graph, tasks, cost, prepare=True),
        "A*, heuristic consistent": series(graph, tasks[:few], cost, heuristic="consistent"),
        "Dijkstra": series(graph, tasks[:few], cost, method="dijkstra"),
    }
    names = {
        "_relaxed_table": "cost-to-go heuristic", "search": "search and step checks",
        "assemble": "joint angles of the plan", "fingerprint": "hash of the map",
    }  # fmt: skip
    out["shares"] = shares(lambda: series(graph, tasks, cost), names)
    planner, known = Planner(graph), tasks[:CACHED_TABLES]
    for _, goal in known:
        planner.prepare(goal, cost)
    out["shares known"] = shares(lambda: [planner.plan(s.stance, g, cost) for s, g in known], names)
    return out


def oracle(grasp_map: GraspMap, tasks: Tasks) -> dict[str, float]:
    """Seconds of the exact cost-to-go table: the first checks every step, the second goal does not."""
    planner = Planner(stance_graph(grasp_map, settings=PAPER))
    first, second = (timed(lambda g=goal: planner.cost_to_go(g))[0] for _, goal in tasks[:2])
    return {"first": first, "second": second}


def libraries(grasp_map: GraspMap, tasks: Tasks, advance: Callable[[str], None]) -> dict[str, Any]:
    """The roadmap without step checks in two graph libraries, the same queries as ours; base cost."""
    graph = nodes_only_graph(grasp_map)
    ours = {
        name: series(graph, tasks, "base", heuristic=name) for name in ("cost_to_go", "consistent")
    }
    build_seconds, _ = timed(lambda: nodes_only_graph(grasp_map))
    array_mb = sum(a.nbytes for a in vars(graph).values() if isinstance(a, np.ndarray)) / 1e6
    out: dict[str, Any] = {"ours": {"build_seconds": build_seconds, "memory_mb": array_mb, **ours}}
    least = [Planner(graph).plan(start.stance, goal).unwrap().statistics.cost for start, goal in tasks]
    for name, build, query in (
        ("rustworkx", rustworkx_build, rustworkx_query),
        ("networkx", networkx_build, networkx_query),
    ):  # fmt: skip
        advance(name)
        before = resident()
        seconds, roadmap = timed(lambda b=build: b(graph))
        grown = resident() - before
        times, error = [], 0.0
        for (start, goal), cost in zip(tasks, least, strict=True):
            away = np.linalg.norm(graph.position - goal, axis=1)
            h = [
                *Cost.named("base")
                .heuristic("consistent", away, TOLERANCE, graph.max_step)
                .tolist(),
                0.0,
            ]
            spent, path = query(
                roadmap, graph.find(start.stance), np.flatnonzero(away <= TOLERANCE).tolist(), h
            )
            length = np.linalg.norm(np.diff(graph.position[path], axis=0), axis=1).sum()
            times.append(spent)
            error = max(error, abs(float(length) - cost))
        out[name] = {
            "build_seconds": seconds, "memory_mb": grown, "queries": len(times),
            "query": spread(times),
            "largest_cost_difference": error,
        }  # fmt: skip
        del roadmap
    return out


def first_plan(start: tuple[str, ...], goal: np.ndarray, runs: Sequence[str]) -> dict[str, Any]:
    """Seconds from starting a new process to its end, one plan made, with an empty and with a filled kernel cache."""
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
    whole = stance_graph(grasp_map, settings=PAPER)
    origin = whole.posture(whole.indices(start)).position[0]
    near = origin + (goal - origin) / np.linalg.norm(goal - origin)
    if quick:
        grasp_map = grasp_map.subset(
            np.abs(grasp_map.positions[:, 0] - origin[0]) < 0.7, "part of the JEM"
        )
        goal = near = origin + 0.5 * (near - origin)
    bar = tqdm(total=15, mininterval=0.5)

    def advance(stage: str) -> None:
        bar.set_description(stage)
        bar.update()

    draw, rng = stance_graph(grasp_map, settings=PAPER), np.random.default_rng(2026)
    tasks = [sample_task(draw, rng, TOLERANCE) for _ in range(max(count, 2))]
    for cost in ("base", "steps"):
        Planner(draw).plan(start, goal, cost)
    few = 3 if quick else 20
    advance("stance set")
    data: dict[str, Any] = {"machine": machine(), "quick": quick, "reference_seconds": limit}
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
    data["collisions"] = collisions(
        jem_map() if not quick else grasp_map, start,
        np.array(setup["goal"]) if not quick else goal, 2 if quick else 7, advance
    )  # fmt: skip
    data["libraries"] = libraries(grasp_map, tasks[:few], advance)
    data["near"] = map_to_plan(grasp_map, start, near, limit, advance)
    if not quick:
        data["case 2"] = map_to_plan(grasp_map, start, goal, limit, advance)
    bar.close()
    return data


def table(names: str, rows: Iterable[Sequence[Any]]) -> list[str]:
    """A Markdown table; `names` are separated by semicolons."""
    head = [name.strip() for name in names.split(";")]
    return [
        "",
        *("| " + " | ".join(map(str, row)) + " |" for row in (head, ["---"] * len(head), *rows)),
        "",
    ]


def targets(data: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """Targets beside what was measured."""

    def most(name: str, bound: float, value: float) -> tuple[str, ...]:
        return name, f"at most {bound:g}", f"{value:.2f}", "yes" if value <= bound else "no"

    yield most("stance set of the map [s]", 0.5, data["stance set"]["seconds"])
    for cost, bound in (("base", 20.0), ("steps", 2.0)):
        for name, at_most in (
            ("new goal, cold", bound),
            ("new goal, warm", bound),
            ("known goal", 1.0),
        ):
            yield most(
                f"query, {cost} cost, {name}, median [ms]",
                at_most,
                data[cost][name]["whole"]["median"],
            )
    for task, mode, run, source in compared(data):
        label = f"map to plan, {task}, times faster than the {mode} reference ({source})"
        yield (
            label,
            "at least 1000",
            f"{run['ratio']:.0f}",
            "yes" if run["ratio"] >= 1000.0 else "no",
        )
    for name, bound, value in collision_targets(data["collisions"]):
        yield most(name, bound, value)
    for cache, run in data["first plan"].items():
        yield most(f"first plan in a new process, {cache} kernel cache [s]", 10.0, run["wall"])


def compared(data: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any], str]]:
    """Task, mode and figures of each run of the reference, and where its total comes from."""
    for task in ("near", "case 2") if "case 2" in data else ("near",):
        for mode in MODES:
            run = data[task][mode]
            source = "measured" if run["cost"] is not None else "measured, no plan found"
            if not run["finished"]:
                passed = run["candidates"] > data[task]["needed"]["candidates"]
                source = "lower bound" if passed else "extrapolated"
            yield task, mode, run, source


def query_rows(data: dict[str, Any]) -> Iterator[list[Any]]:
    """Query times of both costs."""
    for cost in ("base", "steps"):
        for name, row in data[cost].items():
            if "whole" in row:
                times = [
                    f"{row[part][figure]:.2f}"
                    for part in ("whole", "search")
                    for figure in ("median", "p95")
                ]
                yield [
                    cost,
                    name,
                    row["queries"],
                    *times,
                    f"{row['expanded']:.0f}",
                    row["unsolved"],
                ]


def reference_rows(data: dict[str, Any]) -> Iterator[list[Any]]:
    """Both modes of the reference on both tasks."""
    for task, mode, run, source in compared(data):
        ours = data[task]["ours"]
        yield [
            task, mode, run["expanded"], run["candidates"], data[task]["needed"]["candidates"],
            f"{run['seconds']:.1f}",
            f"{1e3 * run['seconds_per_candidate']:.1f}", f"{run['seconds_per_expansion']:.2f}",
            f"{run['total_seconds']:.0f} ({source})", f"{ours['seconds']:.3f}",
            f"{run['ratio']:.0f}",
            f"{run['cost']:.3f}" if run["cost"] is not None else "none", f"{ours['cost']:.3f}",
            f"{100 * run['share_of_our_stances_found']:.0f} %",
        ]  # fmt: skip


def library_rows(data: dict[str, Any]) -> Iterator[list[str]]:
    """The roadmap in ours and in both libraries."""
    ours = data["libraries"]["ours"]
    for name in ("cost_to_go", "consistent"):
        ms = ours[name]["whole"]
        build = f"{ours['build_seconds']:.2f} (postures included)"
        times = [f"{ms[figure]:.2f}" for figure in ("median", "p95")]
        yield [f"this planner, {name}", build, *times, f"{ours['memory_mb']:.1f}", "0"]
    for name in ("rustworkx", "networkx"):
        row = data["libraries"][name]
        build, error = (
            f"{row['build_seconds']:.2f} (stances given)",
            f"{row['largest_cost_difference']:.1e}",
        )
        yield [
            name,
            build,
            *(f"{row['query'][k]:.2f}" for k in ("median", "p95")),
            f"{row['memory_mb']:.0f}",
            error,
        ]


def limits(data: dict[str, Any]) -> Iterator[str]:
    """What limits each number, from profiles of this run."""

    def parts(title: str, share: dict[str, float]) -> str:
        ordered = sorted(share.items(), key=lambda item: -item[1])
        return (
            f"* {title}: "
            + ", ".join(f"{name} {100 * value:.0f} %" for name, value in ordered)
            + "."
        )

    stances, task = data["stance set"], data.get("case 2", data["near"])
    without, failed = (
        stances["seconds_without_step_checks"],
        100 * task["thorough"]["failed_ik_share"],
    )
    yield parts("Stance set", stances["shares"]) + (
        f" Without the branch sets that step checks need it takes {without:.2f} s. The kernels run on all cores."
    )
    for cost in ("base", "steps"):
        yield parts(f"New goal, {cost} cost, warm", data[cost]["shares"])
        yield parts(f"Known goal, {cost} cost", data[cost]["shares known"])
    yield "* The rest of a query is distances of all stances to the goal, the start state and the base quaternions."
    yield "* A cold query differs from a warm one by the step checks that it is the first to need."
    for cache, run in data["first plan"].items():
        yield (
            f"* First plan, {cache} cache: imports {run['imports']:.1f} s, stance graph {run['stance_graph']:.1f} s, "
            f"plan {run['plan']:.1f} s; the kernels are compiled, or read from the cache, in the last two."
        )
    yield parts("Reference", task["shares"]) + (
        f" Of the thorough mode's calls {failed:.0f} % do not converge and use up every iteration allowed, so the cap "
        "on iterations decides its speed; hence the hasty mode."
    )
    yield "* Libraries: heuristic and edge weight are Python calls, and each edge is an object or a record of its own."


INTRODUCTION = """
Steps are not checked on either side. Ours: stance set of the whole map and one query, kernels compiled beforehand,
all cores. Reference (`reference_planner.py`): Algorithm 1 on one core, a candidate at a time, iterative inverse
kinematics from one seed. *Thorough* tries every base pose and allows 200 iterations; *hasty* takes the first base
pose that will do and allows 50. *Near* has its goal close to the start; *case 2* is that of Table I. Where the time
limit ended a run, its total is the measured time of a candidate times the distinct candidates that the same search
needs (column *needed*, counted by running it on the finished stance set), and is marked *extrapolated*; where it had
tried more than that without an end, the time that it ran stands there as a *lower bound*. All else is measured. One seed
finds one branch, so the reference misses stances (last column: share of ours among the candidates it tried that it
found) and may take another base pose: its costs differ for that reason, and it may try every candidate and find no
plan at all. The paper reports 1.8 s for its Case 2 on another map and machine and does not say how many base poses it
tries."""


def report(data: dict[str, Any]) -> str:
    """The Markdown report."""
    host, stances, exact = data["machine"], data["stance set"], data["cost-to-go"]
    packages = ", ".join(f"{name} {number}" for name, number in host["packages"].items())
    lines = [
        "# Planning benchmark", "",
        f"{host['processor']}, {host['cores']} cores, Python {host['python']}, {packages}.",
        *(["Quick run on a part of the map: its figures only show that the program works."] if data["quick"] else []),
        *table("figure; target; measured; met", targets(data)), "## Stance set", "",
        f"{stances['points']} points, {stances['pairs']} ordered pairs within the span, {stances['geometries']} "
        f"distinct geometries, {stances['base_poses']} base poses for each, {stances['stances']} stances, "
        f"{stances['directed_steps']} directed steps. Arrays {stances['array_mb']:.1f} MB, of which the table of steps "
        f"{stances['edge_table_mb']:.1f} MB; the process held {data['resident_mb']:.0f} MB after all queries.",
        "", "## Queries", "",
        "Steps are checked. Cold: the table of steps begins empty and fills as the series goes on. Warm: the same "
        "queries again. Each query has a planner that knows no goal, unless the goal is known. Times in ms.",
        *table(
            "cost; series; queries; plan, median; plan, p95; search, median; search, p95; expanded, median; unsolved",
            query_rows(data),
        ),
        f"Exact cost-to-go of every state, base cost: {exact['first']:.2f} s for the first goal, which checks every "
        f"step, and {exact['second']:.2f} s for another goal.",
        "", *collision_report(data["collisions"]), "## From map to plan, beside a plain reference",
        INTRODUCTION,
        f"The time limit was {data['reference_seconds']:g} s for each run.",
        *table(
            "task; reference; expanded; candidates; needed; run [s]; each [ms]; an expansion [s]; total [s]; ours [s]; "
            "ratio; cost [m]; our cost [m]; found",
            reference_rows(data),
        ),
        "## The same roadmap in graph libraries", "",
        "Stances and steps without step checks, A* with the consistent heuristic, base cost, a virtual goal joined to "
        "every goal stance; attaching it is not counted. Ours is the whole call, plan included. Memory is that of the "
        "arrays for ours, and the growth of resident memory for the libraries.",
        *table(
            "program; build [s]; query, median [ms]; query, p95 [ms]; memory [MB]; largest difference of cost [m]",
            library_rows(data),
        ),
        "## What limits each number", "", *limits(data), "",
    ]  # fmt: skip
    return "\n".join(lines)


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
    args = parser.parse_args()
    count, limit = (3, 1.5) if args.quick else (args.queries, args.reference_seconds)
    data = measure(args.quick, count, limit)
    args.out.mkdir(parents=True, exist_ok=True)
    write_whole(args.out / "benchmark_planning.json", json.dumps(data, indent=1) + "\n")
    write_whole(args.out / "benchmark_planning.md", report(data))
    print(report(data))


if __name__ == "__main__":
    main()
