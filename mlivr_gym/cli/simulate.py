"""The command `mlivr-gym simulate`: execute a plan in MuJoCo; write measurements, plots and a film.

Modules that need MuJoCo are imported when the command runs, since MuJoCo loads a GL library.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from mlivr_gym.cli.arguments import (
    CAPSULES,
    SEED,
    chosen_graph,
    chosen_map,
    controller_option,
    obstacle_options,
    option,
    query_options,
    refuse_ignored,
    refuse_without_effect,
    world_options,
)
from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.films import film_options, make_film
from mlivr_gym.cli.outputs import all_or_none, check_outputs, input_files
from mlivr_gym.cli.plan import find_plan
from mlivr_gym.cli.progress import Progress
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.trajectory_files import save_csv, save_npz, save_ros
from mlivr_gym.paper import CASES, case_graph, default_setup
from mlivr_gym.pictures.films import check_film_format, film
from mlivr_gym.pictures.simulation_figures import simulation_figure
from mlivr_gym.planners import Plan
from mlivr_gym.schema import Choice, Integer, Tuples
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph

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
"""Files that the command writes in addition to the film."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    obstacle_options(parser)
    query_options(parser)
    option(parser, "--plan FILE", "execute the plan of this file instead of planning first")
    text = "use start, goal, map and cost of this case of Table I"
    option(parser, "--case CASE", text, valid=Integer(1, len(CASES)))
    text = (
        "fast: as quick as the default limits allow; gentle, careful: limits with a reserve; "
        "station: limits of a station's arms; paper: 50 s a step"
    )
    paces = Choice(("fast", "gentle", "careful", "station", "paper"))
    option(parser, "--pace PACE", text, "fast", paces)
    text = "duration of every step [s], refused if it breaks a limit (default: the shortest)"
    option(parser, "--duration S", text, type=float)
    option(parser, "--timestep S", "time step of the simulation [s]", 0.002)
    controller_option(parser)
    text = "grasps of a robot of the UR5e's size, or of the size of a station's arms"
    option(parser, "--physics PHYSICS", text, "default", Choice(("default", "station")))
    text = (
        "how robot and module differ from the model of the controller: not at all (none), or in "
        "all ways that are studied (all)"
    )
    option(parser, "--disturbances WHICH", text, "none", Choice(("none", "all")))
    option(parser, "--seed N", "seed of the disturbances", 1, SEED)
    option(parser, "--out FOLDER", "folder of the results", "walk")
    text, rates = "sampling rate of the trajectory files [Hz]", Tuples((), 0.5, 2000.0, "Hz")
    option(parser, "--rate HZ", text, 10.0, rates)
    option(parser, "--film NAME", "file name of the film, .gif or .mp4", "walk.gif")
    option(parser, "--no-film", "make no film")
    option(parser, "--capsules", CAPSULES)
    film_options(parser)


def run(args: argparse.Namespace) -> int:
    """Execute a plan in MuJoCo.

    It is a plan from a file (--plan), of a case of Table I (--case), or planned first with the
    options of `plan`.
    """
    _check_film(args)
    if bool(args.plan) + bool(args.case) + bool(args.start or args.goal) > 1:
        raise SettingError("give only one of --plan, --case, and --start with --goal")
    if args.plan:
        refuse_ignored(args, "plan", ("map",))
    if args.case:
        refuse_ignored(args, "case", ("no_collisions",))
    files = [*FILES, *([] if args.no_film else [args.film])]
    inputs = input_files(args)
    if _keeps_plan_file(args):  # it stays as it is
        files.remove("plan.json")
    check_outputs(*(Path(args.out) / name for name in files), folder=args.out, inputs=inputs)
    if args.plan:
        grasp_map = chosen_map(args)
        plan = Plan.load(args.plan, grasp_map)
        with Progress("building the stance graph", quiet=args.quiet):
            graph = stance_graph(grasp_map, plan.world.robot, plan.world.settings)
        return simulate(args, graph, plan)
    if args.case:
        setup = default_setup()
        args.start, args.goal = tuple(setup["start"]), tuple(setup["goal"])
        args.cost, args.goal_face = CASES[args.case].cost, setup["goal_face"]
        with Progress("building the stance graph", quiet=args.quiet):
            graph = case_graph(args.case, setup, "steps" if args.no_collisions else "collisions")
    else:
        graph = chosen_graph(args)
    return simulate(args, graph, find_plan(graph, args).unwrap())


def simulate(args: argparse.Namespace, graph: StanceGraph, plan: Plan) -> int:
    """Execute a plan, print and save the measurements, and return the exit code."""
    from mlivr_gym.simulation.execution import execute
    from mlivr_gym.simulation.timing import plan_trajectory

    out, setup = Path(args.out), _setup(args)
    world = plan.world
    simulation = setup.simulation(graph.grasp_map, world.robot, world.obstacles, args.seed)
    with Progress("steps executed", len(plan.steps), args.quiet) as progress:
        trajectory = plan_trajectory(graph, plan, setup.timing, 1.0 / args.rate)
        execution = execute(
            graph, plan, setup.timing, progress=progress.show, simulation=simulation
        )
    _report(execution)
    if execution.failure is not None and args.pace == "fast":
        print("a slower execution may succeed: --pace gentle")
    args.result |= execution.summary() | {"folder": out, "files": FILES}
    with all_or_none(args, out):
        if not _keeps_plan_file(args):
            plan.save(out / "plan.json")
        save_csv(trajectory, out / "trajectory.csv")
        save_npz(trajectory, out / "trajectory.npz")
        save_ros(trajectory, out / "trajectory.yaml")
        _save(execution, out)
        if not args.no_film:
            _film(args, graph, execution, out / args.film)
    return SUCCESS if execution.failure is None else FAILED


def _setup(args: argparse.Namespace) -> Setup:
    """Return the setup of the execution: pace, controller, physics and disturbances."""
    from mlivr_gym.motion.time_scaling import Durations
    from mlivr_gym.simulation.parameters import PACES, Physics
    from mlivr_gym.simulation.setup import Setup

    setup = Setup.of(
        controller=args.controller,
        physics=asdict(Physics.of(args.physics)) | {"timestep": args.timestep},
        disturbances=args.disturbances,
    )
    if args.pace == "paper":
        if args.duration is not None:
            raise SettingError(
                "--duration has no effect with --pace paper, which takes 50 s a step; leave it out"
            )
        return replace(setup, timing=Durations())
    return replace(setup, timing=replace(PACES[args.pace], step_duration=args.duration))


def _keeps_plan_file(args: argparse.Namespace) -> bool:
    """Return whether the plan that is executed is the plan file of the folder of the results."""
    return bool(args.plan) and Path(args.plan).resolve() == (Path(args.out) / "plan.json").resolve()


def _check_film(args: argparse.Namespace) -> None:
    """Refuse options of a film that is not made, and an invalid format."""
    if args.no_film:
        refuse_without_effect(args, "with --no-film", "film", "size", "speed", "capsules")
    else:
        check_film_format(args.film)


def _report(execution: Execution) -> None:
    """Print the result of an execution: captures, peaks and the failure if there is one."""
    summary, peaks, failure = execution.summary(), execution.peaks, execution.failure
    print(
        f"{summary['steps_done']} of {summary['steps']} steps executed, "
        f"{execution.simulated_time:.1f} s simulated in {execution.simulation_computing_time:.1f} s"
    )
    for capture in execution.captures:
        print(
            f"  {capture.time:6.1f} s: limb {capture.limb} grasped {capture.point}, "
            f"position error {1e3 * capture.distance:.1f} mm"
        )
    print(
        f"maxima: joint torque {peaks.joint_torque.max():.2f} N m "
        f"(RMS over all joints {peaks.torque_rms:.2f} N m), "
        f"grasp force {peaks.grasp_force.max():.1f} N,\n"
        f"  grasp torque {peaks.grasp_torque.max():.1f} N m, "
        f"base position error {1e3 * peaks.base_error:.1f} mm"
    )
    if failure is not None:
        print(
            f"failed at {failure.time:.2f} s in the {failure.phase} of step {failure.step + 1} "
            f"({failure.kind}): {failure.message}"
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


def _film(args: argparse.Namespace, graph: StanceGraph, execution: Execution, path: Path) -> None:
    """Render the film, or print why it cannot be made."""
    plan = execution.plan
    make = partial(
        film, graph.grasp_map, plan.world.robot, execution.recording, path,
        plan=plan, obstacles=plan.world.obstacles, capsules=args.capsules,
    )  # fmt: skip
    if make_film(args, path, execution.recording, make):
        args.result["files"] += (args.film,)
