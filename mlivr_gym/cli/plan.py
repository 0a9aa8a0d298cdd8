"""The command `mlivr-gym plan`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

from mlivr_gym.cli.arguments import (
    chosen_graph,
    chosen_map,
    chosen_task,
    obstacle_options,
    option,
    query_options,
    refuse_without_effect,
    search_options,
    world_options,
)
from mlivr_gym.cli.outputs import all_or_none, check_outputs, input_files
from mlivr_gym.cli.progress import Progress
from mlivr_gym.compiled.compiling import compilation
from mlivr_gym.errors import NoPlanError
from mlivr_gym.pictures.figures import figure_files
from mlivr_gym.planners import Plan, Planner, PlanningResult
from mlivr_gym.planners.planning_result import PROVED_IMPOSSIBLE
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_build import find_table


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    obstacle_options(parser)
    query_options(parser)
    option(parser, "--out FILE", "write the plan to a JSON file")
    option(parser, "--picture FILE", "draw the plan to a PNG file and an SVG file of that name")
    text = "shorten the base path afterwards by other base poses on the same footholds"
    option(parser, "--refined", text)


def run(args: argparse.Namespace) -> None:
    """Plan from a start stance to a goal position of the base.

    Without --start and --goal, those of the paper's Table I are used; on another map, or for
    another robot, they are drawn with a fixed seed.
    """
    pictures = figure_files(args.picture) if args.picture is not None else ()
    check_outputs(args.out, *pictures, inputs=input_files(args))
    graph = chosen_graph(args)
    result = find_plan(graph, args)
    plan = result.unwrap()
    if args.refined:
        with Progress("refining the plan", quiet=args.quiet):
            before, plan = plan.base_translation, Planner(graph).refined(plan)
        saved = 100.0 * (1.0 - plan.base_translation / before)
        print(f"refined: {plan.base_translation:.3f} m of base translation, {saved:.1f} % less")
    args.result |= summary_of(plan) | {"files": [f for f in (args.out, *pictures) if f]}
    with all_or_none(args):
        if args.out:
            plan.save(args.out)
            print(f"plan: {args.out}")
        if pictures:
            from mlivr_gym.pictures.plan_figures import plan_figure  # imports matplotlib

            title = f"{plan.world.robot.name}, {plan.query.cost_name} cost"
            plan_figure(chosen_map(args), plan, args.picture, result.tree, title)
            print(f"picture: {pictures[0]}, {pictures[1]}")


STEP_SUMMARY = ("limb", "from_point", "to_point", "displacement", "swing")
"""Fields of a step that `--json` prints."""


def summary_of(plan: Plan) -> dict[str, Any]:
    """Return the fields of a plan that `--json` prints: lengths in metres, times in seconds."""
    spent = plan.statistics
    return {
        "robot": plan.world.robot.name,
        "map": plan.world.map_name,
        "start": plan.stances[0],
        "goal": plan.query.goal,
        "cost_name": plan.query.cost_name,
        "cost": plan.cost,
        "base_translation": plan.base_translation,
        "w_m_min": plan.w_m_min,
        "w_b_min": plan.w_b_min,
        "steps": [{name: getattr(step, name) for name in STEP_SUMMARY} for step in plan.steps],
        "bound": spent.bound,
        "expanded": spent.expanded,
        "generated": spent.generated,
        "query_time": spent.feasibility_time + spent.search_time,
    }


def find_plan(graph: StanceGraph, args: argparse.Namespace) -> PlanningResult:
    """Plan from the start to the goal of the arguments, and print the plan.

    Raises a `NoPlanError` if no plan exists; the message says which rule excludes it.
    """
    if args.method in ("dijkstra", "greedy"):
        names = ("inflation",) if args.method == "greedy" else ("heuristic", "inflation")
        refuse_without_effect(args, f"with --method {args.method}", *names)
    with Progress("choosing start and goal", quiet=args.quiet):
        start, goal = chosen_task(graph, args)
    expanded = "states expanded"
    if not graph.lists_all:
        with Progress("loading the node table", quiet=args.quiet):
            table = find_table(graph)
        if table is None:
            expanded += ", without a node table (see mlivr-gym build)"
    planner, given = Planner(graph), search_options(args)
    with Progress(expanded, quiet=args.quiet) as progress:
        given["options"] = replace(given["options"], progress=progress.show)
        result = planner.plan(start, goal, args.cost, regrasp_price=args.regrasp_price, **given)
    if result.reason in PROVED_IMPOSSIBLE:
        query = {name: given[name] for name in ("goal_face", "start_pose", "start_joints")}
        with Progress("searching for the cause", quiet=args.quiet):
            cause = planner.why_not(start, goal, goal_tolerance=args.tolerance, **query)
        raise NoPlanError("; ".join(dict.fromkeys([result.message, cause.message])))
    print_plan(graph, result, start, goal)
    return result


def print_plan(
    graph: StanceGraph, result: PlanningResult, start: tuple[str, ...], goal: tuple[float, ...]
) -> None:
    """Print a plan.

    Raises a `NoPlanError` if there is none.
    """
    plan = result.unwrap()
    print(
        f"from {' '.join(start)} to {goal}: {len(plan.steps)} steps, "
        f"{plan.base_translation:.3f} m, minimum w_m {plan.w_m_min:.3f}, "
        f"minimum w_b {plan.w_b_min:.5f}"
    )
    for k, step in enumerate(plan.steps, 1):
        print(
            f"  {k:2d}. limb {step.limb}: {step.from_point:>6} -> {step.to_point:<6} "
            f"base {step.displacement:.3f} m, swing {step.swing}"
        )
    bound = plan.statistics.bound
    if bound is not None and (not graph.lists_all or bound > 1.0):
        print(
            f"cost {plan.statistics.cost:.3f}, proved to be at most {bound:.3f} times the minimum"
        )
    print(
        f"{plan.statistics.expanded} states expanded, {plan.statistics.generated} generated, "
        f"{1e3 * (plan.statistics.feasibility_time + plan.statistics.search_time):.1f} ms "
        f"for the query{', compiling included' if compilation.seconds else ''}"
    )
