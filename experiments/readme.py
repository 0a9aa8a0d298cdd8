"""Write the measured values of `results/` into the reports, the README and the pages of `docs/`.

    python experiments/readme.py

Each experiment writes its results as JSON and as a report. This script writes all reports again
from the JSON files, and fills the marked places of README and docs, also from the entries in
`benchmark/`. A place starts with `<!-- NAME -->` and ends with `<!-- end of NAME -->`; `parts`
lists the names. The field tables of `docs/formats.md` come from the schemas in the same way. It
takes some seconds; `make test` fails if a page states another value.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import benchmark_env
import benchmark_planning
import closed_loop
import comparison_report
import disturbances
import dynamic_report
import format_tables
import places
import robots
import simulation_figures
from reports import ROOT, command_line, table

from mlivr_gym.cli.table1 import HEAD, HEAD_LINE, table_markdown, table_rows
from mlivr_gym.extensions.benchmark import BenchmarkEntry, markdown_table
from mlivr_gym.files import write_whole

CASES = {
    "1": "1: no thresholds, base cost",
    "2": "2: thresholds, base cost",
    "3": "3: thresholds, step cost",
    "4": "4: as 2, half the points, deck cleared",
}
"""Titles of the cases of Table I."""


def table1(data: dict[str, Any]) -> str:
    """Return Table I of the paper next to the measured values."""
    lines = [HEAD, HEAD_LINE]
    for case, title in CASES.items():
        lines += table_rows(data, case, title)
    return "\n".join(lines) + "\n"


MODES = {"faithful": "as in the paper", "collisions": "steps and collisions checked"}
"""Modes of Table I that the README compares with the paper, and their titles."""

PRICE = 0.05
"""Price of a regrasp whose effect is described [m]."""


def study(data: dict[str, Any]) -> str:
    """Return the text on plans that cannot be executed and on a price for each regrasp."""
    counts = data["transition_study"]
    free = next(row for row in data["pareto"] if row["price"] == 0.0)
    priced = next(row for row in data["pareto"] if row["price"] == PRICE)
    saved, more = (
        1.0 - priced["steps"] / free["steps"],
        priced["base_translation"] / free["base_translation"] - 1.0,
    )
    return (
        f"The paper checks only nodes: of {counts['pairs']} random tasks, {counts['blocked']} such "
        f"plans of the base cost and {counts['blocked_steps']} of the step cost cannot be\n"
        f"executed. With steps checked, {counts['solved']} of {counts['pairs']} tasks get an "
        f"executable plan, {100 * counts['extra_translation']:.2f} % longer on average. A price\n"
        f"of {PRICE:g} m per regrasp saves {100 * saved:.0f} % of the steps for {100 * more:.1f} % "
        "more translation ([report](reports/table1_study.md)):\n"
    )


def truth(data: dict[str, Any]) -> str:
    """Return the text on the checks against independent programs."""
    walks, optimal, collisions = data["walks"], data["optimality"], data["collisions"]
    stances, plans, motions = collisions["stances"], collisions["plans"], data["motions"]["robots"]
    made = sum(row["made"] for row in motions.values())
    penetrating = sum(row["penetrating"] for row in motions.values())
    least = 1000.0 * min(row["least"] for row in motions.values())
    return f"""{walks["put_together"]} of {walks["walks"]} random walks of {walks["steps"]} valid \
steps have a complete motion. Of {optimal["queries"]} random queries on half the points, with
collisions checked, {optimal["outcomes"].get("existence differs", 0)} differ from SciPy's Dijkstra \
over `successors` in whether a plan exists, and the costs of {optimal["found"]} plans by at most
{optimal["largest_difference"]:.0e}. MuJoCo's collision pipeline finds \
{stances["free_penetrating"]} penetrations in {stances["free"]} random stances called free, \
{penetrating} along the
motions of {made} random steps of {len(motions)} robots, where coal measures at least {least:.1f} \
mm, and {plans["penetrating"]} along {plans["plans"]} random plans ({plans["configurations"]} \
configurations); coal's minimum distance over those stances is
{1000 * stances["free_least_distance"]:.1f} mm. Of {stances["left_out"]} stances that only \
collisions rule out, {stances["left_out_nearer_than_clearance"]} violate the clearance in their \
best posture. {100 * collisions["share_blocked"]:.0f} % of the
steps between free stances that are possible without collision checks are blocked.
"""


def paper(data: dict[str, Any]) -> str:
    """Return the table of steps and base translation in the paper's cases, and as measured."""

    def cell(row: dict[str, Any], digits: int) -> str:
        return f"{row['steps']:.0f}, {row['base_translation']:.{digits}f} m"

    measured = data["measured"]
    rows = [
        [title, cell(data["paper"][case], 1), *(cell(measured[mode][case], 2) for mode in MODES)]
        for case, title in CASES.items()
    ]
    return table(" | ".join(["case", "paper", *MODES.values()]), rows)


SHOWN = ("astar-steps", "astar-base", "mcts", "local", "dagger-pointer", "random")
"""Methods that the README shows."""


def policies(data: dict[str, Any]) -> str:
    """Return success and steps of some methods on the known map and half its points, as a table."""
    names, splits = comparison_report.NAMES, ("same", "half")
    found = [dict(comparison_report.table_rows(data, split)) for split in splits]
    rows = []
    for name in SHOWN:
        cells = (", ".join(by_name[name][k].split(" [")[0] for k in (0, 2)) for by_name in found)
        rows.append([names[name], *cells, found[0][name][6]])
    return table("method | same map | half the points | an action [ms]", rows)


STEPS = {
    "one environment": ("MLIVR-JEM-v0", {}),
    "copies": ("MLIVR-JEM-v0, native vector, 256 sub-environments", {"native": True}),
}
"""Environments whose speed the README shows, with arguments of `benchmark_env.settings_of`."""

FIRST = {
    "compiled": "first plan with an empty cache, from the shell [s]",
    "again": "later plans from the shell [s]",
}
"""Runs of the first path of `start_up.py` that the README shows, as `BEFORE` names them."""

IN_README = (0, 1, 4, 5, 6, 7)
"""Indices of the values of `benchmark_planning.figures` that the README shows."""


def speed(planning: dict[str, Any], steps: dict[str, Any], start: dict[str, Any]) -> str:
    """Return the table of the speed of planner and environment with default settings."""
    before, plan = benchmark_planning.BEFORE, start["pythons"][0]["paths"]["plan"]
    wall = {"compiled": plan["first"]["wall"], "again": plan["again"]["wall"]}
    rows = [(what, f"{wall[how]:.3g}", before[how]) for how, what in FIRST.items()]
    figures = list(benchmark_planning.figures(planning))
    rows += [(figures[k][0], *figures[k][2:]) for k in IN_README]
    measured = {(row["what"], row["settings"]): row["wall"] for row in steps["rows"]}
    for name, (what, arguments) in STEPS.items():
        wall = measured[what, benchmark_env.settings_of(**arguments)]
        title = what.replace("MLIVR-JEM-v0", "steps a second of `MLIVR-JEM-v0`")
        rows.append((title, f"{float(f'{wall:.3g}'):,.0f}", before[name]))
    return table("default settings | measured | version 0.1.0", rows)


def at_first(planning: dict[str, Any], start: dict[str, Any]) -> str:
    """Return how soon a new user has first results, in one paragraph."""

    def told(path: str) -> str:
        """Return the times of a path for each Python."""
        runs = [(one["paths"][path], one["versions"]["Python"]) for one in start["pythons"]]
        return " and ".join(
            f"{run['first']['wall']:.0f} s "
            f"({run['again']['wall']:.1f} s from then on{warmed(run)}) "
            f"on Python {python}"
            for run, python in runs
        )

    def warmed(run: dict[str, Any]) -> str:
        once = run.get("warmed")
        return f", {once['wall']:.1f} s after `mlivr-gym warmup`" if once else ""

    new = planning["collisions on"]["steps"]["new goal"]["median"]
    return (
        "Machine code is compiled at first use, once for each version. On two cores with an empty "
        "cache the first command takes, without the\n"
        f"picture, {told('plan')};\nimport, `make`, `reset` and 100 steps of the environment "
        f"take {told('environment')}. In a program, a plan to a new goal takes {new:.1f} ms.\n"
    )


def benchmark_entries(folder: Path) -> str:
    """Return the table of the benchmark's entries, as `mlivr-gym benchmark table` prints it."""
    found = sorted(path.parent for path in folder.glob("*/summary.json"))
    return markdown_table({entry.name: BenchmarkEntry.read(entry) for entry in found})


def parts(results: Path) -> dict[str, str]:
    """Return the contents of the marked places by name."""

    def data(name: str) -> Any:
        return json.loads((results / f"{name}.json").read_text(encoding="utf-8"))

    return {
        "paper": paper(data("table1")),
        "benchmark": benchmark_entries(ROOT / "benchmark"),
        "policies": policies(data("planner_vs_rl")),
        "speed": speed(data("benchmark_planning"), data("benchmark_env"), data("start_up")),
        "at_first": at_first(data("benchmark_planning"), data("start_up")),
        "table1": table1(data("table1")),
        "table1_study": study(data("table1_study")),
        "truth": truth(data("truth")),
        "dynamic_simulation": dynamic_report.readme_text(data("dynamic_simulation")),
        "carried_out": dynamic_report.readme_sentence(
            data("dynamic_simulation"), data("disturbances")
        ),
        "limits": simulation_figures.limits(),
        "controller": simulation_figures.controller(),
        "disturbances": disturbances.readme_text(data("disturbances")),
        "closed_loop": closed_loop.sentence(data("closed_loop")),
        "benchmark_planning": benchmark_planning.targets(data("benchmark_planning")),
        "planner_vs_rl": comparison_report.readme_table(data("planner_vs_rl")),
        "robots": robots.markdown(data("robots")),
        "places": places.maps(),
        "place_sizes": places.markdown(data("places")),
        **format_tables.tables(),
    }


MARK = re.compile(r"^<!-- (\w+) -->\n(?:.*\n)*?<!-- end of \1 -->\n", re.MULTILINE)
"""A marked place with its contents."""


def filled(text: str, contents: dict[str, str]) -> str:
    """Return a page with its marked places filled."""

    def part(match: re.Match[str]) -> str:
        name = match[1]
        return f"<!-- {name} -->\n{contents[name]}<!-- end of {name} -->\n"

    return MARK.sub(part, text)


def pages() -> list[Path]:
    """Return the README and the pages of the docs."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


REPORTS: dict[str, Callable[[Any], str]] = {"table1": table_markdown}
"""Functions that make reports; others are called `markdown` in the script of the report's name."""


def report(path: Path) -> str:
    """Return the text of a report."""
    data = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    return (REPORTS.get(path.stem) or import_module(path.stem).markdown)(data)


def texts() -> dict[Path, str]:
    """Return the contents of each page that states measured values."""
    results = ROOT / "results"
    reports = {path: report(path) for path in results.glob("*.md")}
    contents = parts(results)
    return reports | {page: filled(page.read_text(encoding="utf-8"), contents) for page in pages()}


def stale() -> list[str]:
    """Return the pages that state other values than the results."""
    return [
        path.relative_to(ROOT).as_posix()
        for path, text in texts().items()
        if not path.exists() or path.read_text(encoding="utf-8") != text
    ]


def main() -> None:
    """Write all pages."""
    command_line(__doc__, None).parse_args()
    for path, text in texts().items():
        write_whole(path, text)


if __name__ == "__main__":
    main()
