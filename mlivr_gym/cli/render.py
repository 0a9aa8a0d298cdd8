"""The command `mlivr-gym render`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from mlivr_gym.cli.arguments import (
    CAPSULES,
    chosen_graph,
    chosen_map,
    chosen_task,
    option,
    refuse_ignored,
    world_options,
)
from mlivr_gym.cli.outputs import all_or_none, check_outputs, input_files
from mlivr_gym.cli.progress import Progress
from mlivr_gym.errors import RenderError, SettingError
from mlivr_gym.files import write_whole
from mlivr_gym.pictures.captions import strip_height
from mlivr_gym.pictures.figures import check_ending, save_image
from mlivr_gym.pictures.plan_figures import configuration_figure
from mlivr_gym.pictures.rendering import SIZE, SceneRenderer, Shot
from mlivr_gym.pictures.route import Route
from mlivr_gym.planners import Plan
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    option(parser, "--start POINT...", "ids of the points held, one for each limb")
    option(parser, "--plan FILE", "plan to be drawn, in its start and goal stance")
    option(parser, "--stance K", "draw only the stance of the plan after K steps", type=int)
    option(parser, "--out FILE", "PNG file", "scene.png")
    text = "width and height of the picture of one stance [px]"
    option(parser, "--size W H", text, (1280, 640), SIZE)
    text = "also export the simulation model as MJCF, in the first stance drawn"
    option(parser, "--mjcf FILE", text)
    option(parser, "--capsules", CAPSULES)


def run(args: argparse.Namespace) -> None:
    """Render the MuJoCo scene with the robot in a stance.

    For a plan, render its start and goal stance side by side, or the one chosen with --stance, with
    base path, goal and footholds.
    """
    _check(args)
    check_outputs(args.out, args.mjcf, inputs=input_files(args))
    check_ending(args.out, (".png",))
    obstacles: Sequence[Box]
    if args.plan:
        grasp_map = chosen_map(args)
        plan = Plan.load(args.plan, grasp_map)
        robot, obstacles = plan.world.robot, plan.world.obstacles
        drawn = _plan_shots(grasp_map, plan, args.stance)
        held = plan.configuration(args.stance or 0), plan.stances[args.stance or 0]
    else:
        graph = chosen_graph(args)
        grasp_map, robot, obstacles = graph.grasp_map, graph.robot, graph.obstacles
        args.goal, args.tolerance = (0.0, 0.0, 0.0), 0.2
        start = chosen_task(graph, args)[0] if args.start is None else args.start
        held = graph.configuration(graph.state(start)), graph.ids(graph.state(start).stance)
        drawn = [Shot(held[0])]
    if args.mjcf:
        from mlivr_gym.simulation.export import exported_model  # imports MuJoCo, hence GL

        scene = exported_model(grasp_map, robot, *held, obstacles)
    args.result["files"] = [file for file in (args.out, args.mjcf) if file]
    pictures = {Path(args.out): drawn}
    with all_or_none(args):
        with Progress("drawing", quiet=args.quiet):
            draw(grasp_map, robot, pictures, args.size, obstacles, capsules=args.capsules)
        if args.mjcf:
            write_whole(args.mjcf, scene)
            print(f"scene: {args.mjcf}")


def _check(args: argparse.Namespace) -> None:
    """Refuse arguments that contradict each other."""
    if args.plan and args.start:
        raise SettingError("give only one of --plan and --start")
    if args.stance is not None and not args.plan:
        raise SettingError("--stance needs --plan: it selects one of the plan's stances")
    if args.plan:
        refuse_ignored(args, "plan", ("map", "start"))


def _plan_shots(grasp_map: GraspMap, plan: Plan, stance: int | None) -> list[Shot]:
    """Return the shots of a plan: start and goal, or the chosen stance alone."""
    last = len(plan.stances) - 1
    if stance is not None and not 0 <= stance <= last:
        raise SettingError(
            f"--stance is {stance}; this plan has stances 0 (start) to {last} (goal)"
        )
    return shots_of(grasp_map, plan, (0, last) if stance is None else (stance,))


def shots_of(grasp_map: GraspMap, plan: Plan, stances: Sequence[int]) -> list[Shot]:
    """Return a shot of each given stance of a plan, with the later stances as ghosts."""
    last, route, shots = len(plan.stances) - 1, Route.of(grasp_map, plan), []
    for k in stances:
        name = {0: ": the start", last: ": the goal"}.get(k, "")
        later = f"; pale: stances {k + 1} to {last}" if k < last else ""
        ghosts = [plan.configuration(after) for after in range(k + 1, last + 1)]
        caption = f"stance {k} of {last}{name}{later}"
        shots.append(Shot(plan.configuration(k), (caption,), route, ghosts))
    return shots


def draw(
    grasp_map: GraspMap,
    robot: RobotSpec,
    pictures: Mapping[Path, Sequence[Shot]],
    size: tuple[int, int],
    obstacles: Sequence[Box] = (),
    *,
    capsules: bool = False,
) -> None:
    """Render pictures with MuJoCo, or with matplotlib if no GL library can be used.

    `pictures` are the shots of each picture, which are placed side by side, by the PNG file to
    write; `size` is that of one shot [px]. With `capsules` limbs are drawn by their collision
    shapes.
    """
    (width, height), first = size, next(iter(pictures.values()))[0]
    lower = height - len(first.captions) * strip_height(height)
    try:
        renderer = SceneRenderer(grasp_map, robot, width, lower, obstacles, capsules)
    except RenderError as error:
        print(f"no GL library can be used, so matplotlib draws instead: {error}", flush=True)
        for path, shots in pictures.items():
            shown = [shot.configuration for shot in shots]
            configuration_figure(grasp_map, robot, shown, path, path.stem, first.route)
    else:
        for path, shots in pictures.items():
            save_image(np.hstack([shot.picture(renderer, height) for shot in shots]), path)
        renderer.close()
    for path in pictures:
        print(f"picture: {path}", flush=True)
