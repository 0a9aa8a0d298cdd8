"""Measure what the check of steps adds to the paper's Table I, and what a price of regrasps does.

    python experiments/table1_study.py [--out results] [--pairs 200]

Table I itself is made by `mlivr-gym table1 --out results`. Two studies on random tasks: how many
plans that check nodes alone cannot be executed, and how a price for each regrasp trades steps for
base translation. Writes `table1_study.json`, `table1_study.md` and `pareto.png`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from reports import experiment, table, two_limb_graph
from tqdm import tqdm

from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.pictures.figures import BASE_COLOUR, save_figure
from mlivr_gym.planners import Planner
from mlivr_gym.viewer.marks import states_of

PRICES = (0.0, 0.005, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
"""Prices of a regrasp on the Pareto front [m]."""


def transition_study(pairs: int) -> dict[str, Any]:
    """Count the plans of both costs that check nodes alone and cannot be executed."""
    checked = two_limb_graph(collisions=False)
    free = two_limb_graph(transitions=False, collisions=False)
    planner, node_only = Planner(checked), Planner(free)
    rng = np.random.default_rng(2026)
    blocked = {"base": 0, "steps": 0}
    extra, solved = [], 0
    for _ in tqdm(range(pairs), desc="node-only plans", mininterval=2.0):
        start, goal = sample_task(checked, rng, 0.2)
        for cost in blocked:
            plan = node_only.plan(start.stance, goal, cost).unwrap()
            blocked[cost] += None in states_of(checked, plan)
            if cost == "base":
                with_check = planner.plan(start.stance, goal, cost).plan
                solved += with_check is not None
                if with_check is not None and plan.base_translation > 0.0:
                    extra.append(with_check.base_translation / plan.base_translation - 1.0)
    return {
        "pairs": pairs,
        "blocked": blocked["base"],
        "blocked_steps": blocked["steps"],
        "solved": solved,
        "extra_translation": float(np.mean(extra)),
    }


def pareto(pairs: int) -> list[dict[str, float]]:
    """Return mean steps and mean base translation over random tasks for each price of a regrasp."""
    graph = two_limb_graph(collisions=False)
    planner, rng = Planner(graph), np.random.default_rng(7)
    tasks = [sample_task(graph, rng, 0.2) for _ in range(pairs)]
    rows = []
    for price in tqdm(PRICES, desc="prices of a regrasp", mininterval=2.0):
        plans = [
            planner.plan(s.stance, g, "weighted", regrasp_price=price).unwrap() for s, g in tasks
        ]
        rows.append(
            {
                "price": price,
                "steps": float(np.mean([len(plan.steps) for plan in plans])),
                "base_translation": float(np.mean([plan.base_translation for plan in plans])),
            }
        )
    return rows


def measured(pairs: int) -> dict[str, Any]:
    """Return the results of both studies."""
    return {"transition_study": transition_study(pairs), "pareto": pareto(pairs)}


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
    experiment("table1_study", __doc__, measured, markdown, draw_pareto, pairs=200)
