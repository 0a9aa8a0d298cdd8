"""The command `mlivr-gym plan`."""

from __future__ import annotations

import argparse
from typing import Any

from mlivr_gym.cli.arguments import (
    Add,
    chosen_graph,
    chosen_task,
    command,
    option,
    refuse_without_effect,
    search_options,
)
from mlivr_gym.cli.outputs import claim
from mlivr_gym.cli.progress import PER_CENT, Progress
from mlivr_gym.errors import NoPlanError
from mlivr_gym.pictures.figures import figure_files
from mlivr_gym.planners import Plan, Planner, PlanningResult
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_table_file import node_table
from mlivr_gym.stances.pair_graph import PairGraph


def add_command(add: Add) -> None:
    """Add the command by `add_parser`, which is told its name and help."""
    parser = command(
        add,
        run,
        groups=("world", "obstacles", "query"),
        description="Plan from a start stance to a goal position of the base. "
        "Start and goal have defaults.",
    )
    option(parser, "--out FILE", "write the plan as JSON")
    option(parser, "--picture FILE", "draw the plan as PNG, and as SVG beside it")
    told = "choose other base poses on the footholds found, for less translation"
    option(parser, "--refined", told)


def run(args: argparse.Namespace) -> None:
    """Plan, describe the plan, and write what is asked for."""
    pictures = figure_files(args.picture) if args.picture is not None else ()
    claim(args.out, *pictures)
    with Progress("making the stance graph", quiet=args.quiet):
        graph = chosen_graph(args)
    result = find_plan(graph, args)
    plan = result.unwrap()
    if args.refined:
        with Progress("refining the plan", quiet=args.quiet):
            before, plan = plan.base_translation, Planner(graph).refined(plan)
        saved = 100.0 * (1.0 - plan.base_translation / before)
        print(f"refined: {plan.base_translation:.3f} m, {saved:.1f} % less translation")
    args.result |= summary_of(plan) | {"files": [f for f in (args.out, *pictures) if f]}
    if args.out:
        plan.save(args.out)
        print(f"plan: {args.out}")
    if pictures:
        from mlivr_gym.pictures.plan_figure import plan_figure  # most plans are not drawn

        title = f"{plan.world.robot.name}, {plan.query.cost_name} cost"
        plan_figure(graph.grasp_map, plan, args.picture, result.tree, title)
        print(f"picture: {pictures[0]}, {pictures[1]}")


STEP_SUMMARY = ("limb", "from_point", "to_point", "displacement", "path", "swing")
"""What `--json` tells of a step."""


def summary_of(plan: Plan) -> dict[str, Any]:
    """A plan as `--json` tells it: lengths in metres, times in seconds."""
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


def fastest_cost(
    planner: Planner, start: tuple[str, ...], goal: tuple[float, ...], args: argparse.Namespace
) -> tuple[str, float | None]:
    """Cost and price of a regrasp of the fastest plan; tells those that were considered."""
    from mlivr_gym.fastest import fastest_plan  # imports MuJoCo, hence GL

    without = (
        "regrasp_price", "method", "heuristic", "inflation", "time_limit", "start_pose",
        "start_joints",
    )  # fmt: skip
    refuse_without_effect(args, "with --cost time", *without)
    with Progress("looking for the fastest plan", quiet=args.quiet):
        found = fastest_plan(
            planner, start, goal, goal_tolerance=args.tolerance, goal_face=args.goal_face
        )
    for one in found:
        plan, charged = one.plan, "" if one.price is None else f", price {one.price:g} m"
        print(
            f"  {one.seconds:5.1f} s: {len(plan.steps)} steps, {plan.base_translation:.3f} m "
            f"(best for cost {one.cost}{charged})"
        )
    return found[0].cost, found[0].price


CUT_OFF = ("goal outside the reachable set", "search exhausted")
"""Reasons for which there is no plan whose cause is looked for."""


def find_plan(graph: PairGraph | LazyGraph, args: argparse.Namespace) -> PlanningResult:
    """Plan between start and goal of the arguments, and describe the plan.

    Raises
    ------
    NoPlanError
        If there is no plan.
    """
    if args.method in ("dijkstra", "greedy"):
        names = ("inflation",) if args.method == "greedy" else ("heuristic", "inflation")
        refuse_without_effect(args, f"with --method {args.method}", *names)
    with Progress("choosing start and goal", quiet=args.quiet):
        start, goal = chosen_task(graph, args)
    if isinstance(graph, LazyGraph):
        with Progress("table of all nodes", quiet=args.quiet):
            table = None if graph.obstacles else node_table(graph)
        if table is None:
            name = "sets of points within reach [%]"
            with Progress(name, PER_CENT, quiet=args.quiet) as progress:
                graph.sets(progress.show_share)
    planner, cost, price = Planner(graph), args.cost, args.regrasp_price
    if cost == "time":
        cost, price = fastest_cost(planner, start, goal, args)
    with Progress("states explored", quiet=args.quiet) as progress:
        result = planner.plan(
            start, goal, cost, regrasp_price=price, progress=progress.show, **search_options(args)
        )
    if result.reason in CUT_OFF:
        how = {name: getattr(args, name) for name in ("goal_face", "start_pose", "start_joints")}
        with Progress("looking for the cause", quiet=args.quiet):
            cause = planner.why_not(start, goal, goal_tolerance=args.tolerance, **how)
        raise NoPlanError(f"{result.message}; {cause.message}")
    plan = result.unwrap()
    print(
        f"from {' '.join(start)} to {goal}: {result.message}, "
        f"w_m >= {plan.w_m_min:.3f}, w_b >= {plan.w_b_min:.5f}"
    )
    for k, step in enumerate(plan.steps, 1):
        print(
            f"  {k:2d}. limb {step.limb}: {step.from_point:>6} -> {step.to_point:<6} "
            f"base {step.displacement:.3f} m, {step.path}, swing {step.swing}"
        )
    bound = plan.statistics.bound
    if bound is not None and graph.limbs > 2:
        print(f"cost {plan.statistics.cost:.3f}, proved within {bound:.2f} times the least")
    print(
        f"{plan.statistics.expanded} states explored, {plan.statistics.generated} generated, "
        f"{1e3 * (plan.statistics.feasibility_time + plan.statistics.search_time):.1f} ms "
        "for the query"
    )
    return result
