"""The command `mlivr-gym`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from mlivr_gym.cli.agents import add_commands
from mlivr_gym.cli.exits import (
    EXIT_CODES,
    FAILED,
    GRACE,
    INTERRUPTED,
    NO_PLAN,
    REFUSED,
    SUCCESS,
    prompt_interrupts,
    say_interrupted,
)
from mlivr_gym.cli.simulate import add_arguments, simulate
from mlivr_gym.errors import MlivrError, NoPlanError, RenderError, SettingError, StanceError

EXAMPLES = """examples:
  mlivr-gym plan
  mlivr-gym plan --start D2a:4 D2b:4 --goal 6.0 0 0.42 --cost steps --out plan.json --picture plan.png
  mlivr-gym plan --cost weighted --regrasp-price 0.1 --no-manipulability
  mlivr-gym plan --robot mlivr3 --goal 2.5 -0.4 -0.3 --cost weighted --regrasp-price 0.1
  mlivr-gym plan --box 3.2 -1.0 -1.0 3.5 1.0 0.3 --occupied D3a:3 D3a:4
  mlivr-gym table1 --out results
  mlivr-gym info --map my_map.json
  mlivr-gym render --start D2a:4 D2b:4 --out start.png
  mlivr-gym simulate --case 3 --out walk
  mlivr-gym evaluate --policy pretrained
  mlivr-gym train --method dagger --out my_policy
"""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence and exits with 2."""

    def error(self, message: str) -> NoReturn:
        self.exit(REFUSED, f"mlivr-gym: {message}\n")


def _parser() -> argparse.ArgumentParser:
    from mlivr_gym import __version__

    formatter = argparse.RawDescriptionHelpFormatter
    parser = _Parser(
        prog="mlivr-gym", description="Plan hand-over-hand motion through a space station module.",
        epilog=f"{EXAMPLES}\n{EXIT_CODES}", formatter_class=formatter,
    )  # fmt: skip
    parser.set_defaults(grace=GRACE)
    parser.add_argument("--version", action="version", version=f"mlivr-gym {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    world = _Parser(add_help=False)
    world.add_argument(
        "--robot",
        default="mlivr2",
        help="mlivr2, mlivr3, mlivr4 or a JSON file (default: %(default)s)",
    )
    world.add_argument(
        "--map", metavar="FILE", help="map as a JSON file (default: the measured JEM)"
    )
    world.add_argument(
        "--no-manipulability", action="store_true", help="do without both thresholds"
    )
    world.add_argument(
        "--no-transitions", action="store_true", help="do not check that steps can be carried out"
    )
    world.add_argument(
        "--no-collisions", action="store_true", help="let limbs touch each other and the cabin"
    )
    world.add_argument(
        "--clearance",
        type=float,
        default=0.02,
        metavar="M",
        help="least distance between shapes [m] (default: %(default)s)",
    )
    world.add_argument(
        "--limb-threshold",
        type=float,
        default=0.1,
        metavar="W",
        help="least w_m (default: %(default)s)",
    )
    world.add_argument(
        "--base-threshold", type=float, metavar="W", help="least w_b (default: 0.001 (2/N)^3)"
    )

    way = _Parser(add_help=False)
    way.add_argument("--obstacles", metavar="FILE", help="boxes and occupied points as a JSON file")
    way.add_argument(
        "--box", nargs=6, type=float, action="append", default=[],
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="a box or keep-out zone in the way, lower and upper corner [m]; may be repeated",
    )  # fmt: skip
    way.add_argument(
        "--occupied", nargs="+", default=[], metavar="POINT", help="points that may not be grasped"
    )

    query = _Parser(add_help=False)
    query.add_argument("--start", nargs="+", metavar="POINT", help="point id of each limb")
    query.add_argument(
        "--start-pose", nargs=7, type=float, metavar=("X", "Y", "Z", "QW", "QX", "QY", "QZ"),
        help="base pose at the start, if the robot stands in another than the stance's own [m] (default: that one)",
    )  # fmt: skip
    query.add_argument(
        "--start-joints", nargs="+", type=float, metavar="Q",
        help="joint angles at the start, six for each limb [rad] (default: any that hold the points)",
    )  # fmt: skip
    query.add_argument(
        "--goal", nargs=3, type=float, metavar=("X", "Y", "Z"), help="goal position of the base [m]"
    )
    query.add_argument(
        "--cost", default="base", help="base, steps or weighted (default: %(default)s)"
    )
    query.add_argument(
        "--regrasp-price",
        type=float,
        metavar="M",
        help="metres charged for a regrasp, with weighted",
    )
    query.add_argument(
        "--method",
        default="astar",
        help="astar, dijkstra, greedy or algorithm1 (default: %(default)s)",
    )
    query.add_argument("--heuristic", help="cost_to_go, consistent, paper or zero")
    query.add_argument(
        "--inflation",
        type=float,
        metavar="E",
        help="factor on the heuristic: faster, cost at most E times the least (default: 1 for two limbs, 2 for more)",
    )
    query.add_argument(
        "--tolerance",
        type=float,
        default=0.2,
        metavar="M",
        help="radius of the goal [m] (default: %(default)s)",
    )
    query.add_argument(
        "--limit", type=int, default=200_000, help="most states explored (default: %(default)s)"
    )

    plan = commands.add_parser(
        "plan", parents=[world, way, query], help="plan from a stance to a goal", epilog=EXAMPLES,
        formatter_class=formatter,
        description="Plan from a start stance to a goal position of the base. Start and goal have defaults.",
    )  # fmt: skip
    plan.add_argument("--out", metavar="FILE", help="write the plan as JSON")
    plan.add_argument("--picture", metavar="FILE", help="draw the plan as PNG")
    plan.set_defaults(run=_plan)

    simulate = commands.add_parser(
        "simulate", parents=[world, way, query], help="carry a plan out in MuJoCo", epilog=EXAMPLES,
        formatter_class=formatter,
        description="Carry a plan out in MuJoCo: one from a file, or one that is made first as with `plan`.",
    )  # fmt: skip
    add_arguments(simulate)
    simulate.set_defaults(run=_simulate)

    table = commands.add_parser(
        "table1",
        help="the four cases of the paper's Table I",
        description="Plan the four cases, draw and tabulate them.",
    )
    table.add_argument(
        "--out", default="results", metavar="FOLDER", help="where results go (default: %(default)s)"
    )
    table.set_defaults(run=_table1)

    info = commands.add_parser(
        "info",
        parents=[world, way],
        help="what map, robot and stance graph hold",
        epilog=EXAMPLES,
        formatter_class=formatter,
    )
    info.set_defaults(run=_info)

    render = commands.add_parser(
        "render", parents=[world], help="picture of the scene", epilog=EXAMPLES,
        formatter_class=formatter,
        description="Picture of the MuJoCo scene with the robot in a stance. Of a plan, one picture of its start and "
        "its goal side by side, or of the stance chosen with --stance.",
    )  # fmt: skip
    render.add_argument("--start", nargs="+", metavar="POINT", help="point id of each limb")
    render.add_argument(
        "--plan", metavar="FILE", help="a plan; its start and goal stance are drawn"
    )
    render.add_argument(
        "--stance", type=int, metavar="K", help="of the plan, draw the stance after K steps alone"
    )
    render.add_argument(
        "--out", default="scene.png", metavar="FILE", help="PNG file (default: %(default)s)"
    )
    render.add_argument(
        "--size",
        nargs=2,
        type=int,
        default=(1280, 640),
        metavar=("W", "H"),
        help="pixels of each stance's picture",
    )
    render.add_argument("--mjcf", metavar="FILE", help="also export the scene as MJCF")
    render.set_defaults(run=_render)
    add_commands(commands, world)
    return parser


def _graph(args: argparse.Namespace) -> Any:
    from mlivr_gym import GraspMap, Settings, jem_map, robot_spec, stance_graph
    from mlivr_gym.world.boxes import Box, load_obstacles

    settings = Settings(
        manipulability=not args.no_manipulability, transitions=not args.no_transitions,
        limb_threshold=args.limb_threshold, base_threshold=args.base_threshold,
        collisions=not args.no_collisions,
        clearance=args.clearance,
    )  # fmt: skip
    grasp_map = GraspMap.load(args.map) if args.map else jem_map()
    graph = stance_graph(grasp_map, robot_spec(args.robot), settings)
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


def _default_task(graph: Any, args: argparse.Namespace) -> tuple[Any, Any]:
    """Start and goal: as given, else the calibrated ones on the JEM with two limbs, else a seeded draw."""
    import numpy as np

    from mlivr_gym.cli.table1 import default_setup
    from mlivr_gym.envs.tasks import sample_task

    start, goal = args.start, args.goal
    if start is None or goal is None:
        setup = default_setup()
        if graph.limbs == 2 and args.map is None:
            start, goal = start or setup["start"], goal or setup["goal"]
        else:
            if start is not None:
                graph.indices(start)  # what is no stance at all is refused as such
            try:
                stands = (getattr(args, "start_pose", None), getattr(args, "start_joints", None))
                given = graph.state(start, *stands) if start is not None else None
                state, target = sample_task(graph, np.random.default_rng(0), args.tolerance, given)
            except StanceError as error:
                raise NoPlanError(str(error)) from None
            start, goal = start or graph.ids(state.stance), goal or target.tolist()
    return tuple(start), tuple(float(v) for v in goal)


def _query(graph: Any, args: argparse.Namespace) -> tuple[Any, Any]:
    """A plan between start and goal of the arguments, which is described, and what the planner found."""
    from mlivr_gym.planners import Planner

    start, goal = _default_task(graph, args)
    bar = _progress("states explored")
    result = Planner(graph).plan(
        start, goal, args.cost, regrasp_price=args.regrasp_price, method=args.method,
        heuristic=args.heuristic,
        inflation=args.inflation, goal_tolerance=args.tolerance, start_pose=args.start_pose,
        start_joints=args.start_joints, limit=args.limit, progress=bar,
    )  # fmt: skip
    bar(-1)
    plan = result.unwrap()
    print(
        f"from {' '.join(start)} to {goal}: {result.message}, w_m >= {plan.w_m_min:.3f}, w_b >= {plan.w_b_min:.5f}"
    )
    for k, step in enumerate(plan.steps, 1):
        print(
            f"  {k:2d}. limb {step.limb}: {step.from_point:>6} -> {step.to_point:<6} base {step.displacement:.3f} m, {step.path}, "
            f"swing {step.swing}"
        )
    print(
        f"{plan.statistics.expanded} states explored, {plan.statistics.generated} generated, "
        f"{1e3 * (plan.statistics.feasibility_time + plan.statistics.search_time):.1f} ms for the query"
    )
    return plan, result


def _plan(args: argparse.Namespace) -> int:
    from mlivr_gym.pictures.figures import plan_figure

    graph = _graph(args)
    plan, result = _query(graph, args)
    if args.out:
        plan.save(args.out)
        print(f"plan: {args.out}")
    if args.picture:
        plan_figure(
            graph.grasp_map,
            plan,
            args.picture,
            result.tree,
            f"{plan.world.robot.name}, {plan.query.cost_name} cost",
        )
        print(f"picture: {args.picture}")
    return 0


def _progress(what: str) -> Any:
    """A callback that shows a count on a terminal, and clears it when called with -1."""

    def show(count: int) -> None:
        if sys.stderr.isatty():
            print(
                "\r\033[K" if count < 0 else f"\r{count} {what}",
                end="",
                file=sys.stderr,
                flush=True,
            )

    return show


def _simulate(args: argparse.Namespace) -> int:
    from mlivr_gym import GraspMap, jem_map, stance_graph
    from mlivr_gym.planners import Plan

    if bool(args.plan) + bool(args.case) + bool(args.start or args.goal) > 1:
        raise SettingError("give either --plan, or --case, or --start and --goal")
    if args.plan:
        plan = Plan.load(args.plan, GraspMap.load(args.map) if args.map else jem_map())
        graph = stance_graph(
            GraspMap.load(args.map) if args.map else jem_map(),
            plan.world.robot,
            plan.world.settings,
        )
        return simulate(args, graph, plan)
    if args.case:
        from mlivr_gym.cli.table1 import CASES, case_graph, default_setup

        setup = default_setup()
        args.start, args.goal, args.cost = (
            tuple(setup["start"]),
            tuple(setup["goal"]),
            CASES[args.case].cost,
        )
        graph = case_graph(args.case, setup, collisions=not args.no_collisions)
    else:
        graph = _graph(args)
    return simulate(args, graph, _query(graph, args)[0])


def _table1(args: argparse.Namespace) -> int:
    from mlivr_gym import jem_map
    from mlivr_gym.cli.table1 import run_cases

    out = Path(args.out)
    print(
        "planning the four cases of Table I, without and with collisions checked (the first run compiles the kernels) ...",
        flush=True,
    )
    plans, data = run_cases(out, lambda line: print(line, flush=True))
    plan = plans[3]
    ends = {"start": 0, "goal": len(plan.stances) - 1}
    pictures = {out / f"scene_{name}.png": [plan.configuration(k)] for name, k in ends.items()}
    _draw(jem_map(), plan.world.robot, pictures, (1600, 800))
    failed = [name for name, held in data["relations"].items() if not held]
    for name in failed:
        print(f"relation does not hold: {name}")
    return FAILED if failed else SUCCESS


def _draw(
    grasp_map: Any,
    robot: Any,
    pictures: dict[Path, list[Any]],
    size: tuple[int, int],
    obstacles: Sequence[Any] = (),
) -> None:
    """Render configurations with MuJoCo, those of one picture side by side.

    Where there is no GL library they are drawn with matplotlib.
    """
    import numpy as np

    from mlivr_gym.pictures.figures import configuration_figure, save_image
    from mlivr_gym.pictures.rendering import SceneRenderer

    try:
        renderer = SceneRenderer(grasp_map, robot, *size, obstacles)
    except RenderError as error:
        print(f"no GL, drawing with matplotlib instead: {error}", flush=True)
        for path, configurations in pictures.items():
            configuration_figure(grasp_map, robot, configurations, path, path.stem)
    else:
        for path, configurations in pictures.items():
            save_image(np.hstack([renderer.render(*shown) for shown in configurations]), path)
        renderer.close()
    for path in pictures:
        print(f"picture: {path}", flush=True)


def _info(args: argparse.Namespace) -> int:
    from collections import Counter

    import numpy as np

    from mlivr_gym.stances.pair_graph import PairGraph

    graph = _graph(args)
    grasp_map, robot = graph.grasp_map, graph.robot
    faces = Counter(grasp_map.faces)
    low, high = grasp_map.cabin
    print(
        f"map {grasp_map.name} ({grasp_map.fingerprint}): {len(grasp_map)} points on {len(grasp_map.segments)} tracks"
    )
    print("  faces: " + ", ".join(f"{face} {count}" for face, count in faces.items()))
    print(f"  handrails: {len(grasp_map.handrails)}; cabin {low.tolist()} to {high.tolist()} m")
    print(
        f"robot {robot.name} ({robot.fingerprint}): {robot.limbs} limbs, mounts {robot.mount_radius:g} m from the axis, "
        f"span {robot.span:g} m, l_c {robot.characteristic_length:g} m"
    )
    kinds = Counter(box.kind for box in grasp_map.boxes)
    print(
        f"shapes: {len(robot.shapes)} capsules a limb and a body of {robot.body_size:g} m; "
        + (", ".join(f"{kind} {count}" for kind, count in kinds.items()) or "no boxes")
        + (
            f"; clearance {graph.settings.clearance:g} m"
            if graph.settings.collisions
            else "; collisions not checked"
        )
    )
    print(
        f"thresholds: w_m {graph.limb_threshold:g}, w_b {graph.base_threshold:g}, on paths w_m {graph.settings.path_floor:g}"
    )
    print(f"ordered pairs of points within span: {len(graph.pairs)}")
    if isinstance(graph, PairGraph):
        count, part = graph.components
        steps = int((graph.degree**2).sum() - 2 * len(graph))
        out = {
            "reach": graph.considered - graph.reachable,
            **graph.removed,
            "departure": graph.no_departure,
        }
        out["manipulability"] = graph.considered - len(graph) - sum(out.values())
        order = ("reach", "manipulability", "departure", "self", "cabin", "handrail")
        print(
            f"stance graph: {graph.reachable} of {graph.considered} pairs in reach, {len(graph)} stances, "
            f"{graph.solver.geometries} different geometries"
        )
        print("  left out by cause: " + ", ".join(f"{name} {out[name]}" for name in order))
        print(
            f"  departure: a limb cannot leave its point with w_m >= {graph.settings.path_floor:g}, thresholds or not; "
            f"beyond the span of {robot.span:g} m {graph.beyond_span} pairs are not tried"
        )
        if graph.obstacles or graph.occupied:
            left = int((graph.mask > 0).all(axis=1).sum())
            print(
                f"  {len(graph.obstacles)} obstacles and {len(graph.occupied)} occupied points leave {left} stances"
            )
        print(
            f"  {steps} steps before checks, {count} connected parts, the largest of {int(np.bincount(part).max())} stances"
        )
        print(
            f"  w_m {graph.w_m.min():.4f} to {graph.w_m.max():.4f}, w_b {graph.w_b.min():.6f} to {graph.w_b.max():.6f}"
        )
        print(f"  longest base displacement of a step: {graph.max_step:.3f} m")
    else:
        print("stance graph: worked out as it is searched (more than two limbs)")
    return 0


def _render(args: argparse.Namespace) -> int:
    from mlivr_gym import GraspMap, jem_map
    from mlivr_gym.files import write_whole
    from mlivr_gym.planners import Plan

    if args.plan and args.start:
        raise SettingError("give either --plan or --start, not both")
    if args.stance is not None and not args.plan:
        raise SettingError("--stance needs --plan: it chooses among the stances of a plan")
    if min(args.size) < 16 or max(args.size) > 1920:
        raise SettingError(
            f"--size is {tuple(args.size)}; width and height must lie between 16 and 1920"
        )
    if args.plan:
        grasp_map = GraspMap.load(args.map) if args.map else jem_map()
        plan = Plan.load(args.plan, grasp_map)
        robot, obstacles, last = plan.world.robot, plan.world.obstacles, len(plan.stances) - 1
        if args.stance is not None and not 0 <= args.stance <= last:
            raise SettingError(
                f"--stance is {args.stance}; this plan has stances 0 (start) to {last} (goal)"
            )
        drawn = [
            plan.configuration(k) for k in ((0, last) if args.stance is None else (args.stance,))
        ]
    else:
        graph = _graph(args)
        grasp_map, robot, obstacles = graph.grasp_map, graph.robot, graph.obstacles
        args.goal, args.tolerance = (0.0, 0.0, 0.0), 0.2
        state = graph.state(_default_task(graph, args)[0] if args.start is None else args.start)
        drawn = [graph.configuration(state)]
    _draw(grasp_map, robot, {Path(args.out): drawn}, tuple(args.size), obstacles)
    if args.mjcf:
        from mlivr_gym.simulation.scene import compiled, scene_spec

        spec = scene_spec(grasp_map, robot, obstacles)
        compiled(spec)
        write_whole(args.mjcf, spec.to_xml())
        print(f"scene: {args.mjcf}")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    args = _parser().parse_args(arguments)
    try:
        with prompt_interrupts(args.grace):
            code: int = args.run(args)
    except MlivrError as error:
        print(f"mlivr-gym: {error}", file=sys.stderr)
        return NO_PLAN if isinstance(error, NoPlanError) else REFUSED
    except KeyboardInterrupt as stop:
        say_interrupted(str(stop))
        return INTERRUPTED
    except BrokenPipeError:
        return FAILED
    return code


if __name__ == "__main__":
    sys.exit(main())
