"""Do the thresholds predict what they are for? Plans under others, carried out in MuJoCo.

    python experiments/thresholds.py [--out results] [--pairs 20] [--workers 1]

Walks from the deck to the overhead, least translation, steps and collisions checked, with both
thresholds at a share of the paper's. Each is carried out as fast as the default limits allow, by a
robot that is as the controller knows it, and gently with all disturbances at once. Writes
`thresholds.json` and `thresholds.md`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr
from table1_statistics import random_pair
from tqdm import tqdm

from mlivr_gym import Settings, stance_graph
from mlivr_gym.errors import StanceError
from mlivr_gym.files import write_whole
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.simulation.disturbances import ALL
from mlivr_gym.simulation.limits import GENTLE
from mlivr_gym.simulation.monte_carlo import execute_many
from mlivr_gym.simulation.setup import Setup

FACTORS = (0.0, 0.5, 0.75, 1.0, 1.25)
"""Thresholds, as shares of the paper's; with 1.5 times them no walk is left."""

SETUPS = {"as known": Setup(), "disturbed": Setup(GENTLE, disturbances=ALL)}

FIGURES = {
    "seconds": "time a step [s]",
    "base_error_mm": "base error [mm]",
    "grasp_force_N": "grasp force [N]",
}
"""What is measured of a walk that is carried out, in words; the largest, but for time."""

SEED = 18_000


def plans(factor: float, pairs: int) -> tuple[Any, list[Plan]]:
    """The graph under a share of the thresholds, and plans of random pairs."""
    limb, base = Settings().thresholds(2)
    settings = Settings(limb_threshold=factor * limb, base_threshold=factor * base)
    graph, found = stance_graph(settings=settings), []
    for seed in range(pairs):
        start, goal = random_pair(seed)
        try:
            plan = Planner(graph).plan(start.stance, goal, "base", goal_face="overhead").plan
        except StanceError:
            continue
        if plan is not None and plan.steps:
            found.append(plan)
    return graph, found


def measured(pairs: int, workers: int) -> dict[str, Any]:
    """All walks."""
    rows = []
    for factor in FACTORS:
        graph, found = plans(factor, pairs)
        for name, setup in SETUPS.items():
            outcomes = execute_many(graph, found, setup, seed=SEED, workers=workers)
            told = tqdm(outcomes, total=len(found), desc=f"{factor:g} {name}", mininterval=5.0)
            for plan, outcome in zip(found, told, strict=True):
                rows.append(
                    {
                        "factor": factor,
                        "setup": name,
                        "w_m": plan.w_m_min,
                        "w_b": plan.w_b_min,
                        "steps": len(plan.steps),
                        "base_translation": plan.base_translation,
                        "carried_out": outcome.message is None,
                        "seconds": outcome.time / max(outcome.done, 1),
                        "base_error_mm": 1e3 * outcome.base_error,
                        "grasp_force_N": outcome.grasp_force,
                    }
                )
    return {"pairs": pairs, "walks": rows}


def markdown(data: dict[str, Any]) -> str:
    """The report."""
    lines = [
        "# Do the thresholds predict what they are for?",
        "",
        f"Made by `experiments/thresholds.py`: {data['pairs']} random pairs of deck and overhead, "
        "both thresholds at a share of the paper's, base cost, steps and collisions checked.",
        "*As known*: as fast as the default limits allow, the robot as the controller knows it. "
        "*Disturbed*: gently, with all disturbances at once. Means over the walks carried out;",
        "errors and forces are the largest of each walk.",
        "",
    ]
    for name in SETUPS:
        lines += [
            f"## {name.capitalize()}",
            "",
            "| share of the thresholds | walks | carried out | steps | base translation [m] "
            f"| {' | '.join(FIGURES.values())} |",
            "|---|---|---|---|---|---|---|---|",
        ]
        walks = [row for row in data["walks"] if row["setup"] == name]
        for factor in FACTORS:
            rows = [row for row in walks if row["factor"] == factor]
            done = [row for row in rows if row["carried_out"]]
            whole = [np.mean([row[f] for row in rows]) for f in ("steps", "base_translation")]
            shown = [np.mean([row[figure] for row in done]) for figure in FIGURES]
            lines.append(
                f"| {factor:g} | {len(rows)} | {len(done)} | {whole[0]:.2f} | {whole[1]:.2f} | "
                + " | ".join(f"{value:.1f}" for value in shown)
                + " |"
            )
        lines += ["", _correlations([row for row in walks if row["carried_out"]]), ""]
    return "\n".join(lines)


def _correlations(rows: list[dict[str, Any]]) -> str:
    """How the least manipulabilities of walks go with what was measured."""
    told = []
    for figure, words in FIGURES.items():
        found = [
            spearmanr([row[name] for row in rows], [row[figure] for row in rows])
            for name in ("w_m", "w_b")
        ]
        values = " and ".join(
            f"{one.statistic:+.2f} (p {one.pvalue:.2g}) with `{name}`"
            for name, one in zip(("w_m", "w_b"), found, strict=True)
        )
        told.append(f"{words}: {values}")
    return f"Rank correlation over all {len(rows)} walks, least of the walk: {'; '.join(told)}."


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("results"))
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    data = measured(args.pairs, args.workers)
    write_whole(args.out / "thresholds.json", json.dumps(data, indent=1) + "\n")
    write_whole(args.out / "thresholds.md", markdown(data))


if __name__ == "__main__":
    main()
