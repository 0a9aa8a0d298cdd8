"""Measure whether the thresholds of manipulability predict how well a walk is executed.

    python experiments/thresholds.py [--pairs 20] [--workers 2] [--out results]

Both thresholds are scaled by each factor of `FACTORS`. For each factor, random walks from the deck
to the overhead are planned for the base cost with steps and collisions checked, and executed in
MuJoCo in two setups: the paper's controller at 50 s a step without disturbances, and the full
controller at the gentle pace with all disturbances. The error of each step is compared with the
minimum manipulability of the two stances that it joins. Writes `thresholds.json`, `thresholds.md`
and `thresholds.png`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from reports import CORES, experiment, study_rows, table, two_limb_graph
from scipy.stats import spearmanr
from table1_statistics import random_pair

from mlivr_gym import Settings
from mlivr_gym.errors import StanceError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.pictures.figures import save_figure
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.controller import PAPER
from mlivr_gym.simulation.disturbances import ALL
from mlivr_gym.simulation.execution import execute_timed_plan, timed_plan
from mlivr_gym.simulation.limits import GENTLE
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

FACTORS = (0.0, 0.5, 1.0, 1.25)
"""Thresholds as a multiple of the paper's."""

SETUPS = {
    "the paper's PD, 50 s": Setup(Durations.of_step(50.0), PAPER),
    "full, gentle, all disturbances": Setup(GENTLE, disturbances=ALL),
}
"""The two setups of execution."""

Measure = dict[str, Any]


def walk(task: int, factor: float) -> dict[str, Any]:
    """Plan a random pair under scaled thresholds, and execute the plan in both setups."""
    limb, base = (factor * whole for whole in Settings().thresholds(2))
    graph = two_limb_graph(limb_threshold=limb, base_threshold=base)
    start, goal = random_pair(task)
    try:
        plan = Planner(graph).plan(start.stance, goal, "base", goal_face="overhead").plan
    except StanceError:  # the start does not meet the thresholds
        plan = None
    found = None if plan is None else plan_results(graph, plan, task)
    return {"stances": len(graph), "plan": found}


def measured(pairs: int, workers: int) -> Measure:
    """Return the plans under scaled thresholds and the results of their execution."""
    rows = study_rows("thresholds:walk", pairs, workers, factor=FACTORS)
    found = []
    for factor in FACTORS:
        some = [row for row in rows if row["factor"] == factor]
        plans = [row["plan"] for row in some if row["plan"] is not None]
        found.append({"factor": factor, "stances": some[0]["stances"], "plans": plans})
    return {"pairs": pairs, "rows": found}


def plan_results(graph: TwoLimbGraph, plan: Plan, seed: int) -> Measure:
    """Return steps of a plan, manipulability of its stances and errors of its executed steps."""
    postures = [graph.posture(graph.indices(stance)) for stance in plan.stances]
    results: Measure = {
        "steps": len(plan.steps),
        "base_translation": plan.base_translation,
        "expanded": plan.statistics.expanded,
        "w_m": [float(posture.w_m.min()) for posture in postures],
        "w_b": [float(posture.w_b[0]) for posture in postures],
    }
    for name, setup in SETUPS.items():
        walk = timed_plan(graph, plan, setup.timing, setup.physics.timestep)
        done = execute_timed_plan(
            setup.simulation(graph.grasp_map, graph.robot, seed=seed + 1), walk
        )
        steps = done[: len(plan.steps)]
        results[name] = {
            "failure": None if done[-1].failure is None else done[-1].failure.kind,
            "base_error": [step.peaks.base_error for step in steps],
            "joint_torque": [float(step.peaks.joint_torque.max()) for step in steps],
            "capture": [step.capture.distance if step.capture else None for step in steps],
        }
    return results


def pooled(rows: list[Measure], name: str) -> dict[str, list[float]]:
    """Return minimum manipulability, base error and capture of steps that ended with a grasp."""
    out: dict[str, list[float]] = {"w_m": [], "w_b": [], "base_error": [], "capture": []}
    for plan in (plan for row in rows for plan in row["plans"]):
        done = plan[name]
        for k, capture in enumerate(done["capture"]):
            if capture is None:
                continue
            for w in ("w_m", "w_b"):
                out[w].append(min(plan[w][k : k + 2]))
            out["base_error"].append(done["base_error"][k])
            out["capture"].append(capture)
    return out


def average(values: Sequence[float], form: str, scale: float = 1.0) -> str:
    """Return the scaled mean as text, `-` if there are no values."""
    return format(scale * float(np.mean(values)), form) if values else "-"


ROWS = (
    "share | stances | plans | explored | steps | base translation [m] | carried out by | "
    "share carried out | base error [mm] | capture [mm]"
)
CORRELATIONS = (
    "carried out by | steps | base error, `w_m` | base error, `w_b` | capture, `w_m` | "
    "capture, `w_b`"
)
"""Heads of the tables."""


def markdown(data: Measure) -> str:
    """Return the page."""
    limb, base = Settings().thresholds(2)
    rows, correlations = [], []
    for row in data["rows"]:
        plans = row["plans"]
        for name in SETUPS:
            steps, ended = pooled([row], name), [plan[name]["failure"] is None for plan in plans]
            rows.append([
                f"{row['factor']:g}", row["stances"], len(plans),
                average([plan["expanded"] for plan in plans], ".0f"),
                average([plan["steps"] for plan in plans], ".2f"),
                average([plan["base_translation"] for plan in plans], ".3f"),
                name, f"{sum(ended)} of {len(plans)}",
                *(average(steps[what], ".2f", 1e3) for what in ("base_error", "capture")),
            ])  # fmt: skip
    for name in SETUPS:
        steps = pooled(data["rows"], name)
        found = [
            f"{spearmanr(steps[w], steps[what]).statistic:+.2f}"
            for what in ("base_error", "capture")
            for w in ("w_m", "w_b")
        ]
        correlations.append([name, len(steps["w_m"]), *found])
    return f"""# Do the thresholds predict how well a walk is carried out?

Made by `experiments/thresholds.py`: {data["pairs"]} random pairs from the deck to the overhead, \
base cost, steps and collisions checked; thresholds as a multiple of the paper's, which are \
{limb:g} and {base:g}. *Base error*: largest distance of the base from its trajectory in a step; \
*capture*: distance of the gripper from its point just before it grasps; both are means over the \
steps that ended with a grasp.

![Base error against manipulability](thresholds.png)

{table(ROWS, rows)}
Spearman's rank correlation between an error of a step and the minimum manipulability of its two \
stances, over the steps of all rows. A threshold predicts an error if the correlation is clearly \
negative.

{table(CORRELATIONS, correlations)}"""


def figure(data: Measure, path: Path) -> None:
    """Plot the base error of each step against both manipulabilities, for each setup."""
    fig = Figure(figsize=(10.0, 6.5), layout="constrained")
    axes = fig.subplots(len(SETUPS), 2, squeeze=False)
    for line, name in zip(axes, SETUPS, strict=True):
        steps = pooled(data["rows"], name)
        for ax, w, least in zip(line, ("w_m", "w_b"), Settings().thresholds(2), strict=True):
            ax.scatter(steps[w], 1e3 * np.array(steps["base_error"]), s=12, alpha=0.6)
            ax.axvline(least, color="tab:red", lw=1, label="the paper's threshold")
            ax.set(
                xlabel=f"minimum {w} of the step's stances", ylabel="base error [mm]", title=name
            )
            ax.set_ylim(bottom=0.0)
            ax.grid(alpha=0.3)
    axes[0, 0].legend(loc="upper right", fontsize=8)
    save_figure(fig, path)


if __name__ == "__main__":
    experiment(
        "thresholds", __doc__, measured, markdown, figure, indent=None, pairs=20, workers=CORES
    )
