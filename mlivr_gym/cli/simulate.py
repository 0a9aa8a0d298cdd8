"""The command `mlivr-gym simulate`: execute a plan in MuJoCo; leave measurements, plots and a film.

What imports MuJoCo is imported when the command runs, since MuJoCo loads a GL library.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mlivr_gym.cli.arguments import (
    Add,
    chosen_graph,
    chosen_map,
    command,
    option,
    refuse_ignored,
    refuse_without_effect,
)
from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.outputs import check_outputs, make_folder
from mlivr_gym.cli.plan import find_plan
from mlivr_gym.cli.progress import Progress
from mlivr_gym.errors import RenderError, SettingError
from mlivr_gym.motion.trajectory_files import save_csv, save_npz, save_ros
from mlivr_gym.paper import CASES, case_graph, default_setup
from mlivr_gym.pictures.film import (
    DEFAULT_SIZE,
    LONGEST_FILM,
    RATE,
    SPEED,
    check_film_format,
    default_speed,
    film,
    film_samples,
)
from mlivr_gym.pictures.rendering import SIZE
from mlivr_gym.pictures.simulation_figure import simulation_figure
from mlivr_gym.planners import Plan
from mlivr_gym.schema import FieldPath, Maybe, Tuples
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_graph import PairGraph

if TYPE_CHECKING:
    from mlivr_gym.simulation.execution import Execution
    from mlivr_gym.simulation.setup import Setup

FILES = (
    "plan.json",
    "trajectory.csv",
    "trajectory.npz",
    "trajectory.yaml",
    "simulation.npz",
    "simulation.json",
    "simulation.png",
    "simulation.svg",
)
"""What the command writes, besides the film."""

RATES = Tuples((), 0.5, 2000.0, "Hz")
"""Samples a second of a trajectory's files."""

MAX_FRAMES = 5000
"""Most pictures of a film; they are kept until it is written."""


def add_command(add: Add) -> None:
    """Add the command by `add_parser`, which is told its name and help."""
    parser = command(
        add,
        run,
        groups=("world", "obstacles", "query"),
        description="Execute a plan in MuJoCo: one from a file, "
        "or one that is made first as with `plan`.",
    )
    option(parser, "--plan FILE", "a plan to execute; without it, one is made first")
    told = "start, goal, map and cost of a case of Table I"
    option(parser, "--case CASE", told, type=int, choices=(1, 2, 3, 4))
    told = "as fast as the limits allow, as gentler ones do, or the paper's 50 s a step"
    option(parser, "--pace PACE", told, "fast", choices=("fast", "gentle", "paper"))
    told = "duration of every step [s], refused if it breaks a limit; without it, the shortest"
    option(parser, "--duration S", told, type=float)
    option(parser, "--timestep S", "time step [s]", 0.002)
    told = "guided to the points by a sensor, following the trajectory alone, or the paper's PD"
    controllers = ("full", "feedforward", "paper")
    option(parser, "--controller CONTROLLER", f"{told} control", "full", choices=controllers)
    told = "whether robot and module differ from what the controller knows"
    option(parser, "--disturbances WHICH", told, "none", choices=("none", "all"))
    option(parser, "--seed N", "seed of the disturbances", 1)
    option(parser, "--out FOLDER", "where results go", "walk")
    option(parser, "--rate HZ", "samples a second of the trajectory's files", 10.0)
    option(parser, "--film NAME", ".gif or .mp4", "walk.gif")
    option(parser, "--no-film", "do without a film")
    option(parser, "--size W H", "pixels of the film", DEFAULT_SIZE)
    option(
        parser,
        "--speed X",
        "how many times faster than the clock the film runs, at "
        f"{RATE} pictures a second; without it, so that it takes {LONGEST_FILM:g} s at most",
        type=float,
    )


def run(args: argparse.Namespace) -> int:
    """Execute a plan from a file, of a case of Table I, or made first."""
    _check_film(args)
    if bool(args.plan) + bool(args.case) + bool(args.start or args.goal) > 1:
        raise SettingError("give either --plan, or --case, or --start and --goal")
    if args.plan:
        refuse_ignored(args, "plan", ("map",))
    if args.case:
        refuse_ignored(args, "case", ("no_collisions",))
    files = [*FILES, *([] if args.no_film else [args.film])]
    check_outputs(*(Path(args.out) / name for name in files), folder=args.out)
    if args.plan:
        grasp_map = chosen_map(args)
        plan = Plan.load(args.plan, grasp_map)
        return simulate(args, stance_graph(grasp_map, plan.world.robot, plan.world.settings), plan)
    if args.case:
        setup = default_setup()
        args.start, args.goal = tuple(setup["start"]), tuple(setup["goal"])
        args.cost, args.goal_face = CASES[args.case].cost, setup["goal_face"]
        graph: PairGraph | LazyGraph = case_graph(
            args.case, setup, "steps" if args.no_collisions else "collisions"
        )
    else:
        graph = chosen_graph(args)
    return simulate(args, graph, find_plan(graph, args).unwrap())


def simulate(args: argparse.Namespace, graph: PairGraph | LazyGraph, plan: Plan) -> int:
    """Execute a plan, print and save what was measured; 0 if it succeeded, 1 if it failed."""
    from mlivr_gym.simulation.execution import execute
    from mlivr_gym.simulation.timing import plan_trajectory

    out, setup = Path(args.out), _setup(args)
    world = plan.world
    simulation = setup.simulation(graph.grasp_map, world.robot, world.obstacles, args.seed)
    trajectory = plan_trajectory(graph, plan, setup.timing, 1.0 / args.rate)
    with Progress("steps carried out", len(plan.steps), args.quiet) as progress:
        execution = execute(
            graph, plan, setup.timing, progress=progress.show, simulation=simulation
        )
    _report(execution)
    make_folder(out)
    plan.save(out / "plan.json")
    save_csv(trajectory, out / "trajectory.csv")
    save_npz(trajectory, out / "trajectory.npz")
    save_ros(trajectory, out / "trajectory.yaml")
    _save(execution, out)
    args.result |= execution.summary() | {"folder": out, "files": FILES}
    if not args.no_film:
        _film(args, graph, execution, out / args.film)
    return SUCCESS if execution.failure is None else FAILED


def _setup(args: argparse.Namespace) -> Setup:
    """How the plan is carried out."""
    RATES.read(args.rate, FieldPath("--rate", SettingError))
    from mlivr_gym.motion.clocks import Durations
    from mlivr_gym.simulation.limits import PACES
    from mlivr_gym.simulation.setup import Setup

    setup = Setup.of(
        controller=args.controller,
        physics={"timestep": args.timestep},
        disturbances=args.disturbances,
    )
    if args.pace == "paper":
        if args.duration is not None:
            raise SettingError(
                "--duration has no effect beside --pace paper, which is 50 s a step; leave it out"
            )
        return replace(setup, timing=Durations())
    return replace(setup, timing=replace(PACES[args.pace], step_duration=args.duration))


def _check_film(args: argparse.Namespace) -> None:
    """Refuse a film that cannot be rendered or written."""
    SIZE.read(args.size, FieldPath("--size", SettingError))
    Maybe(SPEED).read(args.speed, FieldPath("--speed", SettingError))
    if args.no_film:
        refuse_without_effect(args, "with --no-film", "film", "size", "speed")
    else:
        check_film_format(args.film)


def _report(execution: Execution) -> None:
    """Print how the walk went."""
    summary, peaks, failure = execution.summary(), execution.peaks, execution.failure
    print(
        f"{summary['steps_done']} of {summary['steps']} steps carried out, "
        f"{execution.simulated_time:.1f} s simulated in {execution.simulation_time:.1f} s"
    )
    for capture in execution.captures:
        print(
            f"  {capture.time:6.1f} s: limb {capture.limb} took hold of {capture.point}, "
            f"{1e3 * capture.distance:.1f} mm off"
        )
    print(
        f"peaks: joint torque {peaks.joint_torque.max():.2f} N m, "
        f"RMS {peaks.torque_rms:.2f} N m, grasp force {peaks.grasp_force.max():.1f} N,\n"
        f"  grasp torque {peaks.grasp_torque.max():.1f} N m, "
        f"base error {1e3 * peaks.base_error:.1f} mm"
    )
    if failure is not None:
        print(
            f"failed at {failure.time:.2f} s, step {failure.step + 1}, {failure.phase}: "
            f"{failure.kind}, {failure.message}"
        )


def _save(execution: Execution, out: Path) -> None:
    """Write the measurements and their plot."""
    archive, plot = out / "simulation.npz", out / "simulation.png"
    execution.save(archive)
    plan = execution.plan
    seconds = execution.step_times.mean() if execution.captures else execution.simulated_time
    title = f"{plan.world.robot.name}, {len(plan.steps)} steps, {seconds:.1f} s a step"
    simulation_figure(execution.recording, execution.captures, execution.failure, plot, title)
    print(f"measurements: {archive.with_suffix('.json')}, {archive}")
    print(f"plot: {plot}, {plot.with_suffix('.svg')}")


def _film(
    args: argparse.Namespace, graph: PairGraph | LazyGraph, execution: Execution, path: Path
) -> None:
    """Render a film, or say why there is none."""
    plan, recording = execution.plan, execution.recording
    speed = default_speed(recording) if args.speed is None else args.speed
    frames = len(film_samples(recording, speed))
    if frames > MAX_FRAMES:
        print(f"no film: --speed {speed:g} makes {frames} pictures; {MAX_FRAMES} at most")
        return
    try:
        with Progress("pictures rendered", frames, args.quiet) as progress:
            film(
                graph.grasp_map,
                plan.world.robot,
                recording,
                path,
                plan=plan,
                size=tuple(args.size),
                speed=speed,
                obstacles=plan.world.obstacles,
                progress=progress.show,
            )
    except RenderError as error:
        print(f"no film: {error}")
    else:
        args.result["files"] += (args.film,)
        print(f"film: {path}")
