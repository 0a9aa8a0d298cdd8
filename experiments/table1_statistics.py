"""Repeat Table I for random starts and goals: spread of values, and how often relations hold.

    python experiments/table1_statistics.py [--pairs 300] [--workers 2] [--out results]

Each pair is a random stance on the deck and the base position of a random stance on the overhead,
at least 3 m apart. All cases are planned in all modes. Writes `table1_statistics.json` and
`table1_statistics.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from reports import CORES, NOTHING, experiment, study_rows, table

from mlivr_gym.cli.table1 import Start, row_of
from mlivr_gym.errors import StanceError
from mlivr_gym.paper import CASES, MODES, PAPER, case_graph, relations
from mlivr_gym.planners import Plan, Planner, SearchOptions

LEAST = 3.0
"""Minimum distance of the goal from the base at the start [m]."""

HEURISTICS = {"faithful": "paper", "steps": "relaxed", "collisions": "relaxed"}
"""Heuristic in each mode; those other than the paper's keep plans optimal."""

FORMS = (
    ("steps", ".0f", 1.0),
    ("base_translation", ".2f", 1.0),
    ("way", ".3f", 1.0),
    ("expanded", ".0f", 1.0),
    ("backward", ".0f", 1.0),
    ("time", ".1f", 1e3),
)
"""Columns with their number formats and factors of unit."""

_planners: dict[tuple[Any, ...], Planner] = {}
_SETUP = {"start": ["D1b:4", "D2a:3"], "goal": [6.3, 0.5, 0.35], "goal_face": "overhead"}


def planner_of(case: int, mode: str, seed: int) -> Planner:
    """Return the cached planner of a case; Case 4 uses the sparse map of a seed."""
    key = (mode, CASES[case].manipulability, seed if CASES[case].sparse else None)
    if key not in _planners:
        _planners[key] = Planner(case_graph(case, _SETUP | {"sparse_seed": seed}, mode))
    return _planners[key]


def random_pair(seed: int) -> tuple[Start, list[float]]:
    """Return a random start on the deck with its base pose, and a distant goal on the overhead."""
    graph, rng = planner_of(2, "collisions", 0).graph, np.random.default_rng([15, seed])
    faces = np.array(graph.grasp_map.faces)[graph.points]
    sides = [np.flatnonzero((faces == face).all(axis=1)) for face in ("deck", "overhead")]
    low, high = graph.grasp_map.cabin
    while True:
        s, g = (int(rng.choice(side)) for side in sides)
        goal, here = graph.base_position[g], graph.base_position[s]
        inside = (goal >= low).all() and (goal <= high).all()
        if inside and np.linalg.norm(goal - here) >= LEAST and graph.branch_sets[s].all():
            return Start.at(graph, graph.ids(graph.points[s])), goal.tolist()


def pair(task: int) -> dict[str, Any]:
    """Return the values of a random pair by mode and case, None without a plan."""
    start, goal = random_pair(task)
    out: dict[str, Any] = {}
    for mode in MODES:
        out[mode] = {}
        for case in CASES:
            planner = planner_of(case, mode, 0)
            graph = planner.graph
            if CASES[case].sparse and not set(start.stance) <= set(graph.grasp_map.ids):
                # The start stays on the sparse map.
                setup = _SETUP | {"start": list(start.stance), "goal": goal, "sparse_seed": task}
                planner = Planner(case_graph(case, setup, mode))
            try:
                found = planner.plan(
                    start.stance, goal, CASES[case].cost,
                    options=SearchOptions(heuristic=HEURISTICS[mode]),
                    goal_face="overhead", start_pose=start.pose_for(planner.graph),
                )  # fmt: skip
            except StanceError:
                found = None
            out[mode][str(case)] = values_of(found.plan, mode) if found and found.plan else None
    best = planner_of(2, "faithful", 0)
    optimal = best.plan(
        start.stance, goal, "base", goal_face="overhead", start_pose=start.pose_for(best.graph)
    )
    out["optimal"] = optimal.plan.base_translation if optimal.plan else None
    return out


def values_of(plan: Plan, mode: str) -> dict[str, Any]:
    """Return the values of a plan, and the length of its base's way by that of the chords.

    Steps that were not checked have no way.
    """
    if mode == "faithful":
        return row_of(plan)
    paths = [plan.joint_path(k) for k in range(len(plan.steps))]
    chords = sum(path.base_chord for path in paths)
    return row_of(plan) | {"way": sum(path.base_length for path in paths) / chords}


def spread(values: Sequence[float]) -> list[float]:
    """Return the 10th, 50th and 90th percentile."""
    return [float(v) for v in np.quantile(values, [0.1, 0.5, 0.9])] if len(values) else []


def summary(answers: list[dict[str, Any]]) -> dict[str, Any]:
    """Return spreads by mode and case, counts of relations, and the loss by the heuristic."""
    out: dict[str, Any] = {"pairs": len(answers), "modes": {}, "relations": {}}
    for mode in MODES:
        out["modes"][mode] = {}
        for case in map(str, CASES):
            rows = [a[mode][case] for a in answers if a[mode][case]]
            figures = {
                name: spread([row[name] for row in rows if name in row]) for name, *_ in FORMS
            }
            out["modes"][mode][case] = {"plans": len(rows)} | figures
        whole = [a[mode] for a in answers if all(a[mode].values())]
        by_pair = [relations({int(k): row for k, row in rows.items()}) for rows in whole]
        out["relations"][mode] = {"pairs": len(by_pair)} | {
            name: int(sum(pair[name]["held"] for pair in by_pair)) for name in (by_pair or [{}])[0]
        }
    out["kinds"] = {
        name: relation["kind"]
        for name, relation in relations({k: PAPER[k] | {"backward": 0} for k in PAPER}).items()
    }
    both = [
        (a["faithful"]["2"]["base_translation"], a["optimal"])
        for a in answers
        if a["faithful"]["2"] and a["optimal"]
    ]
    lost = np.array([found - least for found, least in both])
    out["paper_heuristic"] = {
        "pairs": len(lost),
        "longer": int((lost > 1e-9).sum()),
        "mean": float(lost.mean()),
        "largest": float(lost.max()),
    }
    return out


def measured(pairs: int, workers: int) -> dict[str, Any]:
    """Return the statistics over random pairs."""
    return {"statistics": summary(study_rows("table1_statistics:pair", pairs, workers))}


ROWS = (
    "case | mode | plans | steps | base translation [m] | way / chord | explored | backward | "
    "query [ms]"
)


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    found = data["statistics"]
    rows = []
    for case in map(str, CASES):
        for mode, by_case in found["modes"].items():
            cells = []
            for name, form, scale in FORMS:
                values = [format(scale * value, form) for value in by_case[case][name]]
                cells.append("{1} ({0} to {2})".format(*values) if values else NOTHING)
            rows.append([case, MODES[mode].title, by_case[case]["plans"], *cells])
    held = found["relations"]
    shares = [
        [name, kind, *(f"{100 * row[name] / max(1, row['pairs']):.0f} %" for row in held.values())]
        for name, kind in found["kinds"].items()
        if kind != "calibration"
    ]
    titles = " | ".join(MODES[mode].title for mode in held)
    whole, loss = ", ".join(str(row["pairs"]) for row in held.values()), found["paper_heuristic"]
    return f"""# Table I for random starts and goals

Made by `experiments/table1_statistics.py`. {found["pairs"]} random walks from the deck to the \
overhead, at least {LEAST:g} m from base to goal, both limbs on the overhead at the end. Values \
are medians, with the 10th and 90th percentile in brackets. Base translation is measured along \
the chords of the steps; "way / chord" is the length of the way of the base by that of its chords. \
Heuristics: the paper's in the paper-faithful mode, `relaxed` in the others, whose backward \
search is counted separately.

{table(ROWS, rows)}
Share of the pairs with plans in all cases for which a relation holds ({whole}):

{table(f"relation | why it may hold | {titles}", shares)}
All modes start from the same base pose, the one with collisions checked. In a graph that has \
another posture for the stance it is a given pose, to which thresholds do not apply; a plan may \
therefore start below them.

**What the paper's heuristic costs.** In the paper-faithful Case 2 its plan is longer than the \
optimum for {loss["longer"]} of {loss["pairs"]} pairs \
({100 * loss["longer"] / loss["pairs"]:.0f} %), by {loss["mean"]:.3f} m on average and \
{loss["largest"]:.3f} m at most.
"""


if __name__ == "__main__":
    experiment("table1_statistics", __doc__, measured, markdown, pairs=300, workers=CORES)
