"""Find a start and a goal for which the four cases agree best with the paper's Table I.

    python experiments/calibrate_start_goal.py [--pairs 3000] [--workers 2]

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

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from reports import CORES, command_line, study_rows

from mlivr_gym.arrays import Array
from mlivr_gym.errors import StanceError
from mlivr_gym.files import write_whole
from mlivr_gym.paper import CASES, MODES, PAPER, SETUP, case_graph
from mlivr_gym.planners import Plan, Planner, SearchOptions
from mlivr_gym.stances import StanceGraph

START, GOAL, RADIUS = (1.84, 0.0, -0.35), (6.0, 0.0, 0.42), 0.6
"""Candidate starts and goals lie within `RADIUS` of these base positions [m]."""

FACE = "overhead"
"""Face on which walks end."""

SEEDS = 60
"""Number of candidate seeds of the sparse map."""

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
    options = SearchOptions(heuristic=heuristic)
    given = setup["start"], setup["goal"], CASES[case].cost
    return planner.plan(*given, options=options, goal_face=FACE).plan


@cache
def planners_of(mode: str) -> dict[int, Planner]:
    """Return the planners of Cases 1 to 3 in a mode, once for each process."""
    first, second = (Planner(case_graph(case, {}, mode)) for case in (1, 2))
    return {1: first, 2: second, 3: second}


def candidates(graph: StanceGraph) -> tuple[list[tuple[str, ...]], Array]:
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


@cache
def drawn_pairs(pairs: int) -> list[dict[str, Any]]:
    """Return random pairs of a start and a goal, once for each process."""
    graph = planners_of("collisions")[2].graph
    starts, goals = candidates(graph)
    rng, found = np.random.default_rng(0), []
    for _ in range(pairs):
        start = starts[int(rng.integers(len(starts)))]
        goal = np.round(goals[int(rng.integers(len(goals)))], 3).tolist()
        found.append({"start": list(start), "goal": goal, "goal_face": FACE})
    return found


def pair_mismatch(task: int, pairs: int) -> dict[str, float | None]:
    """Return the mismatch of a pair in Cases 1 to 3, None if one of them has no plan."""
    setup, planners = drawn_pairs(pairs)[task], planners_of("faithful")
    plans = {case: planned(planners[case], setup, case, "faithful") for case in (1, 2, 3)}
    found = [mismatch(case, plan) for case, plan in plans.items() if plan is not None]
    return {"mismatch": sum(found) if len(found) == len(plans) else None}


def seed_mismatch(task: int, setup: str) -> dict[str, float | None]:
    """Return the mismatch of Case 4 with a seed of the sparse map, None without a plan."""
    pair = json.loads(setup) | {"sparse_seed": task}
    plan = planned(Planner(case_graph(4, pair, "faithful")), pair, 4, "faithful")
    return {"mismatch": None if plan is None else mismatch(4, plan)}


def best_first(rows: list[dict[str, Any]]) -> list[tuple[float, int]]:
    """Return mismatch and number of each task that has plans, the smallest mismatch first."""
    found = [(row["mismatch"], row["task"]) for row in rows if row["mismatch"] is not None]
    return sorted(found, key=lambda entry: entry[0])


def best_pair(pairs: int, workers: int) -> tuple[float, dict[str, Any]]:
    """Return mismatch and setup of the best of `pairs` random pairs."""
    rows = study_rows("calibrate_start_goal:pair_mismatch", pairs, workers, pairs=[pairs])
    for total, task in best_first(rows)[:FINALISTS]:
        setup = drawn_pairs(pairs)[task]
        if all(
            planned(planners_of(mode)[case], setup, case, mode)
            for mode in ("collisions", "steps")
            for case in (1, 2, 3)
        ):
            return total, setup
    raise SystemExit("no pair has plans for Cases 1 to 3 in all modes; try more pairs")


def best_seed(pair: dict[str, Any], workers: int) -> tuple[float, dict[str, Any]]:
    """Return the mismatch of Case 4 and the setup with the best seed of the sparse map."""
    given = [json.dumps(pair)]
    rows = study_rows("calibrate_start_goal:seed_mismatch", SEEDS, workers, setup=given)
    for value, seed in best_first(rows):
        setup = pair | {"sparse_seed": seed}
        if all(
            planned(Planner(case_graph(4, setup, mode)), setup, 4, mode)
            for mode in ("collisions", "steps")
        ):
            return value, setup
    raise SystemExit("no seed of the sparse map has plans for the fourth case in all modes")


def main() -> None:
    """Search over pairs and seeds, and write the best setup."""
    args = command_line(__doc__, None, pairs=3000, workers=CORES).parse_args()
    total, pair = best_pair(args.pairs, args.workers)
    sparse, setup = best_seed(pair, args.workers)
    found = {"source": "experiments/calibrate_start_goal.py", **setup}
    write_whole(SETUP, json.dumps(found, indent=1) + "\n")
    print(f"mismatch {total:.3f} + {sparse:.3f}: {found} written to {Path(SETUP).name}")


if __name__ == "__main__":
    main()
