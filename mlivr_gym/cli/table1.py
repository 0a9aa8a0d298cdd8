"""The command `mlivr-gym table1`: the four cases of the paper's Table I, drawn and tabulated."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.cli.arguments import option
from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.outputs import all_or_none, check_outputs, input_files
from mlivr_gym.cli.progress import Progress
from mlivr_gym.cli.render import draw, shots_of
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.files import write_whole
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.paper import (
    CASES,
    CONSTRUCTION,
    MODES,
    PAPER,
    case_graph,
    case_map,
    default_setup,
    relations,
    unlimited,
)
from mlivr_gym.pictures.plan_figures import plan_figure
from mlivr_gym.planners import Plan, Planner, SearchOptions
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.grasp_map import jem_map

MODE_PICTURES = {"steps": "", "collisions": "_collisions"}
"""Modes whose plans are drawn, and the suffixes of their file names."""

TEMPLATE = asset_path("table1.md")
"""Template of the table in Markdown, with its numbers as fields."""

FILES = (
    "table1.json",
    "table1.md",
    *(
        f"case{case}{end}{kind}"
        for case in CASES
        for end in MODE_PICTURES.values()
        for kind in (".png", ".svg")
    ),
    "scene_start.png",
    "scene_goal.png",
)
"""Files that the command writes."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    option(parser, "--out FOLDER", "folder of the results", "table1")


def run(args: argparse.Namespace) -> int:
    """Reproduce Table I of the paper.

    Its four cases are planned in three modes, the plans are drawn, and the results are compared
    with the paper's.
    """
    out = Path(args.out)
    check_outputs(*(out / name for name in FILES), folder=out, inputs=input_files(args))
    with all_or_none(args, out):
        with Progress("cases planned", len(CASES) * len(MODES), args.quiet) as progress:
            plans, data = run_cases(out, progress.show)
        print(report(data))
        plan = plans[3]
        ends = {"start": 0, "goal": len(plan.stances) - 1}
        grasp_map = jem_map()
        pictures = {
            out / f"scene_{name}.png": shots_of(grasp_map, plan, [k]) for name, k in ends.items()
        }
        draw(grasp_map, plan.world.robot, pictures, (1600, 800), plan.world.obstacles)
        failed = broken_relations(data)
        args.result |= data | {"impossible": failed}
        args.result |= {"folder": out, "files": FILES}
        files = out / "table1.md", out / "table1.json", out / "case*.png"
        print("table: {}, {}; pictures: {}, .svg".format(*files))
    for name in failed:
        print(f"relation does not hold: {name}")
    return FAILED if failed else SUCCESS


def broken_relations(data: dict[str, Any]) -> list[str]:
    """Return the relations that do not hold although they follow from optimality."""
    return [
        f"{name} ({MODES[mode].title})"
        for mode, of_mode in data["relations"].items()
        if MODES[mode].heuristic != "paper"
        for name, relation in of_mode.items()
        if relation["kind"] == CONSTRUCTION and not relation["held"]
    ]


def report(data: dict[str, Any]) -> str:
    """Return a table of steps, base translation and states explored, by case and mode."""
    rows = [["case", *(mode["title"] for mode in data["modes"].values())]]
    for case in map(str, CASES):
        results = [rows_of_mode[case] for rows_of_mode in data["measured"].values()]
        cell = "{steps} steps, {base_translation:.3f} m, {expanded} states"
        rows.append([case, *(cell.format(**row) for row in results)])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def run_cases(out: Path, progress: Callable[[int], None]) -> tuple[dict[int, Plan], dict[str, Any]]:
    """Plan and draw the four cases in each of `paper.MODES`, and write the table.

    All plans start at the same base pose. The table is written as `table1.json` and `table1.md` to
    a folder. `progress` is called with the number of plans made so far. Returned are the plans with
    collisions checked, by case, and the data of the table.
    """
    setup = default_setup()
    start = Start.of(setup)
    plans: dict[int, Plan] = {}
    rows: dict[str, dict[str, Any]] = {}
    for mode in MODES:
        rows[mode] = {}
        for case in CASES:
            plan, row, tree = plan_case(case, setup, start, mode)
            rows[mode][str(case)] = row
            title = f"{CASES[case].title}, {MODES[mode].title}"
            if mode in MODE_PICTURES:
                name = f"case{case}{MODE_PICTURES[mode]}.png"
                plan_figure(case_map(case, setup), plan, out / name, tree, title)
            if mode == "collisions":
                plans[case] = plan
            progress(sum(map(len, rows.values())))
    data = {
        "setup": setup,
        "start_pose": start.pose,
        "modes": {name: asdict(mode) for name, mode in MODES.items()},
        "measured": rows,
        "paper": {str(k): v for k, v in PAPER.items()},
        "relations": {
            mode: relations({int(k): row for k, row in rows_of_mode.items()})
            for mode, rows_of_mode in rows.items()
        },
        "left_out_without_thresholds": excluded_without_thresholds(setup),
    }
    write_whole(out / "table1.json", json.dumps(data, indent=1) + "\n")
    write_whole(out / "table1.md", table_markdown(data))
    return plans, data


class Start(NamedTuple):
    """Stance and base pose at which all cases start."""

    stance: tuple[str, ...]
    pose: tuple[float, ...]
    """Base pose x, y, z [m] and quaternion w, x, y, z; its posture is chosen with collisions."""

    @classmethod
    def of(cls, setup: dict[str, Any]) -> Start:
        """Return the start of a setup, in the posture with collisions checked."""
        return cls.at(case_graph(2, setup, "collisions"), tuple(setup["start"]))

    @classmethod
    def at(cls, graph: StanceGraph, stance: tuple[str, ...]) -> Start:
        """Return the start at a stance, in its posture in a stance graph."""
        posture = graph.posture(graph.indices(stance))
        orientation = quaternion(posture.base_rotation)[0].tolist()
        return cls(stance, (*posture.base_position[0].tolist(), *orientation))

    def pose_for(self, graph: StanceGraph) -> tuple[float, ...] | None:
        """Return the pose as argument of a planner: None if it is the posture in this graph."""
        return graph.given_pose_of(self.stance, np.array(self.pose[:3]), np.array(self.pose[3:]))


def plan_case(
    case: int, setup: dict[str, Any], start: Start, mode: str
) -> tuple[Plan, dict[str, Any], Array]:
    """Plan a case in one of `paper.MODES`; return plan, row of the table and search tree.

    Raises a `NoPlanError` if no plan exists.
    """
    began = time.perf_counter()
    graph = case_graph(case, setup, mode)
    built = time.perf_counter() - began
    planner = Planner(graph)
    result = planner.plan(
        start.stance,
        setup["goal"],
        CASES[case].cost,
        # The paper's heuristic may overestimate, so that the result depends on the order of
        # expansions: its own search is needed to reproduce it.
        options=SearchOptions(
            method="algorithm1" if MODES[mode].heuristic == "paper" else "astar",
            heuristic=MODES[mode].heuristic,
        ),
        goal_face=setup["goal_face"],
        start_pose=start.pose_for(graph),
    )
    plan = result.unwrap()
    row = {
        "points": len(graph.grasp_map),
        "stances": len(graph),
        **row_of(plan),
        "distinct": _distinct_stances(result.tree, mode),
        "refined": planner.refined(plan).base_translation,
        "stance_set_time": built,
        "stances_of_plan": [list(s) for s in plan.stances],
    }
    return plan, row, result.tree


def row_of(plan: Plan) -> dict[str, Any]:
    """Return the values of a plan that are compared with the paper's."""
    spent = plan.statistics
    return {
        "expanded": spent.expanded,
        "backward": spent.backward,
        "base_translation": plan.base_translation,
        "steps": len(plan.steps),
        "w_m_min": plan.w_m_min,
        "w_b_min": plan.w_b_min,
        "time": spent.feasibility_time + spent.search_time,
    }


def _distinct_stances(tree: Array, mode: str) -> int | None:
    """Count the stances explored; None for a search in stages, whose tree is of the last one."""
    if MODES[mode].heuristic == "relaxed":
        return None
    return len(np.unique(tree[:, 1].round(9), axis=0)) + 1


def excluded_without_thresholds(setup: dict[str, Any]) -> dict[str, float]:
    """Count the stances that are excluded in Case 1, which has no thresholds.

    These are excluded by the path floor of departures and by the robot's span. The effect of the
    span is measured by a comparison with an unlimited span, with and without the check of steps.
    """
    graph = case_graph(1, setup, "steps")
    unchecked = replace(graph.settings, transitions=False)
    wide = unlimited(graph.robot)

    def stances(robot: RobotSpec, settings: Settings) -> int:
        other = stance_graph(graph.grasp_map, robot, settings)
        return len(other)

    unchecked_wide = stances(wide, unchecked)
    return {
        "path_floor": graph.settings.path_floor,
        "span": graph.robot.span,
        "reachable": graph.listed.counts["reachable"],
        "by_floor": graph.listed.counts["no_departure"],
        "by_span": stances(wide, graph.settings) - len(graph),
        "by_span_unchecked": unchecked_wide - stances(graph.robot, unchecked),
        "unchecked_wide": unchecked_wide,
    }


def table_markdown(data: dict[str, Any]) -> str:
    """Return the table as Markdown, with the paper's row of each case above the measured ones."""
    cases = [HEAD, HEAD_LINE]
    for case in map(str, CASES):
        cases += table_rows(data, case, case)
    names = " | ".join(mode["title"] for mode in data["modes"].values())
    lines = [f"| relation | why it may hold | {names} |", "|---|---|" + "---|" * len(data["modes"])]
    first = next(iter(data["relations"].values()))
    for name, relation in first.items():
        held = ["yes" if r[name]["held"] else "**no**" for r in data["relations"].values()]
        lines.append(f"| {name} | {relation['kind']} | {' | '.join(held)} |")
    setup, limits = data["setup"], data["left_out_without_thresholds"]
    return TEMPLATE.read_text(encoding="utf-8").format(
        start=" and ".join(setup["start"]),
        goal=tuple(setup["goal"]),
        face=setup["goal_face"],
        cases="\n".join(cases),
        relations="\n".join(lines),
        percent=100.0 * limits["by_span_unchecked"] / limits["unchecked_wide"],
        **limits,
    )


HEAD = (
    "| case | source | heuristic | explored | stances explored | backward | base translation [m] "
    "| refined [m] | steps | minimum w_m | minimum w_b | time [s] |"
)
HEAD_LINE = "|---|---|---|---|---|---|---|---|---|---|---|---|"


def table_rows(data: dict[str, Any], case: str, title: str) -> list[str]:
    """Return the rows of a case: the paper's, and one for each mode."""
    p = data["paper"][case]
    rows = [
        f"| {title} | paper | d | {p['expanded']:.0f} | | | {p['base_translation']:.1f} | "
        f"| {p['steps']:.0f} | {p['w_m_min']:.2f} | {p['w_b_min']:.4f} | {p['time']:.1f} |"
    ]
    for name, mode in data["modes"].items():
        m = data["measured"][name][case]
        distinct = "" if m["distinct"] is None else m["distinct"]
        rows.append(
            f"| | {mode['title']} | {mode['heuristic']} | {m['expanded']} | {distinct} "
            f"| {m['backward']} | {m['base_translation']:.2f} | {m['refined']:.2f} | {m['steps']} "
            f"| {m['w_m_min']:.4f} | {m['w_b_min']:.5f} "
            f"| {m['stance_set_time']:.2f} + {m['time']:.3f} |"
        )
    return rows
