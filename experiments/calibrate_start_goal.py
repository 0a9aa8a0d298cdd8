"""Find a start and a goal for which the four cases come closest to the paper's Table I.

The paper's map, start and goal are not public. Its figures speak of a walk from the deck to the
overhead whose base goes about 4.4 m. Starts are stances on the deck with the base within 0.6 m of
(1.84, 0, -0.35); goals are base positions of stances on the overhead within 0.6 m of (6.0, 0,
0.42), rounded to 0.05 m. Each pair is planned for Cases 1 to 3, and the seed of Case 4's sparse map
is chosen last. The mismatch adds relative errors of base translation, steps and the least
manipulabilities, with collisions not looked at, as in the paper; the pair must have plans for Cases
2 to 4 with collisions checked too.

    python experiments/calibrate_start_goal.py [--pairs 3000]

writes `envs_assets/table1_setup.json`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from mlivr_gym import Settings, jem_map, stance_graph
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import StanceError
from mlivr_gym.files import write_whole
from mlivr_gym.paper import CASES, PAPER, SETUP, case_graph, relations
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.stances.pair_graph import PairGraph

START, GOAL, RADIUS = (1.84, 0.0, -0.35), (6.0, 0.0, 0.42), 0.6
"""Starts and goals that are tried lie within `RADIUS` of these base positions [m]."""

SEEDS = range(60)
"""Seeds of the sparse map that are tried."""

FINALISTS = 40
"""Pairs that are planned again with the table's heuristic."""


def mismatch(case: int, plan: Plan) -> float:
    """Sum of relative errors of one case against the paper's row."""
    row = PAPER[case]
    return (
        abs(plan.base_translation / row["base_translation"] - 1.0) * 2.0
        + abs(len(plan.steps) - row["steps"]) * 0.15
        + 0.1 * abs(plan.w_m_min / row["w_m_min"] - 1.0)
        + 0.1 * abs(plan.w_b_min / row["w_b_min"] - 1.0)
    )


def evaluate(
    planners: dict[bool, Planner], start: tuple[str, ...], goal: tuple[float, ...], heuristic: str
) -> tuple[float, dict[int, Plan]]:
    """Mismatch and plans of Cases 1 to 3; infinite where one has no plan."""
    plans: dict[int, Plan] = {}
    total = 0.0
    for case in (1, 2, 3):
        result = planners[CASES[case].manipulability].plan(
            start, goal, CASES[case].cost, heuristic=heuristic
        )
        if result.plan is None:
            return np.inf, plans
        plans[case] = result.plan
        total += mismatch(case, result.plan)
    return total, plans


def _can_start(planner: Planner, points: IntArray) -> bool:
    """Whether a robot at a stance, given by its points, can depart without touching anything."""
    try:
        planner.graph.state(points.tolist())
    except StanceError:
        return False
    return True


def candidates(graph: PairGraph, checked: Planner) -> tuple[list[int], Array]:
    """Stances from which the walk may start, and goals, shape (g, 3) [m]."""
    faces = np.array(graph.grasp_map.faces)[graph.points]
    close = np.linalg.norm(graph.base_in_world - START, axis=1) < RADIUS
    starts = [
        int(s)
        for s in np.flatnonzero((faces == "deck").all(axis=1) & close)
        if _can_start(checked, graph.points[s])
    ]
    close = np.linalg.norm(graph.base_in_world - GOAL, axis=1) < RADIUS
    goals = np.unique(
        np.round(graph.base_in_world[(faces == "overhead").all(axis=1) & close] / 0.05) * 0.05,
        axis=0,
    )
    return starts, goals


def best_pair(
    planners: dict[bool, Planner], checked: Planner, pairs: int
) -> tuple[float, tuple[str, ...], tuple[float, ...], dict[int, Plan]]:
    """Mismatch, start, goal and plans of the best of random pairs.

    Args:
        planners: Planners without collisions, by whether thresholds hold.
        checked: Planner with thresholds and collisions.
        pairs: How many pairs are tried.
    """
    graph = planners[True].graph
    assert isinstance(graph, PairGraph)
    starts, goals = candidates(graph, checked)
    rng = np.random.default_rng(0)
    tried = []
    for _ in tqdm(range(pairs), desc="pairs", mininterval=2.0):
        start = graph.ids(graph.points[int(rng.choice(starts))])
        goal = tuple(np.round(goals[int(rng.integers(len(goals)))], 3).tolist())
        total, plans = evaluate(planners, start, goal, "cost_to_go")
        if np.isfinite(total) and all(relations(plans).values()):
            tried.append((total, start, goal))
    tried.sort(key=lambda entry: entry[0])
    again = []
    for _, start, goal in tqdm(
        tried[:FINALISTS], desc="finalists, with the table's heuristic", mininterval=2.0
    ):
        total, plans = evaluate(planners, start, goal, "consistent")
        feasible = all(checked.plan(start, goal, CASES[case].cost) for case in (2, 3))
        if feasible and np.isfinite(total) and all(relations(plans).values()):
            again.append((total, start, goal, plans))
    if not again:
        raise SystemExit(
            "no pair meets the relations of the paper's first three cases; try more pairs"
        )
    return min(again, key=lambda entry: entry[0])


def best_seed(
    start: tuple[str, ...], goal: tuple[float, ...], plans: dict[int, Plan]
) -> tuple[float, dict[str, Any]]:
    """Mismatch of Case 4 and the setup with the best seed of the sparse map."""
    best: tuple[float, dict[str, Any]] | None = None
    for seed in tqdm(SEEDS, desc="seeds of the sparse map", mininterval=2.0):
        setup = {"start": list(start), "goal": list(goal), "sparse_seed": seed}
        result = Planner(case_graph(4, setup)).plan(
            start, goal, CASES[4].cost, heuristic="consistent"
        )
        if result.plan is not None and all(relations(plans | {4: result.plan}).values()):
            value = mismatch(4, result.plan)
            if (best is None or value < best[0]) and Planner(
                case_graph(4, setup, collisions=True)
            ).plan(start, goal, CASES[4].cost):
                best = value, setup
    if best is None:
        raise SystemExit("no seed of the sparse map meets the relations of the paper's fourth case")
    return best


def main() -> None:
    """Search over pairs and seeds, and write the best."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=3000, help="start and goal pairs tried")
    pairs = parser.parse_args().pairs
    planners = {
        flag: Planner(
            stance_graph(jem_map(), settings=Settings(manipulability=flag, collisions=False))
        )
        for flag in (False, True)
    }
    total, start, goal, plans = best_pair(planners, Planner(stance_graph(jem_map())), pairs)
    sparse, setup = best_seed(start, goal, plans)
    found = {"source": "experiments/calibrate_start_goal.py", **setup}
    write_whole(SETUP, json.dumps(found, indent=1) + "\n")
    print(f"mismatch {total:.3f} + {sparse:.3f}: {found} written to {Path(SETUP).name}")


if __name__ == "__main__":
    main()
