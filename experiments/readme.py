"""Tell the figures of `results/` in its pages and between the marks of the README.

    python experiments/readme.py

Each experiment writes its figures as JSON and its page; this script tells all pages anew from the
JSON, and copies what the README shows of them: Table I and its study, the promises against truth,
what the simulation measured, the paper's torques, the benchmark's targets, and the comparison of
planners and policies.
`make test` fails when a page says something else.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import comparison_report
import dynamic_report
import paper_figures_report
import planning_report
import reference_curves
import table1_statistics
from table1 import study_markdown
from truth import told

from mlivr_gym.cli.table1 import HEAD, HEAD_LINE, rows_of, table_markdown
from mlivr_gym.files import write_whole

ROOT = Path(__file__).parent.parent
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
        lines += rows_of(data, case, title)
    return "\n".join(lines) + "\n"


PRICE = 0.05
"""Price of a regrasp whose effect the README tells [m]."""


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
        "translation ([`results/table1_study.md`](results/table1_study.md)):\n"
    )


def truth(data: dict[str, Any]) -> str:
    """What outside truth says of the promises."""
    walks, windows, optimal = data["walks"], data["windows"], data["optimality"]
    return (
        f"{walks['put_together']} of {walks['walks']} random walks of {walks['steps']} legal steps "
        "were put together. "
        f"{100 * windows['lost'] / windows['able']:.1f} % of the steps that holding limbs\n"
        "could follow are no edges for the windows. Of "
        f"{optimal['queries']} random queries on half the points, collisions on, "
        f"{optimal['outcomes'].get('existence differs', 0)} differ in existence from SciPy's\n"
        f"Dijkstra over `successors`, and the costs of {optimal['found']} plans by at most "
        f"{optimal['largest_difference']:.0e}.\n" + collisions(data["collisions"])
    )


def collisions(data: dict[str, Any]) -> str:
    """What MuJoCo and coal say of the collision checks."""
    stances, steps, plans = data["stances"], data["steps"], data["plans"]
    could = sum(
        count for name, count in steps["blocked_because"].items() if name.endswith("swing exists")
    )
    lost = could / steps["blocked"]
    return (
        f"MuJoCo's collision pipeline finds {stances['free_penetrating']} penetrations in "
        f"{stances['free']} random stances called free, {steps['penetrating']} along "
        f"{steps['free']}\n"
        f"random steps and {plans['penetrating']} along {plans['plans']} random plans "
        f"({plans['configurations']} configurations); coal's least distance over those stances "
        "is\n"
        f"{1000 * stances['free_least_distance']:.1f} mm. All "
        f"{stances['left_out_nearer_than_clearance']} of {stances['left_out']} stances that only "
        "collisions keep out come nearer than the clearance in their best posture.\n"
        f"{100 * steps['share_blocked']:.0f} % of the steps between free stances that are "
        f"possible in the paper's world are called blocked; for {100 * lost:.0f} % of a sample of "
        "those\n"
        "a swing was found by looking at every branch and by a sampling planner: "
        f"{100 * lost * steps['share_blocked']:.0f} % of the possible steps is the price of "
        "caution.\n"
    )


def targets(report: str) -> str:
    """The benchmark's first table."""
    lines = report.splitlines()
    first = lines.index("| figure | target | measured | met |")
    return "\n".join(lines[first : lines.index("", first)]) + "\n"


def filled(text: str, results: Path) -> str:
    """The README with the figures of a folder of results between its marks."""

    def data(name: str) -> Any:
        return json.loads((results / f"{name}.json").read_text(encoding="utf-8"))

    parts = {
        "table1": table1(data("table1")),
        "table1_study": study(data("table1_study")),
        "truth": truth(data("truth")),
        "dynamic_simulation": dynamic_report.readme_text(data("dynamic_simulation")),
        "paper_figures": paper_figures_report.readme_text(data("paper_figures")),
        "benchmark_planning": targets(planning_report.report(data("benchmark_planning"))),
        "planner_vs_rl": comparison_report.readme_table(data("planner_vs_rl")),
    }
    for name, part in parts.items():
        first, last = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
        before, rest = text.split(first, 1)
        text = before + first + part + last + rest.split(last, 1)[1]
    return text


REPORTS: dict[str, Callable[[Any], str]] = {
    "table1": table_markdown,
    "table1_study": study_markdown,
    "table1_statistics": table1_statistics.told,
    "truth": told,
    "dynamic_simulation": dynamic_report.markdown,
    "paper_figures": paper_figures_report.markdown,
    "benchmark_planning": planning_report.report,
    "planner_vs_rl": comparison_report.full_report,
    "reference_curves": reference_curves.told,
}
"""What tells each file of results as a page of the same name."""


def texts() -> dict[Path, str]:
    """What each page that carries figures must say."""
    results, readme = ROOT / "results", ROOT / "README.md"
    pages = {
        results / f"{name}.md": tell(
            json.loads((results / f"{name}.json").read_text(encoding="utf-8"))
        )
        for name, tell in REPORTS.items()
    }
    return pages | {readme: filled(readme.read_text(encoding="utf-8"), results)}


TIMES = re.compile(r"[\d.]+ \+ [\d.]+ \|$", re.MULTILINE)
"""Times of Table I, at the end of its rows: `make demo` measures them anew, on any machine."""


def same_figures(text: str, other: str) -> bool:
    """Whether two texts say the same, but for the times of Table I."""
    return TIMES.sub("", text) == TIMES.sub("", other)


def stale() -> list[str]:
    """Pages that say other figures than the results."""
    return [
        path.relative_to(ROOT).as_posix()
        for path, text in texts().items()
        if not path.exists() or not same_figures(path.read_text(encoding="utf-8"), text)
    ]


def main() -> None:
    """Write all pages."""
    for path, text in texts().items():
        write_whole(path, text)


if __name__ == "__main__":
    main()
