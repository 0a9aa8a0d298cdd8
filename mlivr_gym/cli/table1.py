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
from mlivr_gym.cli.arguments import Add, command, option
from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.outputs import check_outputs, make_folder
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
from mlivr_gym.pictures.plan_figure import plan_figure
from mlivr_gym.pictures.route import Route
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.world.grasp_map import jem_map

MODE_PICTURES = {"steps": "", "collisions": "_collisions"}
"""Modes whose plans are drawn, and what their files' names end with."""

TEMPLATE = asset_path("table1.md")
"""What the table says, with its figures as fields."""

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
"""What the command writes."""


def add_command(add: Add) -> None:
    """Add the command by `add_parser`, which is told its name and help."""
    parser = command(
        add,
        run,
        description="Plan the four cases, draw and tabulate them.",
    )
    option(parser, "--out FOLDER", "where results go", "table1")


def run(args: argparse.Namespace) -> int:
    """Write the table and its pictures; 1 if a relation does not hold that cannot but hold."""
    out = Path(args.out)
    check_outputs(*(out / name for name in FILES), folder=out)
    with Progress("cases planned", len(CASES) * len(MODES), args.quiet) as progress:
        plans, data = run_cases(out, progress.show)
    print(report(data))
    plan = plans[3]
    ends = {"start": 0, "goal": len(plan.stances) - 1}
    pictures = {out / f"scene_{name}.png": shots_of(plan, [k]) for name, k in ends.items()}
    grasp_map = jem_map()
    route = Route.of(grasp_map, plan)
    draw(grasp_map, plan.world.robot, pictures, (1600, 800), plan.world.obstacles, route)
    failed = broken_relations(data)
    args.result |= data | {"impossible": failed}
    args.result |= {"folder": out, "files": FILES}
    print(f"table: {out / 'table1.md'}, {out / 'table1.json'}; pictures: {out / 'case*.png'}, .svg")
    for name in failed:
        print(f"relation does not hold: {name}")
    return FAILED if failed else SUCCESS


def broken_relations(data: dict[str, Any]) -> list[str]:
    """Relations that do not hold although optimal plans cannot but hold them."""
    return [
        f"{name} ({MODES[mode].title})"
        for mode, found in data["relations"].items()
        if MODES[mode].heuristic != "paper"
        for name, relation in found.items()
        if relation["kind"] == CONSTRUCTION and not relation["held"]
    ]


def report(data: dict[str, Any]) -> str:
    """Steps, base translation and states explored of each case, in as many columns as modes."""
    rows = [["case", *(mode["title"] for mode in data["modes"].values())]]
    for case in map(str, CASES):
        found = [rows_of_mode[case] for rows_of_mode in data["measured"].values()]
        words = "{steps} steps, {base_translation:.3f} m, {expanded} states"
        rows.append([case, *(words.format(**row) for row in found)])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def run_cases(out: Path, progress: Callable[[int], None]) -> tuple[dict[int, Plan], dict[str, Any]]:
    """Plan the four cases in each of `paper.MODES`, from one start pose.

    Draws them, and writes `table1.json` and `table1.md`.

    Parameters
    ----------
    out
        Folder for the results; made if it is missing.
    progress
        Called with the number of cases planned, each in one mode.

    Returns
    -------
    tuple[dict[int, Plan], dict[str, Any]]
        The plans with collisions checked, and the data of the table.
    """
    make_folder(out)
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
            mode: relations({int(k): row for k, row in found.items()})
            for mode, found in rows.items()
        },
        "left_out_without_thresholds": excluded_without_thresholds(setup),
    }
    write_whole(out / "table1.json", json.dumps(data, indent=1) + "\n")
    write_whole(out / "table1.md", table_markdown(data))
    return plans, data


class Start(NamedTuple):
    """Where all cases begin."""

    stance: tuple[str, ...]
    pose: tuple[float, ...]
    """Base pose x, y, z [m] and quaternion w, x, y, z: that with collisions checked."""

    @classmethod
    def of(cls, setup: dict[str, Any]) -> Start:
        """The start of a setup."""
        return cls.at(case_graph(2, setup, "collisions"), tuple(setup["start"]))

    @classmethod
    def at(cls, graph: PairGraph, stance: tuple[str, ...]) -> Start:
        """A stance in the posture that a graph gives it."""
        posture = graph.posture(graph.indices(stance))
        turn = quaternion(posture.base_rotation)[0].tolist()
        return cls(stance, (*posture.base_position[0].tolist(), *turn))

    def pose_for(self, graph: PairGraph) -> tuple[float, ...] | None:
        """The pose as a planner takes it: None where the stance has it anyway."""
        return graph.given_pose_of(self.stance, np.array(self.pose[:3]), np.array(self.pose[3:]))


def plan_case(
    case: int, setup: dict[str, Any], start: Start, mode: str
) -> tuple[Plan, dict[str, Any], Array]:
    """Plan, row and explored base paths of a case in one of `paper.MODES`.

    Raises
    ------
    NoPlanError
        If there is no plan.
    """
    began = time.perf_counter()
    graph = case_graph(case, setup, mode)
    built = time.perf_counter() - began
    planner = Planner(graph)
    result = planner.plan(
        start.stance,
        setup["goal"],
        CASES[case].cost,
        # The paper's own search explores states in its own order, which decides where its heuristic
        # overestimates.
        method="algorithm1" if MODES[mode].heuristic == "paper" else "astar",
        heuristic=MODES[mode].heuristic,
        goal_face=setup["goal_face"],
        start_pose=start.pose_for(graph),
    )
    plan = result.unwrap()
    row = {
        "points": len(graph.grasp_map),
        "stances": len(graph),
        "expanded": plan.statistics.expanded,
        "backward": plan.statistics.backward,
        "distinct": _distinct_stances(result.tree, mode),
        "base_translation": plan.base_translation,
        "refined": planner.refined(plan).base_translation,
        "steps": len(plan.steps),
        "w_m_min": plan.w_m_min,
        "w_b_min": plan.w_b_min,
        "stance_set_time": built,
        "time": plan.statistics.feasibility_time + plan.statistics.search_time,
        "stances_of_plan": [list(s) for s in plan.stances],
    }
    return plan, row, result.tree


def _distinct_stances(tree: Array, mode: str) -> int | None:
    """Stances explored; not known of a search in several rounds, whose last alone is told."""
    if MODES[mode].heuristic == "cost_to_go":
        return None
    return len(np.unique(tree[:, 1].round(9), axis=0)) + 1


def excluded_without_thresholds(setup: dict[str, Any]) -> dict[str, float]:
    """What rules out stances in Case 1, which has no thresholds.

    That is the floor of departures, and the robot's span. The span is compared with one that no
    two limbs can reach, where steps are checked and where they are not.
    """
    graph = case_graph(1, setup, "steps")
    unchecked = replace(graph.settings, transitions=False)
    wide = unlimited(graph.robot)

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
    cases = [HEAD, HEAD_LINE]
    for case in map(str, CASES):
        cases += table_rows(data, case, case)
    names = " | ".join(mode["title"] for mode in data["modes"].values())
    found = [f"| relation | why it may hold | {names} |", "|---|---|" + "---|" * len(data["modes"])]
    first = next(iter(data["relations"].values()))
    for name, relation in first.items():
        held = ["yes" if r[name]["held"] else "**no**" for r in data["relations"].values()]
        found.append(f"| {name} | {relation['kind']} | {' | '.join(held)} |")
    setup, limits = data["setup"], data["left_out_without_thresholds"]
    return TEMPLATE.read_text(encoding="utf-8").format(
        start=" and ".join(setup["start"]),
        goal=tuple(setup["goal"]),
        face=setup["goal_face"],
        cases="\n".join(cases),
        relations="\n".join(found),
        percent=100.0 * limits["by_span_unchecked"] / limits["unchecked_wide"],
        **limits,
    )


HEAD = (
    "| case | source | heuristic | explored | stances explored | backward | base translation [m] "
    "| refined [m] | steps | least w_m | least w_b | time [s] |"
)
HEAD_LINE = "|---|---|---|---|---|---|---|---|---|---|---|---|"


def table_rows(data: dict[str, Any], case: str, title: str) -> list[str]:
    """Rows of a case: the paper's, and one for each mode."""
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
