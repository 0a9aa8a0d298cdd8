"""The four cases of the paper's Table I.

This module sits on top of the planner, as the command line does; nothing below it imports it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mlivr_gym.envs_assets import asset_path
from mlivr_gym.files import read_json, write_whole
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.world.grasp_map import GraspMap, jem_map

SETUP = asset_path("table1_setup.json")
"""Start, goal and seed of the sparse map, written by `experiments/calibrate_start_goal.py`."""


SAFE_HEURISTIC = "cost_to_go"
"""Heuristic of the queries with collisions checked."""


@dataclass(frozen=True)
class Case:
    """One case: whether thresholds hold, the cost, whether the map is sparse, and what it is called."""

    manipulability: bool
    cost: str
    sparse: bool
    title: str


CASES = {
    1: Case(False, "base", False, "Case 1: no manipulability thresholds, base cost"),
    2: Case(True, "base", False, "Case 2: thresholds, base cost"),
    3: Case(True, "steps", False, "Case 3: thresholds, step cost"),
    4: Case(True, "base", True, "Case 4: thresholds, base cost, sparse map"),
}

PAPER: dict[int, dict[str, float]] = {
    1: {
        "expanded": 172,
        "base_translation": 4.4,
        "steps": 6,
        "w_m_min": 0.07,
        "w_b_min": 0.0008,
        "time": 1.2,
    },
    2: {
        "expanded": 386,
        "base_translation": 4.5,
        "steps": 7,
        "w_m_min": 0.10,
        "w_b_min": 0.0015,
        "time": 1.8,
    },
    3: {
        "expanded": 40,
        "base_translation": 4.7,
        "steps": 5,
        "w_m_min": 0.12,
        "w_b_min": 0.0018,
        "time": 0.2,
    },
    4: {
        "expanded": 72,
        "base_translation": 5.0,
        "steps": 7,
        "w_m_min": 0.12,
        "w_b_min": 0.0020,
        "time": 0.2,
    },
}
"""Imai, Uno, Kuwahara, Yoshida: Table I, on an Intel i9-12900H."""


def default_setup() -> dict[str, Any]:
    """The calibrated start (point ids), goal [m] and seed."""
    return read_json(SETUP, "setup of Table I")


def case_map(case: int, setup: dict[str, Any]) -> GraspMap:
    """Map of a case: for the sparse one, half the points and no deck point between start and goal."""
    full = jem_map()
    if not CASES[case].sparse:
        return full
    start = tuple(setup["start"])
    x = full.positions[[full.index(point) for point in start], 0].mean()
    return full.sparse(
        int(setup["sparse_seed"]), keep=start, clear_deck=(float(x), float(setup["goal"][0]))
    )


def case_graph(case: int, setup: dict[str, Any], collisions: bool = False) -> PairGraph | LazyGraph:
    """Stance graph of a case; the paper does not look at collisions."""
    settings = Settings(manipulability=CASES[case].manipulability, collisions=collisions)
    return stance_graph(case_map(case, setup), settings=settings)


def relations(plans: dict[int, Plan]) -> dict[str, bool]:
    """Whether the relations between the paper's cases hold, for those that can be told from the plans given."""
    default = Settings().thresholds(2)
    out = {}

    def meets(plan: Plan) -> bool:
        return plan.w_m_min >= default[0] and plan.w_b_min >= default[1]

    if 1 in plans:
        out["Case 1 goes below at least one threshold"] = not meets(plans[1])
    for case in (2, 3, 4):
        if case in plans:
            out[f"Case {case} meets both thresholds"] = meets(plans[case])
    length = {case: round(plan.base_translation, 9) for case, plan in plans.items()}
    if 1 in plans and 2 in plans:
        out["Case 2 is no shorter than Case 1"] = length[2] >= length[1]
    if 2 in plans and 3 in plans:
        out["Case 3 has fewer steps than Case 2"] = len(plans[3].steps) < len(plans[2].steps)
        out["Case 3 has no less translation than Case 2"] = length[3] >= length[2]
    if 2 in plans and 4 in plans:
        out["Case 4 is no shorter than Case 2"] = length[4] >= length[2]
    for case, plan in plans.items():
        row = PAPER[case]
        near = abs(plan.base_translation / row["base_translation"] - 1.0) <= 0.15
        out[f"Case {case}: base translation within 15 % of the paper's"] = near
        out[f"Case {case}: steps within one of the paper's"] = (
            abs(len(plan.steps) - row["steps"]) <= 1
        )
    return out


def run_cases(
    out: Path, progress: Callable[[str], None], heuristic: str = "consistent"
) -> tuple[dict[int, Plan], dict[str, Any]]:
    """Plan the four cases without and with collisions checked, draw each, and write `table1.json` and `table1.md` into `out`.

    Returns the plans with collisions checked and the data of the table.

    Args:
        out: Folder for the results; made if it is missing.
        progress: Called with one line for each thing done.
        heuristic: Heuristic of the search; `"consistent"` is A* as the paper describes it.
    """
    out.mkdir(parents=True, exist_ok=True)
    setup = default_setup()
    plans, rows = _run_block(out, progress, heuristic, setup, False)
    safe, safe_rows = _run_block(out, progress, SAFE_HEURISTIC, setup, True)
    data = {
        "setup": setup,
        "heuristic": heuristic,
        "measured": rows,
        "measured_with_collisions": safe_rows,
        "paper": {str(k): v for k, v in PAPER.items()},
        "relations": relations(plans),
        "relations_with_collisions": relations(safe),
        "left_out_without_thresholds": left_out_without_thresholds(setup),
    }
    write_whole(out / "table1.json", json.dumps(data, indent=1) + "\n")
    write_whole(out / "table1.md", table_markdown(data))
    progress(f"table: {out / 'table1.md'}, {out / 'table1.json'}")
    return safe, data


def left_out_without_thresholds(setup: dict[str, Any]) -> dict[str, float]:
    """What still leaves stances out in Case 1, which has no thresholds: the floor of departures, and the robot's span.

    The span is compared with one that no two limbs can reach, where steps are checked and where
    they are not.
    """
    graph = case_graph(1, setup)
    assert isinstance(graph, PairGraph)
    free = replace(graph.settings, transitions=False)
    wide = replace(
        graph.robot,
        span=2.0 * (graph.robot.mount_radius + graph.robot.limb.reach + graph.robot.tool_length),
    )

    def stances(robot: RobotSpec, settings: Settings) -> int:
        other = stance_graph(graph.grasp_map, robot, settings)
        assert isinstance(other, PairGraph)
        return len(other)

    unchecked = stances(wide, free)
    return {
        "path_floor": graph.settings.path_floor, "span": graph.robot.span,
        "reachable": graph.reachable,
        "by_floor": graph.no_departure, "by_span": stances(wide, graph.settings) - len(graph),
        "by_span_unchecked": unchecked - stances(graph.robot, free), "unchecked_wide": unchecked,
    }  # fmt: skip


def _run_block(
    out: Path,
    progress: Callable[[str], None],
    heuristic: str,
    setup: dict[str, Any],
    collisions: bool,
) -> tuple[dict[int, Plan], dict[str, dict[str, Any]]]:
    """The four cases with or without collisions checked: plans and rows, and a picture of each."""
    from mlivr_gym.pictures.figures import plan_figure

    start, goal = tuple(setup["start"]), tuple(setup["goal"])
    plans, rows = {}, {}
    for number, case in CASES.items():
        began = time.perf_counter()
        graph = case_graph(number, setup, collisions)
        built = time.perf_counter() - began
        result = Planner(graph).plan(start, goal, case.cost, heuristic=heuristic)
        plan = result.unwrap()
        plans[number] = plan
        rows[str(number)] = {
            "points": len(graph.grasp_map),
            "stances": len(graph) if isinstance(graph, PairGraph) else None,
            "expanded": plan.statistics.expanded,
            "base_translation": plan.base_translation,
            "steps": len(plan.steps),
            "w_m_min": plan.w_m_min,
            "w_b_min": plan.w_b_min,
            "stance_set_time": built,
            "search_time": plan.statistics.feasibility_time + plan.statistics.search_time,
            "stances_of_plan": [list(s) for s in plan.stances],
        }
        name, title = f"case{number}.png", case.title
        if collisions:
            name, title = f"case{number}_collisions.png", f"{case.title}, collisions checked"
        plan_figure(graph.grasp_map, plan, out / name, result.tree, title)
        progress(f"{title}: {result.message}, {plan.statistics.expanded} explored, {out / name}")
    return plans, rows


def table_markdown(data: dict[str, Any]) -> str:
    """The table as Markdown, the paper's row above the measured one."""
    setup = data["setup"]
    lines = [
        "# Table I",
        "",
        f"Start {' and '.join(setup['start'])}, goal {tuple(setup['goal'])} m, on the measured seat tracks of the JEM. "
        "Start, goal and the seed of the sparse map are calibrated by `experiments/calibrate_start_goal.py`, since the paper's "
        "map, start and goal are not public. Rows marked *paper* are Table I of the paper (Intel i9-12900H); rows marked "
        "*measured* come from this program on the machine it ran on, without collision checks as in the paper; those marked "
        "*with collisions* are the same queries where no stance and no step may touch anything (clearance 0.02 m), searched with "
        "the planner's own estimate of the way to go, which explores far fewer states. Measured times "
        "are the stance set (built once for a map) plus the query, nothing else known before.",
        "",
        "| case | source | explored | base translation [m] | steps | least w_m | least w_b | time [s] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for number in CASES:
        p, m = data["paper"][str(number)], data["measured"][str(number)]
        lines.append(
            f"| {number} | paper | {p['expanded']:.0f} | {p['base_translation']:.1f} | {p['steps']:.0f} | {p['w_m_min']:.2f} "
            f"| {p['w_b_min']:.4f} | {p['time']:.1f} |"
        )
        lines += [_row(number, "measured", m)]
        lines += [_row(number, "with collisions", data["measured_with_collisions"][str(number)])]
    lines += ["", "| relation | measured | with collisions |", "|---|---|---|"]
    safe = data["relations_with_collisions"]
    lines += [
        f"| {name} | {'yes' if held else 'no'} | {'yes' if safe[name] else 'no'} |"
        for name, held in data["relations"].items()
    ]
    left = data["left_out_without_thresholds"]
    lines += [
        "",
        f"**Case 1 is not without any limit.** Of {left['reachable']} stances in reach {left['by_floor']} are left out since a limb could "
        f"not leave its point with w_m of {left['path_floor']:g} or more, which the check of steps needs. Points more than "
        f"{left['span']:g} m apart (the robot's span) are not tried: where steps are checked this takes away {left['by_span']} stances, "
        f"where neither steps nor thresholds are, {left['by_span_unchecked']} of {left['unchecked_wide']} "
        f"({100 * left['by_span_unchecked'] / left['unchecked_wide']:.0f} %).",
        "",
        "**What differs, and why.** Explored nodes: this A* uses an admissible heuristic, `max(0, d - tolerance)`, where the "
        "paper's `d` overestimates near the goal and so explores less; every step must also be shown to be possible, which the paper "
        "does not ask for, so a stance may be explored once for each set of branches; and the map, its point spacing and the postures "
        "tried are not the paper's. Translation and steps depend on the start and the goal, which are calibrated, not known. "
        "Base and limb manipulability are those of the branches the plan is carried out on. With collisions "
        "checked a stance takes another posture where the rule's choice comes too near something, so that its base stands elsewhere. "
        "The step cost breaks ties "
        "by a fixed order, not by translation: with a small price of a regrasp as few steps cost less translation. How many plans of the "
        "paper's kind could not be carried out, and what a price of a regrasp does: `table1_study.md`.",
        "",
    ]
    return "\n".join(lines)


def _row(number: int, source: str, m: dict[str, Any]) -> str:
    return (
        f"| {number} | {source} | {m['expanded']} | {m['base_translation']:.2f} | {m['steps']} | {m['w_m_min']:.4f} "
        f"| {m['w_b_min']:.5f} | {m['stance_set_time']:.2f} + {m['search_time']:.3f} |"
    )
