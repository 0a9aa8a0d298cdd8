"""Options that several commands share, and the maps, graphs and queries that they describe."""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np

from mlivr_gym.arguments import Reader
from mlivr_gym.cli.progress import Progress
from mlivr_gym.cli.robots import OF_ROBOT, cargo_of, chosen_robot, failed_joint_of, is_described
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import NoPlanError, SettingError, StanceError
from mlivr_gym.motion.plan_parts import COSTS
from mlivr_gym.paper import default_setup
from mlivr_gym.planners import SearchOptions
from mlivr_gym.planners.costs import HEURISTICS
from mlivr_gym.planners.query import EXPANSIONS, MAX_EXPANSIONS, METHODS
from mlivr_gym.robot.specification import ROBOTS
from mlivr_gym.schema import Choice, FieldPath, Integer, Numbers, Validator
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box, load_obstacles
from mlivr_gym.world.grasp_map import PLACES, GraspMap, as_map
from mlivr_gym.world.map_entries import UNIT_OF_LENGTH

SEED = Integer(0, 2**31)
"""Valid seeds: each episode takes the next one, and NumPy's old generator accepts 32 bits."""

EPISODES = Integer(1, 10**6)
"""Valid numbers of episodes of one command."""

THREADS = Integer(1, 1024)
"""Valid numbers of threads of PyTorch, and of processes of a study."""

LIMIT = Integer(1, MAX_EXPANSIONS)
"""Valid numbers of states that a search may expand."""

BOXES: dict[str, Any] = {"type": float, "action": "append"}
"""Arguments of `add_argument` for an option of numbers that may be repeated, such as `--box`."""

DRAWS = 12
"""Number of tasks that are drawn, of which the one with start and goal farthest apart is taken."""

CAPSULES = "draw the collision shapes of the limbs in place of their visual meshes"
"""Help of the option `--capsules`."""


class CheckedOption(argparse.Action):
    """An option with a validator, which checks and converts its value as the line is parsed."""

    def __init__(self, *, valid: Validator[Any], **more: Any) -> None:
        """Check by the validator `valid`; the other arguments are those of argparse."""
        super().__init__(**more)
        self.valid = valid

    def __call__(
        self, parser: object, namespace: argparse.Namespace, values: Any, option: object = None
    ) -> None:
        """Store the value; raise a `SettingError` that names the option if it is not valid.

        A value of an option that may be repeated, whose default is a list, is added to the others.
        """
        read = self.valid.read(values, FieldPath(self.option_strings[0], SettingError))
        more = isinstance(self.default, list)
        setattr(namespace, self.dest, [*getattr(namespace, self.dest), read] if more else read)


def option(
    parser: argparse._ActionsContainer,
    usage: str,
    text: str,
    default: Any = None,
    valid: Validator[Any] | None = None,
    **more: Any,
) -> None:
    """Add an option that is written as it appears in the usage line to a parser or a group of it.

    `"--json"` is a switch, `"--size W H"` takes two values, `"--start POINT..."` one or more. The
    default is added to the help text, the names of a `Choice` to the usage. `valid` checks the
    value that is given, and determines its type if the default does not. `more` are further
    arguments of `add_argument`.
    """
    names = [word for word in usage.split() if word.startswith("-")]
    values = usage.split()[len(names) :]
    if not values:
        parser.add_argument(*names, action="store_true", help=text, **more)
        return
    first = default[0] if isinstance(default, tuple) else default
    if isinstance(first, int | float):
        more["type"] = type(first)
    elif isinstance(valid, Integer | Numbers):
        more["type"] = int if isinstance(valid, Integer) else float
    if valid is not None:
        more |= {"action": CheckedOption, "valid": valid}
    if isinstance(valid, Choice):
        more["metavar"] = f"{{{','.join(valid.options)}}}"
    else:
        more["metavar"] = tuple(values) if len(values) > 1 else values[0].removesuffix("...")
    if len(values) > 1 or values[0].endswith("..."):
        more["nargs"] = len(values) if len(values) > 1 else "+"
    if default is not None and default != []:
        shown = " ".join(map(str, default)) if isinstance(default, tuple) else default
        text += f" (default: {shown})"
    parser.add_argument(*names, default=default, help=text, **more)


def world_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of robot, map and settings."""
    text = f"{', '.join(ROBOTS)}, or the path of a JSON, URDF or MJCF file"
    option(parser, "--robot ROBOT", text, "mlivr2")
    text = "joint of a seven-joint arm of a URDF or MJCF file that does not move, or one a limb"
    option(parser, "--locked-joint JOINT...", f"{text}: none for six joints (default: the third)")
    text = "angle of the locked joint, or one for each limb [rad] (default: 0)"
    option(parser, "--locked-angle RAD...", text)
    text = "link or site of a URDF or MJCF file at which limbs grasp, or one for each limb"
    option(parser, "--tool-frame LINK...", text)
    option(parser, "--package-dir DIR...", "folders with the packages that a URDF file names")
    text = "do not compare neighbouring links of a limb that touch in every posture"
    option(parser, "--allow-touching", text)
    text = "joint of a seven-joint limb that is locked: limb from 0, joint from 1, angle [rad]; "
    option(
        parser, "--failed-joint LIMB JOINT RAD", f"{text}may be given for several limbs", [],
        Reader(failed_joint_of), type=float,
    )  # fmt: skip
    text = "cargo on the body, opposite the points: mass [kg] and edges along x, y and z [m]"
    option(parser, "--cargo KG X Y Z", text, valid=Reader(cargo_of), type=float)
    text = f"{', '.join(PLACES)}, or the path of a JSON or CSV file (default: the measured JEM)"
    option(parser, "--map MAP", text)
    text = "unit of the lengths in the file of --map that does not name one (default: m)"
    option(parser, "--unit UNIT", text, valid=UNIT_OF_LENGTH)
    option(parser, "--no-manipulability", "ignore both thresholds of manipulability")
    option(parser, "--no-transitions", "do not check that steps are executable")
    option(parser, "--no-collisions", "do not check collisions")
    option(parser, "--clearance M", "minimum distance between collision shapes [m]", 0.02)
    option(parser, "--limb-threshold W", "minimum limb manipulability w_m of a stance", 0.1)
    text = "minimum base manipulability w_b of a stance (default: 0.001 (2/N)^3 for N limbs)"
    option(parser, "--base-threshold W", text, type=float)


def obstacle_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of obstacles and occupied points."""
    option(parser, "--obstacles FILE", "boxes and occupied points as a JSON file")
    text = "box that the robot must not touch, by its lower and upper corner [m]; may be repeated"
    option(parser, "--box X0 Y0 Z0 X1 Y1 Z1", text, [], **BOXES)
    option(parser, "--occupied POINT...", "ids of points that no limb may grasp", [])


def query_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of start, goal and search."""
    option(parser, "--start POINT...", "ids of the points held at the start, one for each limb")
    option(
        parser,
        "--start-pose X Y Z QW QX QY QZ",
        "base pose at the start: position [m] and quaternion (default: the posture of the stance)",
        type=float,
    )
    text = "joint angles at the start, six for each limb [rad] (default: any that hold the points)"
    option(parser, "--start-joints Q...", text, type=float)
    option(parser, "--goal X Y Z", "goal position of the base [m]", type=float)
    option(parser, "--tolerance M", "radius of the goal region [m]", 0.2)
    option(parser, "--goal-face FACE", "face whose points all limbs must hold at the goal")
    option(parser, "--cost COST", "cost to minimise", "base", Choice(COSTS))
    text = "cost of each regrasp, added to the base displacement [m]; needs --cost weighted"
    option(parser, "--regrasp-price M", text, type=float)
    option(parser, "--method METHOD", "search method", "astar", Choice(METHODS))
    text = "estimate of the cost to the goal (default: relaxed for two limbs, else consistent)"
    option(parser, "--heuristic HEURISTIC", text, valid=Choice(HEURISTICS))
    option(
        parser,
        "--inflation E",
        "suboptimality bound: accept a plan that is proved to cost at most E times the minimum "
        "(default: 1 for two limbs; for more any plan, and the proved bound is printed)",
        type=float,
    )
    text = "search for a plan, and improve it, for at most S seconds"
    option(parser, "--time-limit S", text, type=float)
    option(parser, "--limit LIMIT", "maximum number of states expanded", EXPANSIONS, LIMIT)


def walk_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of start, cost and pace of walks in MuJoCo."""
    option(parser, "--start POINT...", "ids of the points held at the start, one for each limb")
    option(parser, "--cost COST", "cost of the plans", "steps", Choice(("steps", "base")))
    text = "how fast the robot moves: fast, gentle, careful, or station for the arms of a station"
    option(parser, "--pace PACE", text, "fast", Choice(("fast", "gentle", "careful", "station")))


def controller_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of the controller to a command that simulates."""
    text = (
        "full: feedforward, and a sensor guides the approach; feedforward: the paper's PD control "
        "with feedforward; paper: the paper's PD control; delayed: full, for a delay of 10 ms; "
        "station: full, for a station's arms"
    )
    controllers = Choice(("full", "feedforward", "paper", "delayed", "station"))
    option(parser, "--controller CONTROLLER", text, "full", controllers)


def search_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of `Planner.plan` other than start, goal and cost."""
    names = "goal_face", "start_pose", "start_joints", "time_limit"
    options = SearchOptions(
        method=args.method, heuristic=args.heuristic, inflation=args.inflation, limit=args.limit
    )
    given = {name: getattr(args, name) for name in names}
    return {"goal_tolerance": args.tolerance, "options": options} | given


def chosen_map(args: argparse.Namespace) -> GraspMap:
    """Return the map of `--map` and `--unit`, by default the measured JEM."""
    if args.unit is None:
        return as_map(args.map)
    if args.map in (None, *PLACES):
        raise SettingError(f"--unit {args.unit} needs the file of a map, given with --map")
    return GraspMap.load(args.map, unit=args.unit)


def chosen_graph(args: argparse.Namespace) -> StanceGraph:
    """Build the stance graph of the arguments, with the obstacles if the command has any."""
    with Progress("building the stance graph", quiet=args.quiet):
        graph = stance_graph(chosen_map(args), chosen_robot(args), chosen_settings(args))
        if "box" in args:
            boxes, occupied = chosen_obstacles(args)
            graph.add_obstacles(boxes)
            graph.occupy(occupied)
    if graph.settings.collisions and not (graph.grasp_map.boxes or graph.obstacles):
        print(f"map {graph.grasp_map.name!r} has no boxes: nothing is known to collide with")
    return graph


def chosen_settings(args: argparse.Namespace) -> Settings:
    """Return the settings of the arguments."""
    _check_world(args)
    return Settings(
        limb_threshold=args.limb_threshold,
        base_threshold=args.base_threshold,
        clearance=args.clearance,
        **_switched_off(args),
    )


def chosen_obstacles(args: argparse.Namespace) -> tuple[list[Box], list[str]]:
    """Return the boxes and the occupied points of the arguments."""
    boxes, occupied = numbered_boxes("box", args.box), list(args.occupied)
    if args.obstacles:
        more, points = load_obstacles(args.obstacles)
        boxes.extend(more)
        occupied.extend(points)
    return boxes, occupied


def numbered_boxes(name: str, corners: list[list[float]]) -> list[Box]:
    """Return boxes by their lower and upper corners [m], with numbered names."""
    return [Box.between(f"{name}{k}", "obstacle", v[:3], v[3:]) for k, v in enumerate(corners)]


def chosen_task(
    graph: StanceGraph, args: argparse.Namespace
) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Return the start as point ids, and the goal position [m].

    What is not given is that of Table I for the default robot on the JEM; otherwise it is drawn
    with a fixed seed, since another robot may not be able to hold that start: of `DRAWS` tasks the
    one with start and goal farthest apart. Raises a `NoPlanError` if the start cannot be held.
    """
    start, goal = args.start, args.goal
    if start is None or goal is None:
        setup = default_setup()
        if args.map is None and args.robot == args.default("robot"):
            start, goal = start or setup["start"], goal or setup["goal"]
        else:
            if start is not None:
                graph.indices(start)  # an unknown point is invalid input, not a missing plan
            try:
                pose = (getattr(args, "start_pose", None), getattr(args, "start_joints", None))
                given = graph.state(start, *pose) if start is not None else None
                rng = np.random.default_rng(0)
                drawn = [sample_task(graph, rng, args.tolerance, given) for _ in range(DRAWS)]
                starts = [graph.posture_of(task.start).base_position[0] for task in drawn]
                ends = [goal or task.goal.tolist() for task in drawn]
                state, target = drawn[int(np.argmax(list(map(math.dist, starts, ends))))]
            except StanceError as error:
                raise NoPlanError(str(error)) from None
            start, goal = start or graph.ids(state.stance), goal or target.tolist()
    return tuple(start), tuple(float(v) for v in goal)


def refuse_ignored(args: argparse.Namespace, chosen: str, taken: tuple[str, ...]) -> None:
    """Refuse options of world, obstacles and query that another option already determines.

    `chosen` is the name of that option, `taken` are those that keep their effect. Raises a
    `SettingError` if an option without effect was given.
    """
    parser = argparse.ArgumentParser()
    for add_options in (world_options, obstacle_options, query_options):
        add_options(parser)
    fixed = vars(parser.parse_args([])).keys() - {*taken}
    why = f"with --{chosen}, which determines it"
    refuse_without_effect(args, why, *(name for name in fixed if name in args))


def refuse_without_effect(args: argparse.Namespace, why: str, *names: str) -> None:
    """Refuse options that have no effect on this command line, for a reason.

    Raises a `SettingError` if one of the options was given; the message names the first.
    """
    for name in sorted(names):
        if getattr(args, name) != args.default(name):
            raise SettingError(f"--{name.replace('_', '-')} has no effect {why}; leave it out")


def _check_world(args: argparse.Namespace) -> None:
    """Refuse thresholds or a clearance whose check is switched off."""
    if args.no_manipulability:
        refuse_without_effect(args, "with --no-manipulability", "limb_threshold", "base_threshold")
    if args.no_collisions:
        refuse_without_effect(args, "with --no-collisions", "clearance")


def environment_arguments(args: argparse.Namespace) -> dict[str, Any]:
    """Return those arguments of `MlivrEnv` that differ from their defaults."""
    _check_world(args)
    names = (
        "robot", "map", "clearance", "base_threshold", "limb_threshold", "reward", "grasp_failure",
        "shaping", "cargo",
    )  # fmt: skip
    given = {name: getattr(args, name) for name in names if name in args}
    changed = {name: value for name, value in given.items() if value != args.default(name)}
    if args.unit is not None:
        changed["map"] = chosen_map(args).to_dict()
    told = any(getattr(args, name) != args.default(name) for name in OF_ROBOT if name in args)
    if told or is_described(args):
        changed["robot"] = chosen_robot(args).to_dict()
        changed.pop("cargo", None)
    return changed | _switched_off(args)


def _switched_off(args: argparse.Namespace) -> dict[str, bool]:
    """Return the checks of the stance graph that are switched off, as settings."""
    names = ("manipulability", "transitions", "collisions")
    return {name: False for name in names if getattr(args, f"no_{name}")}
