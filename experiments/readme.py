"""Tell the figures of `results/` in its pages and between the marks of README and site.

    python experiments/readme.py

Each experiment writes its figures as JSON and its page; this script tells all pages anew from the
JSON, and what README and the pages of `docs/` show of them. A place for figures is marked in a page
by `<!-- NAME -->` and `<!-- end of NAME -->`; `parts` has the names. The tables of fields in
`docs/formats.md` come from the schemas in the same way. `make test` fails when a page says
something else.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ablation
import benchmark_env
import comparison_report
import connectivity
import disturbances
import dynamic_report
import format_tables
import limb_starts
import many_limbs
import planning_report
import reference_curves
import simulation_figures
import start_up
import table1_statistics
import thresholds
import time_cost
from reports import NOTHING, ROOT, table
from table1 import study_markdown
from truth import told

from mlivr_gym.cli.table1 import HEAD, HEAD_LINE, table_markdown, table_rows
from mlivr_gym.files import write_whole

CASES = {
    "1": "1: no thresholds, base cost",
    "2": "2: thresholds, base cost",
    "3": "3: thresholds, step cost",
    "4": "4: as 2, half the points, deck cleared",
}


def table1(data: dict[str, Any]) -> str:
    """Table I of the paper beside what was measured."""
    lines = [HEAD, HEAD_LINE]
    for case, title in CASES.items():
        lines += table_rows(data, case, title)
    return "\n".join(lines) + "\n"


PRICE = 0.05
"""Price of a regrasp whose effect is told [m]."""


def study(data: dict[str, Any]) -> str:
    """How many node-only plans cannot be executed, and what a price of a regrasp does."""
    counts = data["transition_study"]
    free = next(row for row in data["pareto"] if row["price"] == 0.0)
    priced = next(row for row in data["pareto"] if row["price"] == PRICE)
    saved, more = (
        1.0 - priced["steps"] / free["steps"],
        priced["base_translation"] / free["base_translation"] - 1.0,
    )
    return (
        f"What the paper lacks: of {counts['pairs']} random tasks, {counts['blocked']} node-only "
        f"plans of the base cost and {counts['blocked_steps']} of the step cost could not have\n"
        f"been carried out; with steps checked {counts['solved']} of {counts['pairs']} get a plan "
        f"that can be, {100 * counts['extra_translation']:.2f} % longer on average. A price of "
        f"{PRICE:g} m\n"
        f"a regrasp saves {100 * saved:.0f} % of the steps for {100 * more:.1f} % more "
        "translation ([report](reports/table1_study.md)):\n"
    )


def truth(data: dict[str, Any]) -> str:
    """What outside truth says of the promises."""
    walks, optimal, collisions = data["walks"], data["optimality"], data["collisions"]
    stances, steps, plans = (collisions[name] for name in ("stances", "steps", "plans"))
    return f"""{walks["put_together"]} of {walks["walks"]} random walks of {walks["steps"]} legal \
steps were put together. Of {optimal["queries"]} random queries on half the points, collisions on,
{optimal["outcomes"].get("existence differs", 0)} differ in existence from SciPy's Dijkstra over \
`successors`, and the costs of {optimal["found"]} plans by at most \
{optimal["largest_difference"]:.0e}.
MuJoCo's collision pipeline finds {stances["free_penetrating"]} penetrations in {stances["free"]} \
random stances called free, {steps["penetrating"]} along {steps["free"]}
random steps and {plans["penetrating"]} along {plans["plans"]} random plans \
({plans["configurations"]} configurations); coal's least distance over those stances is
{1000 * stances["free_least_distance"]:.1f} mm. All {stances["left_out_nearer_than_clearance"]} of \
{stances["left_out"]} stances that only collisions keep out come nearer than the clearance in \
their best posture.
{100 * steps["share_blocked"]:.0f} % of the steps between free stances that are possible in the \
paper's world are called blocked.
"""


def paper(data: dict[str, Any]) -> str:
    """Steps and base translation of the paper's cases beside those found here, in a few columns."""

    def cell(row: dict[str, Any], digits: int) -> str:
        return f"{row['steps']:.0f}, {row['base_translation']:.{digits}f} m"

    modes = {"as in the paper": "faithful", "steps and collisions checked": "collisions"}
    lines = [f"| case | paper | {' | '.join(modes)} |", "|---|---|---|---|"]
    for case, title in CASES.items():
        measured = (cell(data["measured"][mode][case], 2) for mode in modes.values())
        lines.append(f"| {title} | {cell(data['paper'][case], 1)} | {' | '.join(measured)} |")
    return "\n".join(lines) + "\n"


SHOWN = ("astar-steps", "astar-base", "mcts", "local", "dagger-pointer", "random")
"""Methods that the README shows."""


def policies(data: dict[str, Any]) -> str:
    """Success and steps of some methods, on the map that is known and on halves of its points."""
    names, splits = comparison_report.NAMES, ("same", "half")
    found = [dict(comparison_report.table_rows(data, split)) for split in splits]
    lines = ["| method | same map | half the points | an action [ms] |", "|---|---|---|---|"]
    for name in SHOWN:
        cells = [
            f"{rows[name][0].split(' [')[0]}, {rows[name][2].split(' [')[0]}" for rows in found
        ]
        lines.append(f"| {names[name]} | {' | '.join(cells)} | {found[0][name][6]} |")
    return "\n".join(lines) + "\n"


STEPS = {
    "one environment": ("MLIVR-JEM-v0", {}),
    "copies": ("MLIVR-JEM-v0, native vector, 256 copies", {"native": True}),
}
"""Environments that the README times, and how they are set, see `benchmark_env.settings_of`."""

FIRST = {
    "ready-made": "first plan of an installation, from the shell [s]",
    "again": "later plans from the shell [s]",
}
"""Runs of the first path of `start_up.py` that the README shows."""

IN_README = (0, 1, 4, 5, 7, 8)
"""Figures of `planning_report.figures` that the README shows."""


def speed(planning: dict[str, Any], steps: dict[str, Any], paths: dict[str, Any]) -> str:
    """Return the table of the speed of planner and environment with default settings."""
    before, first = planning_report.BEFORE, paths["plan"]
    rows = [
        (what, f"{first[how]['wall']:.3g}", before.get(how, NOTHING)) for how, what in FIRST.items()
    ]
    figures = list(planning_report.figures(planning))
    rows += [(figures[k].what, figures[k].measured, figures[k].before) for k in IN_README]
    measured = {(row["what"], row["settings"]): row["wall"] for row in steps["rows"]}
    for name, (what, arguments) in STEPS.items():
        wall = measured[what, benchmark_env.settings_of(**arguments)]
        title = what.replace("MLIVR-JEM-v0", "steps a second of `MLIVR-JEM-v0`")
        rows.append((title, f"{float(f'{wall:.3g}'):,.0f}", before[name]))
    return table("default settings | measured | version 0.1.0", rows)


def at_first(planning: dict[str, Any], paths: dict[str, Any]) -> str:
    """How soon a new user has the first answers, in one sentence."""
    wall = {name: f"{paths[name]['ready-made']['wall']:.1f}" for name in ("plan", "environment")}
    new = planning["collisions on"]["steps"]["new goal"]["median"]
    return (
        "On two cores, right after installation, the first command takes "
        f"{wall['plan']} s without the picture.\nImport, `make`, `reset` and 100 steps of the "
        f"environment take {wall['environment']} s. In a program, a plan\nto a new goal takes "
        f"{new:.1f} ms (fewest steps, median).\n"
    )


def parts(results: Path) -> dict[str, str]:
    """What stands between the marks of pages, by the names of the marks."""

    def data(name: str) -> Any:
        return json.loads((results / f"{name}.json").read_text(encoding="utf-8"))

    return {
        "paper": paper(data("table1")),
        "policies": policies(data("planner_vs_rl")),
        "speed": speed(
            data("benchmark_planning"), data("benchmark_env"), data("start_up")["paths"]
        ),
        "at_first": at_first(data("benchmark_planning"), data("start_up")["paths"]),
        "table1": table1(data("table1")),
        "table1_study": study(data("table1_study")),
        "truth": truth(data("truth")),
        "dynamic_simulation": dynamic_report.readme_text(data("dynamic_simulation")),
        "carried_out": dynamic_report.in_one_line(data("dynamic_simulation"), data("disturbances")),
        "limits": simulation_figures.limits(),
        "controller": simulation_figures.controller(),
        "disturbances": disturbances.readme_text(data("disturbances")),
        "benchmark_planning": planning_report.targets(data("benchmark_planning")),
        "planner_vs_rl": comparison_report.readme_table(data("planner_vs_rl")),
        "limb_starts": limb_starts.told(data("limb_starts")),
        **format_tables.tables(),
    }


MARK = re.compile(r"^<!-- (\w+) -->\n(?:.*\n)*?<!-- end of \1 -->\n", re.MULTILINE)
"""A marked place, with what stands in it."""


def filled(text: str, told: dict[str, str]) -> str:
    """A page with what belongs between its marks."""

    def part(match: re.Match[str]) -> str:
        name = match[1]
        return f"<!-- {name} -->\n{told[name]}<!-- end of {name} -->\n"

    return MARK.sub(part, text)


def pages() -> list[Path]:
    """The README and the pages of the site, which may have marks."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


REPORTS: dict[str, Callable[[Any], str]] = {
    "table1": table_markdown,
    "table1_study": study_markdown,
    "table1_statistics": table1_statistics.told,
    "thresholds": thresholds.markdown,
    "truth": told,
    "dynamic_simulation": dynamic_report.markdown,
    "disturbances": disturbances.markdown,
    "time_cost": time_cost.markdown,
    "connectivity": connectivity.markdown,
    "many_limbs": many_limbs.markdown,
    "ablation": ablation.markdown,
    "start_up": start_up.report,
    "benchmark_env": benchmark_env.report,
    "benchmark_planning": planning_report.report,
    "planner_vs_rl": comparison_report.full_report,
    "reference_curves": reference_curves.told,
}
"""What tells each file of results as a page of the same name."""


def texts() -> dict[Path, str]:
    """What each page that carries figures must say."""
    results = ROOT / "results"
    reports = {
        results / f"{name}.md": tell(
            json.loads((results / f"{name}.json").read_text(encoding="utf-8"))
        )
        for name, tell in REPORTS.items()
    }
    told = parts(results)
    return reports | {page: filled(page.read_text(encoding="utf-8"), told) for page in pages()}


def stale() -> list[str]:
    """Pages that say other figures than the results."""
    return [
        path.relative_to(ROOT).as_posix()
        for path, text in texts().items()
        if not path.exists() or path.read_text(encoding="utf-8") != text
    ]


def main() -> None:
    """Write all pages."""
    for path, text in texts().items():
        write_whole(path, text)


if __name__ == "__main__":
    main()
