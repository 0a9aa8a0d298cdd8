"""Arguments that several commands share, and what is made of them."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import NoPlanError, SettingError, StanceError
from mlivr_gym.paper import default_setup
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.schema import Place, Whole
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.world.boxes import Box, load_obstacles
from mlivr_gym.world.grasp_map import GraspMap, jem_map

LARGEST_SEED = 2**31
"""Largest seed; each episode takes the next, and NumPy's old generator takes 32 bits."""

MOST_EPISODES = 10**6
"""Most episodes of one command."""

MOST_THREADS = 1024
"""Most threads of PyTorch."""

WIDEST_BEAM = 1000
"""Most walks that a beam search keeps."""


def world_arguments() -> argparse.ArgumentParser:
    """The arguments of robot, map and thresholds, for `parents`."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument(
        "--robot",
        default="mlivr2",
        help="mlivr2, mlivr3, mlivr4 or a JSON file (default: %(default)s)",
    )
    parser.add_argument(
        "--map", metavar="FILE", help="map as a JSON file (default: the measured JEM)"
    )
    parser.add_argument(
        "--no-manipulability", action="store_true", help="do without both thresholds"
    )
    parser.add_argument(
        "--no-transitions", action="store_true", help="do not check that steps can be executed"
    )
    parser.add_argument(
        "--no-collisions", action="store_true", help="let limbs touch each other and the cabin"
    )
    parser.add_argument(
        "--clearance",
        type=float,
        default=0.02,
        metavar="M",
        help="least distance between shapes [m] (default: %(default)s)",
    )
    parser.add_argument(
        "--limb-threshold",
        type=float,
        default=0.1,
        metavar="W",
        help="least w_m (default: %(default)s)",
    )
    parser.add_argument(
        "--base-threshold", type=float, metavar="W", help="least w_b (default: 0.001 (2/N)^3)"
    )
    return parser


def output_arguments() -> argparse.ArgumentParser:
    """The arguments of what is printed, for `parents`."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument(
        "--json",
        action="store_true",
        help="print the result as one JSON object in place of text, also where the command fails",
    )
    parser.add_argument(
        "-q", "--quiet", action="store_true", help="print neither text nor progress"
    )
    return parser


def obstacle_arguments() -> argparse.ArgumentParser:
    """The arguments of obstacles and occupied points, for `parents`."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument(
        "--obstacles", metavar="FILE", help="boxes and occupied points as a JSON file"
    )
    parser.add_argument(
        "--box",
        nargs=6,
        type=float,
        action="append",
        default=[],
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="a box or keep-out zone, lower and upper corner [m]; may be repeated",
    )
    parser.add_argument(
        "--occupied", nargs="+", default=[], metavar="POINT", help="points that may not be grasped"
    )
    return parser


def query_arguments() -> argparse.ArgumentParser:
    """The arguments of start, goal and search, for `parents`."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--start", nargs="+", metavar="POINT", help="point id of each limb")
    parser.add_argument(
        "--start-pose",
        nargs=7,
        type=float,
        metavar=("X", "Y", "Z", "QW", "QX", "QY", "QZ"),
        help="base pose at the start, if the robot stands in another than that of its stance [m] "
        "(default: that one)",
    )
    parser.add_argument(
        "--start-joints",
        nargs="+",
        type=float,
        metavar="Q",
        help="joint angles at the start, six for each limb [rad] "
        "(default: any that hold the points)",
    )
    parser.add_argument(
        "--goal", nargs=3, type=float, metavar=("X", "Y", "Z"), help="goal position of the base [m]"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=0.2,
        metavar="M",
        help="radius of the goal [m] (default: %(default)s)",
    )
    parser.add_argument(
        "--goal-face", metavar="FACE", help="all limbs are to hold points of this face at the goal"
    )
    _search_arguments(parser)
    return parser


def _search_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of cost and search."""
    parser.add_argument(
        "--cost",
        default="base",
        help="base, steps, weighted, or time: fastest of several plans (default: %(default)s)",
    )
    parser.add_argument(
        "--regrasp-price",
        type=float,
        metavar="M",
        help="metres charged for a regrasp, with weighted",
    )
    parser.add_argument(
        "--method",
        default="astar",
        help="astar, dijkstra, greedy or algorithm1 (default: %(default)s)",
    )
    parser.add_argument("--heuristic", help="cost_to_go, consistent, paper or zero")
    parser.add_argument(
        "--inflation",
        type=float,
        metavar="E",
        help="the plan costs at most E times the least (default: 1 for two limbs; with more the "
        "first plan found is taken, and within what factor it is proved is told)",
    )
    parser.add_argument(
        "--time-limit",
        type=float,
        metavar="S",
        help="more than two limbs: look for a plan and improve it for S seconds at most",
    )
    parser.add_argument(
        "--limit", type=int, default=200_000, help="most states explored (default: %(default)s)"
    )


def chosen_map(args: argparse.Namespace) -> GraspMap:
    """The map of `--map`, by default the measured JEM."""
    return GraspMap.load(args.map) if args.map else jem_map()


def chosen_graph(args: argparse.Namespace) -> PairGraph | LazyGraph:
    """The stance graph of the arguments, with the obstacles of commands that take some."""
    _check_world(args)
    settings = Settings(
        manipulability=not args.no_manipulability,
        transitions=not args.no_transitions,
        limb_threshold=args.limb_threshold,
        base_threshold=args.base_threshold,
        collisions=not args.no_collisions,
        clearance=args.clearance,
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

    Args:
        args: All arguments.
        chosen: The argument that decides.
        taken: Arguments that have a meaning beside it.

    Raises:
        SettingError: naming one that would have no effect.
    """
    parsers = (world_arguments(), obstacle_arguments(), query_arguments())
    decided = {name for parser in parsers for name in vars(parser.parse_args([]))} - {*taken}
    refuse_without_effect(
        args, f"beside --{chosen}, which decides it", *(name for name in decided if name in args)
    )


def refuse_without_effect(args: argparse.Namespace, why: str, *names: str) -> None:
    """Refuse arguments that have no effect where they are given, for a reason.

    Raises:
        SettingError: naming the first of them.
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
        ("seed", 0, LARGEST_SEED),
        ("episodes", 1, MOST_EPISODES),
        ("beam", 1, WIDEST_BEAM),
        ("threads", 1, MOST_THREADS),
    ):
        value = getattr(args, name, None)
        if value is not None:
            Whole(least, most).read(value, Place(f"--{name}", SettingError))


def environment_arguments(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `MlivrEnv` from the command line, without defaults."""
    _check_world(args)
    given: dict[str, Any] = {
        "robot": args.robot if args.robot != "mlivr2" else None,
        "map": args.map,
        "manipulability": False if args.no_manipulability else None,
        "transitions": False if args.no_transitions else None,
        "collisions": False if args.no_collisions else None,
        "clearance": args.clearance if args.clearance != 0.02 else None,
        "base_threshold": args.base_threshold,
        "limb_threshold": args.limb_threshold if args.limb_threshold != 0.1 else None,
        "reward": getattr(args, "reward", None),
        "grasp_failure": getattr(args, "grasp_failure", 0.0) or None,
        "shaping": getattr(args, "shaping", False) or None,
    }
    return {name: value for name, value in given.items() if value is not None}
