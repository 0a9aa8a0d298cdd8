"""The command `mlivr-gym view`."""

from __future__ import annotations

import argparse
from contextlib import closing, suppress
from pathlib import Path

from mlivr_gym import stance_graph
from mlivr_gym.cli.arguments import (
    CAPSULES,
    chosen_graph,
    chosen_map,
    chosen_task,
    obstacle_options,
    option,
    query_options,
    refuse_ignored,
    refuse_without_effect,
    search_options,
    world_options,
)
from mlivr_gym.cli.exits import SUCCESS
from mlivr_gym.cli.outputs import check_outputs, input_files
from mlivr_gym.cli.progress import Progress
from mlivr_gym.errors import NoPlanError
from mlivr_gym.extensions.viewer.frames import Frames, load_frames
from mlivr_gym.extensions.viewer.live_plan import LivePlan, query_of
from mlivr_gym.extras import require
from mlivr_gym.motion import Plan
from mlivr_gym.schema import Integer

HOST, PORT = "127.0.0.1", 8080
"""Default address of the page, which this computer alone can reach."""

FILES = "plan.json", "simulation.npz"
"""Files that are read from the folder of an execution."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    obstacle_options(parser)
    query_options(parser)
    option(parser, "--plan FILE", "plan to show")
    option(parser, "--execution FOLDER", "folder that `mlivr-gym simulate` has written")
    option(parser, "--out FILE", "write a page to this HTML file instead of serving it")
    text = "network interface of the server; the default is reachable from this computer alone"
    option(parser, "--host HOST", text, HOST)
    text = "port of the server, or the next free one if it is taken; 0 for any free port"
    option(parser, "--port PORT", text, PORT, Integer(0, 65535))
    option(parser, "--capsules", CAPSULES)


def run(args: argparse.Namespace) -> int:
    """Serve a page in the browser that plays a plan or an execution.

    The plan is planned anew when a point is clicked, or goal, cost or obstacles are changed there.
    With --out, write one HTML file that plays without a server. Needs the extra 'viewer'.
    """
    require("viser", "trimesh", extra="viewer")
    check_outputs(args.out, inputs=input_files(args))
    live, executed = _live_plan(args)
    print(live.message if live.plan is not None else f"no plan: {live.message}", flush=True)
    if args.out:
        from mlivr_gym.extensions.viewer.viewer import write_html

        if live.plan is None:
            raise NoPlanError(live.message)
        size = write_html(args.out, live.graph, live.plan, executed, args.capsules)
        print(f"page: {args.out}, {size / 1e6:.2f} MB")
        args.result |= {"files": [args.out], "bytes": size}
        return SUCCESS
    return _serve(args, live, executed)


def _live_plan(args: argparse.Namespace) -> tuple[LivePlan, Frames | None]:
    """Return the live plan, and the frames of its execution if there is one."""
    if args.execution:
        refuse_without_effect(args, "with --execution, whose folder has the plan", "plan")
    if args.plan or args.execution:
        refuse_ignored(args, "plan" if args.plan else "execution", ("map",))
        folder = Path(args.execution or "")
        file = args.plan or folder / FILES[0]
        plan = Plan.load(file, chosen_map(args))
        executed = load_frames(folder / FILES[1], plan) if args.execution else None
        with Progress("building the stance graph", quiet=args.quiet):
            graph = stance_graph(chosen_map(args), plan.world.robot, plan.world.settings)
            graph.add_obstacles(plan.world.obstacles)
            graph.occupy(plan.world.occupied)
        return LivePlan(graph, query_of(graph, plan), plan), executed
    graph = chosen_graph(args)
    start, goal = chosen_task(graph, args)
    query = {"cost": args.cost, "regrasp_price": args.regrasp_price, **search_options(args)}
    live = LivePlan(graph, {"start": start, "goal": goal, **query})
    with Progress("planning", quiet=args.quiet):
        live.replan()
    return live, None


def _serve(args: argparse.Namespace, live: LivePlan, executed: Frames | None) -> int:
    """Serve the page until Ctrl-C."""
    from mlivr_gym.extensions.viewer.page import Page
    from mlivr_gym.extensions.viewer.viewer import Viewer, add_panel

    page = Page(args.host, args.port, "mlivr-gym")
    viewer = Viewer(page, live, executed, capsules=args.capsules)
    with closing(viewer), suppress(KeyboardInterrupt):  # Ctrl-C is how the server is stopped
        viewer.speed = 1.0 if executed is None else 10.0
        add_panel(viewer)
        print(f"page: {page.address} (stop with Ctrl-C)", flush=True)
        viewer.run()
    return SUCCESS
