"""Measure what the check of steps adds to the paper's Table I, and what a price of regrasps does.

    python experiments/table1_study.py [--out results] [--pairs 200] [--workers 2]

Table I itself is made by `mlivr-gym table1 --out results`. Two studies on random tasks: how many
plans that check nodes alone cannot be executed, and how a price for each regrasp trades steps for
base translation. Writes `table1_study.json`, `table1_study.md` and `pareto.png`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from reports import CORES, experiment, graph_and_tasks, study_rows, table, two_limb_graph

from mlivr_gym.extensions.viewer import states_of
from mlivr_gym.pictures import save_figure
from mlivr_gym.pictures.figures import BASE_COLOUR
from mlivr_gym.planners import Planner

PRICES = (0.0, 0.005, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
"""Prices of a regrasp on the Pareto front [m]."""


def checked_pair(task: int, pairs: int) -> dict[str, Any]:
    """Return which plans that check nodes alone cannot be executed, and both base translations."""
    graph, drawn = graph_and_tasks(pairs, 2026, collisions=False)
    free, (start, goal) = two_limb_graph(transitions=False, collisions=False), drawn[task]
    base, steps = (
        Planner(free).plan(start.stance, goal, cost).unwrap() for cost in ("base", "steps")
    )
    checked = Planner(graph).plan(start.stance, goal, "base").plan
    return {
        "blocked": None in states_of(graph, base),
        "blocked_steps": None in states_of(graph, steps),
        "free": base.base_translation,
        "checked": None if checked is None else checked.base_translation,
    }


def transition_study(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Count the plans of both costs that check nodes alone and cannot be executed."""
    solved = [row for row in rows if row["checked"] is not None]
    return {
        "pairs": len(rows),
        "blocked": sum(row["blocked"] for row in rows),
        "blocked_steps": sum(row["blocked_steps"] for row in rows),
        "solved": len(solved),
        "extra_translation": float(
            np.mean([row["checked"] / row["free"] - 1.0 for row in solved if row["free"] > 0.0])
        ),
    }


def priced_pair(task: int, price: float, pairs: int) -> dict[str, Any]:
    """Return steps and base translation [m] of the plan of a random task at a price of regrasps."""
    graph, drawn = graph_and_tasks(pairs, 7, collisions=False)
    start, goal = drawn[task]
    plan = Planner(graph).plan(start.stance, goal, "weighted", regrasp_price=price).unwrap()
    return {"steps": len(plan.steps), "base_translation": plan.base_translation}


def measured(pairs: int, workers: int) -> dict[str, Any]:
    """Return the results of both studies, the second as means at each price of a regrasp."""
    checked = study_rows("table1_study:checked_pair", pairs, workers, pairs=[pairs])
    rows = study_rows("table1_study:priced_pair", pairs, workers, price=PRICES, pairs=[pairs])
    pareto = [
        {"price": price}
        | {
            name: float(np.mean([row[name] for row in rows if row["price"] == price]))
            for name in ("steps", "base_translation")
        }
        for price in PRICES
    ]
    return {"transition_study": transition_study(checked), "pareto": pareto}


def draw_pareto(study: dict[str, Any], path: Path) -> None:
    """Draw the results of `pareto`, with the translation in percent above its minimum."""
    rows, pairs = study["pareto"], study["transition_study"]["pairs"]
    metres = np.array([row["base_translation"] for row in rows])
    steps, least = np.array([row["steps"] for row in rows]), metres.min()
    over = 100.0 * (metres / least - 1.0)
    figure = Figure(figsize=(6.8, 4.6), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    axes.plot(steps, over, color="0.7", zorder=1)
    axes.scatter(steps, over, color=BASE_COLOUR, zorder=2)
    for row, place in zip(rows, zip(steps, over, strict=True), strict=True):
        axes.annotate(f"{row['price']:g} m", place, (6, 4), textcoords="offset points", fontsize=8)
    axes.set_xlabel(f"steps, mean of {pairs} random tasks")
    axes.set_ylabel(f"base translation over the least,\nwhich is {least:.3f} m [%]")
    axes.set_title("Steps bought with translation: price of a regrasp")
    words = (
        f"Mind the scales: in all, the translations differ by {over.max():.1f} %\n"
        f"({1e3 * (metres.max() - least):.0f} mm), "
        f"the steps by {100 * (steps.max() / steps.min() - 1):.0f} %."
    )
    corner: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": 9, "color": "0.25"}
    axes.text(0.98, 0.96, words, transform=axes.transAxes, **corner)
    axes.margins(x=0.15, y=0.15)
    axes.spines[["top", "right"]].set_visible(False)
    save_figure(figure, path.with_stem("pareto"))


def markdown(study: dict[str, Any]) -> str:
    """Return the page of both studies."""
    counts, pairs = study["transition_study"], study["transition_study"]["pairs"]
    base, steps = (
        f"{count} ({100 * count / pairs:.0f} %)"
        for count in (counts["blocked"], counts["blocked_steps"])
    )
    rows = [
        [f"{row['price']:g}", f"{row['steps']:.2f}", f"{row['base_translation']:.3f}"]
        for row in study["pareto"]
    ]
    return f"""# Beyond Table I

**Can the plan be executed?** Of {pairs} random start and goal pairs, {base} plans of the \
base cost and {steps} of the step cost that check only nodes cannot be executed: in at least one \
step a support limb would have to let go or pass a singularity. With steps checked, \
{counts["solved"]} of {pairs} pairs get an executable plan; its base translation is \
{100 * counts["extra_translation"]:.2f} % longer on average.

**Steps bought with translation** (weighted cost, means over random pairs, see `pareto.png`):

{table("price of a regrasp [m] | steps | base translation [m]", rows)}"""


if __name__ == "__main__":
    experiment("table1_study", __doc__, measured, markdown, draw_pareto, pairs=200, workers=CORES)
