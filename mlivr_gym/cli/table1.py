"""The command `mlivr-gym table1`: the four cases of the paper's Table I, drawn and tabulated."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.outputs import claim, make_folder
from mlivr_gym.cli.render import draw
from mlivr_gym.files import write_whole
from mlivr_gym.paper import CASES, PAPER, case_graph, default_setup, relations
from mlivr_gym.pictures.plan_figure import plan_figure
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.world.grasp_map import jem_map

FILES = (
    "table1.json",
    "table1.md",
    *(f"case{case}{checked}.png" for case in CASES for checked in ("", "_collisions")),
    "scene_start.png",
    "scene_goal.png",
)
"""What the command writes."""

HEURISTIC_WITH_COLLISIONS = "cost_to_go"
"""Heuristic of the queries with collisions checked."""


def add_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser's."""
    parser = commands.add_parser(
        "table1",
        help="the four cases of the paper's Table I",
        description="Plan the four cases, draw and tabulate them.",
    )
    parser.add_argument(
        "--out", default="results", metavar="FOLDER", help="where results go (default: %(default)s)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the table and its pictures; 1 if a relation of the paper does not hold."""
    out = Path(args.out)
    claim(*(out / name for name in FILES), folder=out)
    print(
        "planning the four cases of Table I, without and with collisions checked "
        "(the first run compiles the kernels) ...",
        flush=True,
    )
    plans, data = run_cases(out, lambda line: print(line, flush=True))
    plan = plans[3]
    ends = {"start": 0, "goal": len(plan.stances) - 1}
    pictures = {out / f"scene_{name}.png": [plan.configuration(k)] for name, k in ends.items()}
    draw(jem_map(), plan.world.robot, pictures, (1600, 800))
    failed = [name for name, held in data["relations"].items() if not held]
    for name in failed:
        print(f"relation does not hold: {name}")
    return FAILED if failed else SUCCESS


def run_cases(
    out: Path, progress: Callable[[str], None], heuristic: str = "consistent"
) -> tuple[dict[int, Plan], dict[str, Any]]:
    """Plan the four cases without and with collisions checked.

    Draws each, and writes `table1.json` and `table1.md`.

    Args:
        out: Folder for the results; made if it is missing.
        progress: Called with one line for each thing done.
        heuristic: Heuristic of the search; `"consistent"` is A* as the paper describes it.

    Returns:
        The plans with collisions checked, and the data of the table.
    """
    make_folder(out)
    setup = default_setup()
    plans, rows = _plan_cases(out, progress, heuristic, setup, collisions=False)
    safe, safe_rows = _plan_cases(out, progress, HEURISTIC_WITH_COLLISIONS, setup, collisions=True)
    data = {
        "setup": setup,
        "heuristic": heuristic,
        "measured": rows,
        "measured_with_collisions": safe_rows,
        "paper": {str(k): v for k, v in PAPER.items()},
        "relations": relations(plans),
        "relations_with_collisions": relations(safe),
        "left_out_without_thresholds": limits_without_thresholds(setup),
    }
    write_whole(out / "table1.json", json.dumps(data, indent=1) + "\n")
    write_whole(out / "table1.md", table_markdown(data))
    progress(f"table: {out / 'table1.md'}, {out / 'table1.json'}")
    return safe, data


def _plan_cases(
    out: Path,
    progress: Callable[[str], None],
    heuristic: str,
    setup: dict[str, Any],
    *,
    collisions: bool,
) -> tuple[dict[int, Plan], dict[str, dict[str, Any]]]:
    """Plans and rows of the four cases, and a picture of each."""
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


def limits_without_thresholds(setup: dict[str, Any]) -> dict[str, float]:
    """What rules out stances in Case 1, which has no thresholds.

    That is the floor of departures, and the robot's span. The span is compared with one that no
    two limbs can reach, where steps are checked and where they are not.
    """
    graph = case_graph(1, setup)
    assert isinstance(graph, PairGraph)
    unchecked = replace(graph.settings, transitions=False)
    wide = replace(
        graph.robot,
        span=2.0 * (graph.robot.mount_radius + graph.robot.limb.reach + graph.robot.tool_length),
    )

    def stances(robot: RobotSpec, settings: Settings) -> int:
        other = stance_graph(graph.grasp_map, robot, settings)
        assert isinstance(other, PairGraph)
        return len(other)

    unchecked_wide = stances(wide, unchecked)
    return {
        "path_floor": graph.settings.path_floor,
        "span": graph.robot.span,
        "reachable": graph.reachable,
        "by_floor": graph.no_departure,
        "by_span": stances(wide, graph.settings) - len(graph),
        "by_span_unchecked": unchecked_wide - stances(graph.robot, unchecked),
        "unchecked_wide": unchecked_wide,
    }


def table_markdown(data: dict[str, Any]) -> str:
    """The table as Markdown, the paper's row above the measured ones."""
    lines = [
        "# Table I",
        "",
        _origin(data["setup"]),
        "",
        "| case | source | explored | base translation [m] | steps | least w_m | least w_b "
        "| time [s] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for number in map(str, CASES):
        p = data["paper"][number]
        lines += [
            f"| {number} | paper | {p['expanded']:.0f} | {p['base_translation']:.1f} "
            f"| {p['steps']:.0f} | {p['w_m_min']:.2f} | {p['w_b_min']:.4f} | {p['time']:.1f} |",
            _row(number, "measured", data["measured"][number]),
            _row(number, "with collisions", data["measured_with_collisions"][number]),
        ]
    lines += ["", "| relation | measured | with collisions |", "|---|---|---|"]
    safe = data["relations_with_collisions"]
    lines += [
        f"| {name} | {'yes' if held else 'no'} | {'yes' if safe[name] else 'no'} |"
        for name, held in data["relations"].items()
    ]
    lines += ["", _limits(data["left_out_without_thresholds"]), "", DIFFERENCES, ""]
    return "\n".join(lines)


def _origin(setup: dict[str, Any]) -> str:
    """Where the rows come from."""
    return (
        f"Start {' and '.join(setup['start'])}, goal {tuple(setup['goal'])} m, on the measured "
        "seat tracks of the JEM. Start, goal and the seed of the sparse map are calibrated by "
        "`experiments/calibrate_start_goal.py`, since the paper's map, start and goal are not "
        "public. Rows marked *paper* are Table I of the paper (Intel i9-12900H); rows marked "
        "*measured* come from this program on the machine it ran on, without collision checks as "
        "in the paper; those marked *with collisions* are the same queries where no stance and no "
        "step may touch anything (clearance 0.02 m), searched with the planner's own estimate of "
        "the way to go, which explores far fewer states. Measured times are the stance set (built "
        "once for a map) plus the query, nothing else known before."
    )


def _row(number: str, source: str, m: dict[str, Any]) -> str:
    return (
        f"| {number} | {source} | {m['expanded']} | {m['base_translation']:.2f} | {m['steps']} "
        f"| {m['w_m_min']:.4f} | {m['w_b_min']:.5f} "
        f"| {m['stance_set_time']:.2f} + {m['search_time']:.3f} |"
    )


def _limits(limits: dict[str, float]) -> str:
    """What limits Case 1."""
    by_span, wide = limits["by_span_unchecked"], limits["unchecked_wide"]
    return (
        f"**Case 1 is not without any limit.** Of {limits['reachable']} stances in reach "
        f"{limits['by_floor']} are left out since a limb could not leave its point with w_m of "
        f"{limits['path_floor']:g} or more, which the check of steps needs. Points more than "
        f"{limits['span']:g} m apart (the robot's span) are not tried: where steps are checked "
        f"this takes away {limits['by_span']} stances, where neither steps nor thresholds are, "
        f"{by_span} of {wide} ({100 * by_span / wide:.0f} %)."
    )


DIFFERENCES = (
    "**What differs, and why.** Explored nodes: this A* uses an admissible heuristic, "
    "`max(0, d - tolerance)`, where the paper's `d` overestimates near the goal and so explores "
    "less; every step must also be shown to be possible, which the paper does not ask for, so a "
    "stance may be explored once for each set of branches; and the map, its point spacing and the "
    "postures tried are not the paper's. Translation and steps depend on the start and the goal, "
    "which are calibrated, not known. Base and limb manipulability are those of the branches the "
    "plan is carried out on. With collisions checked a stance takes another posture where the "
    "rule's choice comes too near something, so that its base stands elsewhere. The step cost "
    "breaks ties by a fixed order, not by translation: with a small price of a regrasp as few "
    "steps cost less translation. How many plans of the paper's kind could not be carried out, "
    "and what a price of a regrasp does: `table1_study.md`."
)
"""Why the figures are not the paper's."""
