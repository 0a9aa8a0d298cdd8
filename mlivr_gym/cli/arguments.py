"""Arguments that several commands share, and what is made of them."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import NoPlanError, SettingError, StanceError
from mlivr_gym.paper import default_setup
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.schema import FieldPath, Whole
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.world.boxes import Box, load_obstacles
from mlivr_gym.world.grasp_map import GraspMap, jem_map

MAX_SEED = 2**31
"""Largest seed; each episode takes the next, and NumPy's old generator takes 32 bits."""

MAX_EPISODES = 10**6
"""Most episodes of one command."""

MAX_THREADS = 1024
"""Most threads of PyTorch."""

MAX_BEAM_WIDTH = 1000
"""Most walks that a beam search keeps."""


Add: TypeAlias = Callable[..., argparse.ArgumentParser]
"""Adds a command to the parser's, whose name and help it knows."""


def command(
    add: Add, run: Callable[[argparse.Namespace], int | None], **told: Any
) -> argparse.ArgumentParser:
    """Add a command to the parser's.

    Parameters
    ----------
    add
        What adds it.
    run
        What it does with its arguments; returns its exit code, or None for success.
    **told
        `groups`, the names of `GROUPS` it has besides those of what is printed, and
        arguments of `add_parser`.
    """
    groups = (*told.pop("groups", ()), "output")
    parser = add(parents=[GROUPS[group]() for group in groups], **told)
    parser.set_defaults(run=run)
    return parser


def option(
    parser: argparse._ActionsContainer, usage: str, told: str, default: Any = None, **rest: Any
) -> None:
    """Add an option as its usage reads.

    Parameters
    ----------
    parser
        The parser, or a group of it.
    usage
        `"--json"` is a switch, `"--size W H"` takes two values, `"--start POINT..."` any.
    told
        Its help, to which the default is added.
    default
        What it is if it is not given, whose type its values have.
    **rest
        Further arguments of `add_argument`.
    """
    names = [word for word in usage.split() if word.startswith("-")]
    values = usage.split()[len(names) :]
    if not values:
        parser.add_argument(*names, action="store_true", help=told, **rest)
        return
    first = default[0] if isinstance(default, tuple) else default
    if isinstance(first, int | float):
        rest["type"] = type(first)
    if "choices" not in rest:
        rest["metavar"] = tuple(values) if len(values) > 1 else values[0].removesuffix("...")
    if len(values) > 1 or values[0].endswith("..."):
        rest["nargs"] = len(values) if len(values) > 1 else "+"
    elif default is not None and default != []:
        told += " (default: %(default)s)"
    parser.add_argument(*names, default=default, help=told, **rest)


def _parent_parser() -> argparse.ArgumentParser:
    """A parser for `parents`."""
    return argparse.ArgumentParser(add_help=False)


def world_arguments() -> argparse.ArgumentParser:
    """The arguments of robot, map and thresholds, for `parents`."""
    parser = _parent_parser()
    option(parser, "--robot ROBOT", "mlivr2, mlivr3, mlivr4 or a JSON file", "mlivr2")
    option(parser, "--map FILE", "map as a JSON file (default: the measured JEM)")
    option(parser, "--no-manipulability", "do without both thresholds")
    option(parser, "--no-transitions", "do not check that steps can be executed")
    option(parser, "--no-collisions", "let limbs touch each other and the cabin")
    option(parser, "--clearance M", "least distance between shapes [m]", 0.02)
    option(parser, "--limb-threshold W", "least w_m", 0.1)
    option(parser, "--base-threshold W", "least w_b (default: 0.001 (2/N)^3)", type=float)
    return parser


def output_arguments() -> argparse.ArgumentParser:
    """The arguments of what is printed, for `parents`."""
    parser = _parent_parser()
    told = "print the result as one JSON object in place of text, also where the command fails"
    option(parser, "--json", told)
    option(parser, "-q --quiet", "print neither text nor progress")
    return parser


def obstacle_arguments() -> argparse.ArgumentParser:
    """The arguments of obstacles and occupied points, for `parents`."""
    parser, boxes = _parent_parser(), {"type": float, "action": "append"}
    option(parser, "--obstacles FILE", "boxes and occupied points as a JSON file")
    told = "a box or keep-out zone, lower and upper corner [m]; may be repeated"
    option(parser, "--box X0 Y0 Z0 X1 Y1 Z1", told, [], **boxes)
    option(parser, "--occupied POINT...", "points that may not be grasped", [])
    return parser


def query_arguments() -> argparse.ArgumentParser:
    """The arguments of start, goal and search, for `parents`."""
    parser = _parent_parser()
    option(parser, "--start POINT...", "point id of each limb")
    option(
        parser,
        "--start-pose X Y Z QW QX QY QZ",
        "base pose at the start, if the robot stands in another than that of its stance [m] "
        "(default: that one)",
        type=float,
    )
    told = "joint angles at the start, six for each limb [rad] (default: any that hold the points)"
    option(parser, "--start-joints Q...", told, type=float)
    option(parser, "--goal X Y Z", "goal position of the base [m]", type=float)
    option(parser, "--tolerance M", "radius of the goal [m]", 0.2)
    option(parser, "--goal-face FACE", "all limbs are to hold points of this face at the goal")
    told = "base, steps, weighted, or time: fastest of several plans"
    option(parser, "--cost COST", told, "base")
    option(parser, "--regrasp-price M", "metres charged for a regrasp, with weighted", type=float)
    option(parser, "--method METHOD", "astar, dijkstra, greedy or algorithm1", "astar")
    option(parser, "--heuristic HEURISTIC", "cost_to_go, consistent, paper or zero")
    option(
        parser,
        "--inflation E",
        "the plan costs at most E times the least (default: 1 for two limbs; with more the "
        "first plan found is taken, and within what factor it is proved is told)",
        type=float,
    )
    told = "more than two limbs: look for a plan and improve it for S seconds at most"
    option(parser, "--time-limit S", told, type=float)
    option(parser, "--limit LIMIT", "most states explored", 200_000)
    return parser


GROUPS = {
    "world": world_arguments,
    "obstacles": obstacle_arguments,
    "query": query_arguments,
    "output": output_arguments,
}
"""Arguments that several commands have, by name."""


def search_options(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `Planner.plan` besides start, goal and cost."""
    names = (
        "goal_face", "start_pose", "start_joints", "method", "heuristic", "inflation", "limit",
        "time_limit",
    )  # fmt: skip
    return {"goal_tolerance": args.tolerance} | {name: getattr(args, name) for name in names}


def chosen_map(args: argparse.Namespace) -> GraspMap:
    """The map of `--map`, by default the measured JEM."""
    return GraspMap.load(args.map) if args.map else jem_map()


def chosen_graph(args: argparse.Namespace) -> PairGraph | LazyGraph:
    """The stance graph of the arguments, with the obstacles of commands that take some."""
    _check_world(args)
    settings = Settings(
        limb_threshold=args.limb_threshold,
        base_threshold=args.base_threshold,
        clearance=args.clearance,
        **_switched_off(args),
    )
    graph = stance_graph(chosen_map(args), robot_spec(args.robot), settings)
    if "box" in args:
        boxes = [
            Box.between(f"box{k}", "obstacle", box[:3], box[3:]) for k, box in enumerate(args.box)
        ]
        occupied = list(args.occupied)
        if args.obstacles:
            more, points = load_obstacles(args.obstacles)
            boxes.extend(more)
            occupied.extend(points)
        graph.add_obstacles(boxes)
        graph.occupy(occupied)
    return graph


def chosen_task(
    graph: PairGraph | LazyGraph, args: argparse.Namespace
) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Start (point ids) and goal [m].

    As given, else the calibrated ones on the JEM with two limbs, else a seeded draw.
    """
    start, goal = args.start, args.goal
    if start is None or goal is None:
        setup = default_setup()
        if graph.limbs == 2 and args.map is None:
            start, goal = start or setup["start"], goal or setup["goal"]
        else:
            if start is not None:
                graph.indices(start)  # what is no stance at all is refused as such
            try:
                pose = (getattr(args, "start_pose", None), getattr(args, "start_joints", None))
                given = graph.state(start, *pose) if start is not None else None
                state, target = sample_task(graph, np.random.default_rng(0), args.tolerance, given)
            except StanceError as error:
                raise NoPlanError(str(error)) from None
            start, goal = start or graph.ids(state.stance), goal or target.tolist()
    return tuple(start), tuple(float(v) for v in goal)


def refuse_ignored(args: argparse.Namespace, chosen: str, taken: tuple[str, ...]) -> None:
    """Refuse arguments of world, obstacles and query that what was chosen decides itself.

    Parameters
    ----------
    args
        All arguments.
    chosen
        The argument that decides.
    taken
        Arguments that have a meaning beside it.

    Raises
    ------
    SettingError
        naming one that would have no effect.
    """
    parsers = (world_arguments(), obstacle_arguments(), query_arguments())
    decided = {name for parser in parsers for name in vars(parser.parse_args([]))} - {*taken}
    refuse_without_effect(
        args, f"beside --{chosen}, which decides it", *(name for name in decided if name in args)
    )


def refuse_without_effect(args: argparse.Namespace, why: str, *names: str) -> None:
    """Refuse arguments that have no effect where they are given, for a reason.

    Raises
    ------
    SettingError
        naming the first of them.
    """
    for name in sorted(names):
        if getattr(args, name) != args.default(name):
            raise SettingError(f"--{name.replace('_', '-')} has no effect {why}; leave it out")


def _check_world(args: argparse.Namespace) -> None:
    """Refuse thresholds and a clearance that nothing is compared with."""
    if args.no_manipulability:
        refuse_without_effect(args, "with --no-manipulability", "limb_threshold", "base_threshold")
    if args.no_collisions:
        refuse_without_effect(args, "with --no-collisions", "clearance")


def check_counts(args: argparse.Namespace) -> None:
    """Refuse a seed, a number of episodes or threads, or a width of a beam that cannot be."""
    for name, least, most in (
        ("seed", 0, MAX_SEED),
        ("episodes", 1, MAX_EPISODES),
        ("beam", 1, MAX_BEAM_WIDTH),
        ("threads", 1, MAX_THREADS),
    ):
        value = getattr(args, name, None)
        if value is not None:
            Whole(least, most).read(value, FieldPath(f"--{name}", SettingError))


def environment_arguments(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `MlivrEnv` from the command line, without defaults."""
    _check_world(args)
    names = (
        "robot", "map", "clearance", "base_threshold", "limb_threshold", "reward", "grasp_failure",
        "shaping",
    )  # fmt: skip
    given = {name: getattr(args, name) for name in names if name in args}
    changed = {name: value for name, value in given.items() if value != args.default(name)}
    return changed | _switched_off(args)


def _switched_off(args: argparse.Namespace) -> dict[str, bool]:
    """Checks of the stance graph that are left out."""
    names = ("manipulability", "transitions", "collisions")
    return {name: False for name in names if getattr(args, f"no_{name}")}
