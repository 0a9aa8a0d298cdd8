"""Put the figures of `results/` between the marks of the README.

    python experiments/readme.py

Each experiment writes its own files; this script alone copies what the README shows of them: Table I, the collision checks'
truth, the benchmark's targets, and the comparison of planners and policies.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from comparison_report import readme_table

from mlivr_gym.files import write_whole

ROOT = Path(__file__).parent.parent
CASES = {
    "1": "1: no thresholds, base cost", "2": "2: thresholds, base cost", "3": "3: thresholds, step cost",
    "4": "4: as 2, half the points, deck cleared",
}  # fmt: skip


def table1(data: dict[str, Any]) -> str:
    """Table I of the paper beside what was measured."""
    lines = [
        "| case | source | explored | base translation [m] | steps | least w_m | least w_b | time [s] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for case, title in CASES.items():
        paper = data["paper"][case]
        lines.append(
            f"| {title} | paper | {paper['expanded']} | {paper['base_translation']:.1f} | {paper['steps']} | {paper['w_m_min']:.2f} | "
            f"{paper['w_b_min']:.4f} | {paper['time']:g} |"
        )
        for source, key in (("measured", "measured"), ("with collisions", "measured_with_collisions")):
            row = data[key][case]
            lines.append(
                f"| | {source} | {row['expanded']} | {row['base_translation']:.2f} | {row['steps']} | {row['w_m_min']:.4f} | "
                f"{row['w_b_min']:.5f} | {row['stance_set_time']:.2f} + {row['search_time']:.3f} |"
            )
    return "\n".join(lines) + "\n"


def truth(data: dict[str, Any]) -> str:
    """What MuJoCo and coal say of the collision checks."""
    stances, steps, plans = data["stances"], data["steps"], data["plans"]
    could = sum(count for name, count in steps["blocked_because"].items() if name.endswith("swing exists"))
    lost = could / steps["blocked"]
    return (
        f"MuJoCo's collision pipeline finds {stances['free_penetrating']} penetrations in {stances['free']} random stances called "
        f"free, {steps['penetrating']} along {steps['free']}\nrandom steps and {plans['penetrating']} along {plans['plans']} random plans "
        f"({plans['configurations']} configurations); coal's least distance over those stances is\n"
        f"{1000 * stances['free_least_distance']:.1f} mm. All {stances['left_out_nearer_than_clearance']} of {stances['left_out']} stances "
        f"that only collisions keep out come nearer than the clearance in their best posture.\n"
        f"{100 * steps['share_blocked']:.0f} % of the steps between free stances that are possible in the paper's world are called "
        f"blocked; "
        f"for {100 * lost:.0f} % of a sample of those\na swing was found by looking at every branch and by a sampling planner: "
        f"{100 * lost * steps['share_blocked']:.0f} % of the possible steps is the price of caution.\n"
    )


def targets(report: str) -> str:
    """The benchmark's first table."""
    lines = report.splitlines()
    first = lines.index("| figure | target | measured | met |")
    return "\n".join(lines[first : lines.index("", first)]) + "\n"


def main() -> None:
    """Fill the README."""
    results = ROOT / "results"
    parts = {
        "table1": table1(json.loads((results / "table1.json").read_text(encoding="utf-8"))),
        "collision_truth": truth(json.loads((results / "collision_truth.json").read_text(encoding="utf-8"))),
        "benchmark_planning": targets((results / "benchmark_planning.md").read_text(encoding="utf-8")),
        "planner_vs_rl": readme_table(json.loads((results / "planner_vs_rl.json").read_text(encoding="utf-8"))),
    }
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for name, part in parts.items():
        first, last = f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"
        before, rest = text.split(first, 1)
        text = before + first + part + last + rest.split(last, 1)[1]
    write_whole(ROOT / "README.md", text)


if __name__ == "__main__":
    main()
