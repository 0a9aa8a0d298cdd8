"""Find a start and a goal for which the four cases agree best with the paper's Table I.

    python experiments/calibrate_start_goal.py [--pairs 3000]

The paper's map, start and goal are not public; its figures imply a walk from the deck to the
overhead with a base translation of about 4.4 m. Candidate starts are stances on the deck with the
base within 0.6 m of (1.84, 0, -0.35). Candidate goals are base positions of stances on the overhead
within 0.6 m of (6.0, 0, 0.42), rounded to 0.05 m; both limbs must hold the overhead there. Random
pairs are planned for Cases 1 to 3 in the paper-faithful mode, and the seed of the sparse map of
Case 4 is chosen last. The mismatch adds relative errors of base translation, steps and minimum
manipulabilities; relations between the cases are not part of it. Plans must exist for all cases in
the other modes, too. Writes `envs_assets/table1_setup.json`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from mlivr_gym.arrays import Array
from mlivr_gym.errors import StanceError
from mlivr_gym.files import write_whole
from mlivr_gym.paper import CASES, MODES, PAPER, SETUP, case_graph
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

START, GOAL, RADIUS = (1.84, 0.0, -0.35), (6.0, 0.0, 0.42), 0.6
"""Candidate starts and goals lie within `RADIUS` of these base positions [m]."""

FACE = "overhead"
"""Face on which walks end."""

SEEDS = range(60)
"""Candidate seeds of the sparse map."""

FINALISTS = 200
"""Number of pairs with the smallest mismatch that are planned in all modes."""


def mismatch(case: int, plan: Plan) -> float:
    """Return the weighted sum of relative errors of one case against the paper's row."""
    row = PAPER[case]
    return (
        abs(plan.base_translation / row["base_translation"] - 1.0) * 2.0
        + abs(len(plan.steps) - row["steps"]) * 0.15
        + 0.1 * abs(plan.w_m_min / row["w_m_min"] - 1.0)
        + 0.1 * abs(plan.w_b_min / row["w_b_min"] - 1.0)
    )


def planned(planner: Planner, setup: dict[str, Any], case: int, mode: str) -> Plan | None:
    """Return the plan of a case, or None if no plan exists."""
    heuristic = MODES[mode].heuristic if mode == "faithful" else "relaxed"
    return planner.plan(
        setup["start"], setup["goal"], CASES[case].cost, heuristic=heuristic, goal_face=FACE
    ).plan


def planners_of(mode: str) -> dict[int, Planner]:
    """Return the planners of Cases 1 to 3 in a mode."""
    first, second = (Planner(case_graph(case, {}, mode)) for case in (1, 2))
    return {1: first, 2: second, 3: second}


def candidates(graph: TwoLimbGraph) -> tuple[list[tuple[str, ...]], Array]:
    """Return the candidate starts, and the candidate goals of shape (g, 3) [m]."""
    faces = np.array(graph.grasp_map.faces)[graph.points]
    close = np.linalg.norm(graph.base_position - START, axis=1) < RADIUS
    starts = []
    for s in np.flatnonzero((faces == "deck").all(axis=1) & close):
        try:
            graph.state(graph.points[s].tolist())
        except StanceError:
            continue
        starts.append(graph.ids(graph.points[s]))
    close = np.linalg.norm(graph.base_position - GOAL, axis=1) < RADIUS
    goals = graph.base_position[(faces == FACE).all(axis=1) & close]
    goals = np.unique(np.round(goals / 0.05) * 0.05, axis=0)
    low, high = graph.grasp_map.cabin
    return starts, goals[((goals >= low) & (goals <= high)).all(axis=1)]


def best_pair(pairs: int) -> tuple[float, dict[str, Any]]:
    """Return mismatch and setup of the best of `pairs` random pairs."""
    planners = {mode: planners_of(mode) for mode in MODES}
    graph = planners["collisions"][2].graph
    assert isinstance(graph, TwoLimbGraph)
    starts, goals = candidates(graph)
    rng, tried = np.random.default_rng(0), []
    for _ in tqdm(range(pairs), desc="pairs", mininterval=2.0):
        start = starts[int(rng.integers(len(starts)))]
        goal = np.round(goals[int(rng.integers(len(goals)))], 3).tolist()
        setup = {"start": list(start), "goal": goal, "goal_face": FACE}
        total = 0.0
        for case in (1, 2, 3):
            plan = planned(planners["faithful"][case], setup, case, "faithful")
            total += np.inf if plan is None else mismatch(case, plan)
        if np.isfinite(total):
            tried.append((total, setup))
    tried.sort(key=lambda entry: entry[0])
    for total, setup in tried[:FINALISTS]:
        if all(
            planned(planners[mode][case], setup, case, mode)
            for mode in ("collisions", "steps")
            for case in (1, 2, 3)
        ):
            return total, setup
    raise SystemExit("no pair has plans for Cases 1 to 3 in all modes; try more pairs")


def best_seed(pair: dict[str, Any]) -> tuple[float, dict[str, Any]]:
    """Return the mismatch of Case 4 and the setup with the best seed of the sparse map."""
    found = []
    for seed in tqdm(SEEDS, desc="seeds of the sparse map", mininterval=2.0):
        setup = pair | {"sparse_seed": seed}
        plan = planned(Planner(case_graph(4, setup, "faithful")), setup, 4, "faithful")
        if plan is not None:
            found.append((mismatch(4, plan), seed))
    for value, seed in sorted(found):
        setup = pair | {"sparse_seed": seed}
        if all(
            planned(Planner(case_graph(4, setup, mode)), setup, 4, mode)
            for mode in ("collisions", "steps")
        ):
            return value, setup
    raise SystemExit("no seed of the sparse map has plans for the fourth case in all modes")


def main() -> None:
    """Search over pairs and seeds, and write the best setup."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=3000, help="start and goal pairs tried")
    pairs = parser.parse_args().pairs
    total, pair = best_pair(pairs)
    sparse, setup = best_seed(pair)
    found = {"source": "experiments/calibrate_start_goal.py", **setup}
    write_whole(SETUP, json.dumps(found, indent=1) + "\n")
    print(f"mismatch {total:.3f} + {sparse:.3f}: {found} written to {Path(SETUP).name}")


if __name__ == "__main__":
    main()
