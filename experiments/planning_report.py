"""The Markdown report of `benchmark_planning.py`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from benchmark_collisions import collision_report, collision_targets
from reference_planner import MODES


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

    yield most("stance set of the map, collisions off [s]", 0.5, data["stance set"]["seconds"])
    for cost, bound in (("base", 20.0), ("steps", 2.0)):
        for name, at_most in (
            ("new goal, cold", bound),
            ("new goal, warm", bound),
            ("known goal", 1.0),
        ):
            yield most(
                f"query, {cost} cost, {name}, collisions off, median [ms]",
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
    """Query times of both costs, those by default first."""
    for cost in ("base", "steps"):
        known = data.get("by default", {})
        default = {"default settings, cold": known[cost]} if cost in known else {}
        for name, row in (default | data[cost]).items():
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
            task,
            mode,
            run["expanded"],
            run["candidates"],
            data[task]["needed"]["candidates"],
            f"{run['seconds']:.1f}",
            f"{1e3 * run['seconds_per_candidate']:.1f}",
            f"{run['seconds_per_expansion']:.2f}",
            f"{run['total_seconds']:.0f} ({source})",
            f"{ours['seconds']:.3f}",
            f"{run['ratio']:.0f}",
            f"{run['cost']:.3f}" if run["cost"] is not None else "none",
            f"{ours['cost']:.3f}",
            f"{100 * run['share_of_our_stances_found']:.0f} %",
        ]


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
        f" Without the branch sets that step checks need it takes {without:.2f} s. The kernels "
        "run on all cores."
    )
    for cost in ("base", "steps"):
        yield parts(f"New goal, {cost} cost, warm", data[cost]["shares"])
        yield parts(f"Known goal, {cost} cost", data[cost]["shares known"])
    yield (
        "* The rest of a query is distances of all stances to the goal, the start state and the "
        "base quaternions."
    )
    yield "* A cold query differs from a warm one by the step checks that it is the first to need."
    for cache, run in data["first plan"].items():
        yield (
            f"* First plan, {cache} cache: imports {run['imports']:.1f} s, stance graph "
            f"{run['stance_graph']:.1f} s, plan {run['plan']:.1f} s; the kernels are compiled, or "
            "read from the cache, in the last two."
        )
    yield parts("Reference", task["shares"]) + (
        f" Of the thorough mode's calls {failed:.0f} % do not converge and use up every iteration "
        "allowed, so the cap on iterations decides its speed; hence the hasty mode."
    )
    yield (
        "* Libraries: heuristic and edge weight are Python calls, and each edge is an object or a "
        "record of its own."
    )


QUICK = "Quick run on a part of the map: its figures only show that the program works."

INTRODUCTION = """
Steps are not checked on either side. Ours: stance set of the whole map and one query, kernels \
compiled beforehand,
all cores. Reference (`reference_planner.py`): Algorithm 1 on one core, a candidate at a time, \
iterative inverse
kinematics from one seed. *Thorough* tries every base pose and allows 200 iterations; *hasty* \
takes the first base
pose that will do and allows 50. *Near* has its goal close to the start; *case 2* is that of \
Table I. Where the time
limit ended a run, its total is the measured time of a candidate times the distinct candidates \
that the same search
needs (column *needed*, counted by running it on the finished stance set), and is marked \
*extrapolated*; where it had
tried more than that without an end, the time that it ran stands there as a *lower bound*. All \
else is measured. One seed
finds one branch, so the reference misses stances (last column: share of ours among the \
candidates it tried that it
found) and may take another base pose: its costs differ for that reason, and it may try every \
candidate and find no
plan at all. The paper reports 1.8 s for its Case 2 on another map and machine and does not say \
how many base poses it
tries."""
"""What the two references do, and how their totals are found."""


def report(data: dict[str, Any]) -> str:
    """The Markdown report."""
    host, stances, exact = data["machine"], data["stance set"], data["cost-to-go"]
    packages = ", ".join(f"{name} {number}" for name, number in host["packages"].items())
    lines = [
        "# Planning benchmark",
        "",
        f"{host['processor']}, {host['cores']} cores, Python {host['python']}, {packages}.",
        *([QUICK] if data["quick"] else []),
        *table("figure; target; measured; met", targets(data)),
        "## Stance set",
        "",
        f"{stances['points']} points, {stances['pairs']} ordered pairs within the span, "
        f"{stances['geometries']} distinct geometries, {stances['base_poses']} base poses for "
        f"each, {stances['stances']} stances, {stances['directed_steps']} directed steps. Arrays "
        f"{stances['array_mb']:.1f} MB, of which the table of steps "
        f"{stances['edge_table_mb']:.1f} MB; the process held {data['resident_mb']:.0f} MB after "
        "all queries.",
        "",
        "## Queries",
        "",
        "Steps are checked; collisions are not, but in the series with default settings. Cold: the "
        "table of steps begins empty and fills as the series goes on. Warm: the same queries "
        "again. Each query has a planner that knows no goal, unless the goal is known. Times in "
        "ms.",
        *table(
            "cost; series; queries; plan, median; plan, p95; search, median; search, p95; "
            "expanded, median; unsolved",
            query_rows(data),
        ),
        f"Exact cost-to-go of every state, base cost: {exact['first']:.2f} s for the first goal, "
        f"which checks every step, and {exact['second']:.2f} s for another goal.",
        "",
        *collision_report(data["collisions"]),
        "## From map to plan, beside a plain reference",
        INTRODUCTION,
        f"The time limit was {data['reference_seconds']:g} s for each run.",
        *table(
            "task; reference; expanded; candidates; needed; run [s]; each [ms]; an expansion [s]; "
            "total [s]; ours [s]; ratio; cost [m]; our cost [m]; found",
            reference_rows(data),
        ),
        "## The same roadmap in graph libraries",
        "",
        "Stances and steps without step checks, A* with the consistent heuristic, base cost, a "
        "virtual goal joined to every goal stance; attaching it is not counted. Ours is the whole "
        "call, plan included. Memory is that of the arrays for ours, and the growth of resident "
        "memory for the libraries.",
        *table(
            "program; build [s]; query, median [ms]; query, p95 [ms]; memory [MB]; largest "
            "difference of cost [m]",
            library_rows(data),
        ),
        "## What limits each number",
        "",
        *limits(data),
        "",
    ]
    return "\n".join(lines)
