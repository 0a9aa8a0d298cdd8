"""The command `mlivr-gym walk`: walk in the closed loop through a module that is partly unknown."""

from __future__ import annotations

import argparse
import json
from functools import partial

from mlivr_gym.cli.arguments import (
    BOXES,
    SEED,
    chosen_graph,
    chosen_task,
    controller_option,
    numbered_boxes,
    obstacle_options,
    option,
    refuse_without_effect,
    walk_options,
    world_options,
)
from mlivr_gym.cli.exits import FAILED, NO_PLAN, SUCCESS
from mlivr_gym.cli.films import film_options, make_film
from mlivr_gym.cli.outputs import all_or_none, check_outputs, input_files
from mlivr_gym.extensions.closed_loop.film import closed_loop_film
from mlivr_gym.extensions.closed_loop.record import ARRIVED, STOPPED
from mlivr_gym.files import write_whole
from mlivr_gym.pictures import check_film_format, walk_figure
from mlivr_gym.pictures.figures import figure_files
from mlivr_gym.schema import Choice


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    obstacle_options(parser)
    walk_options(parser)
    option(parser, "--goal X Y Z", "goal position of the base [m]", type=float)
    option(parser, "--tolerance M", "radius of the goal region [m]", 0.2)
    text = "box that the robot does not know, by its lower and upper corner [m]; may be repeated"
    option(parser, "--unknown X0 Y0 Z0 X1 Y1 Z1", text, [], **BOXES)
    option(parser, "--refusing POINT...", "ids of points that refuse a grasp", [])
    option(parser, "--blind", "switch the cameras off")
    controller_option(parser)
    text = "make robot and module differ from the model of the controller"
    option(parser, "--disturbances WHICH", text, "none", Choice(("none", "all")))
    option(parser, "--seed N", "seed of disturbances and noise", 1, SEED)
    option(parser, "--out FILE", "write the record of the walk to a JSON file")
    option(parser, "--picture FILE", "draw the walk to a PNG file and an SVG file of that name")
    option(parser, "--film FILE", "film the walk to a .gif or an .mp4")
    film_options(parser)


def run(args: argparse.Namespace) -> int:
    """Walk to a goal in MuJoCo, and replan where what is seen blocks the plan.

    Boxes given with --unknown and points given with --refusing are there, but the robot does not
    know them: it sees boxes with the depth cameras of its body and grippers, and notices a refused
    grasp. Boxes given with --box are known.
    """
    from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
    from mlivr_gym.extensions.closed_loop.loop import run_closed_loop
    from mlivr_gym.simulation import Setup

    if args.film is None:
        refuse_without_effect(args, "without --film", "size", "speed")
    else:
        check_film_format(args.film)
    pictures = figure_files(args.picture) if args.picture is not None else ()
    check_outputs(args.out, args.film, *pictures, inputs=input_files(args))
    graph = chosen_graph(args)
    start, goal = chosen_task(graph, args)
    unknown = numbered_boxes("unknown", args.unknown)
    record = run_closed_loop(
        graph, start, goal, args.cost,
        goal_tolerance=args.tolerance,
        unknown=unknown,
        refusing=args.refusing,
        camera=None if args.blind else DepthCamera(),
        setup=Setup.of(args.pace, args.controller, disturbances=args.disturbances),
        seed=args.seed,
        show=lambda event: print(f"{event.time:7.1f} s  {event.line}"),
        filmed=args.film is not None,
    )  # fmt: skip
    args.result |= record.to_dict()
    times = 1e3 * record.replanning_times
    print(
        f"{record.outcome}: {record.reason}\n{record.steps} steps in {record.duration:.1f} s, "
        f"at most {record.peak_force:.0f} N at a grasp"
        + (f"; replanning {times.mean():.0f} ms on average" if len(times) else "")
    )
    with all_or_none(args):
        if args.out:
            write_whole(args.out, json.dumps(record.to_dict(), indent=1))
            print(f"record: {args.out}")
        if pictures and record.plans:
            boxes = (*graph.obstacles, *unknown)
            walk_figure(graph.grasp_map, record.plans, args.picture, boxes)
            print(f"picture: {pictures[0]}, {pictures[1]}")
        if args.film is not None:
            if record.footage is None or not record.footage.recordings:
                print("no film: the robot did not move")
            else:
                make = partial(closed_loop_film, graph, record, args.film, unknown=unknown)
                make_film(args, args.film, record.footage.recording, make)
    return {ARRIVED: SUCCESS, STOPPED: NO_PLAN}.get(record.outcome, FAILED)
