"""The command `mlivr-gym simulate`: plan, carry the plan out in MuJoCo, and leave measurements, plots and a film."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from mlivr_gym.errors import RenderError, SettingError
from mlivr_gym.files import FileError

MOST_FRAMES = 5000
"""Most pictures of a film; they are kept until it is written."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what `simulate` takes besides the arguments of `plan`."""
    parser.add_argument(
        "--plan", metavar="FILE", help="a plan to carry out; without it, one is made first"
    )
    parser.add_argument(
        "--case",
        type=int,
        choices=(1, 2, 3, 4),
        help="start, goal, map and cost of a case of Table I",
    )
    parser.add_argument(
        "--duration",
        type=float,
        default=50.0,
        metavar="S",
        help="duration of a step [s]; a robot that is too fast fails (default: %(default)s)",
    )
    parser.add_argument(
        "--timestep",
        type=float,
        default=0.002,
        metavar="S",
        help="time step [s] (default: %(default)s)",
    )
    parser.add_argument(
        "--no-feedforward", action="store_true", help="PD control alone, as in the paper"
    )
    parser.add_argument(
        "--assume-ur5e-masses", action="store_true",
        help="simulate a robot with other limbs with the UR5e's masses, inertias and torque limits",
    )  # fmt: skip
    parser.add_argument(
        "--out", default="walk", metavar="FOLDER", help="where results go (default: %(default)s)"
    )
    parser.add_argument(
        "--film", default="walk.gif", metavar="NAME", help=".gif or .mp4 (default: %(default)s)"
    )
    parser.add_argument("--no-film", action="store_true", help="do without a film")
    parser.add_argument(
        "--size",
        nargs=2,
        type=int,
        default=(640, 320),
        metavar=("W", "H"),
        help="pixels of the film",
    )
    parser.add_argument(
        "--frames", type=int, default=100, help="pictures in the film (default: %(default)s)"
    )


def simulate(args: argparse.Namespace, graph: Any, plan: Any) -> int:
    """Carry `plan` out, print and save what was measured; 0 if it succeeded, 1 if it failed."""
    from mlivr_gym.motion.plan_motion import plan_trajectory
    from mlivr_gym.motion.trajectory import Durations
    from mlivr_gym.pictures.film import check_kind
    from mlivr_gym.pictures.simulation_figure import simulation_figure
    from mlivr_gym.simulation.dynamics import Physics, check_masses
    from mlivr_gym.simulation.execution import execute

    if min(args.size) < 16 or max(args.size) > 1920 or not 2 <= args.frames <= MOST_FRAMES:
        raise SettingError(
            f"--size is {tuple(args.size)}, --frames {args.frames}; 16 to 1920 pixels, 2 to {MOST_FRAMES} frames"
        )
    if not args.no_film:
        check_kind(args.film)
    out, durations = Path(args.out), Durations.of_step(args.duration)
    physics = Physics(
        timestep=args.timestep,
        feedforward=not args.no_feedforward,
        assume_ur5e_masses=args.assume_ur5e_masses,
    )
    check_masses(plan.world.robot, physics)  # before anything is written
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot make folder {args.out!r}: {error.strerror or error}") from None
    plan.save(out / "plan.json")
    plan_trajectory(graph, plan, durations).every(0.1).save_csv(out / "trajectory.csv")
    bar = Bar("steps carried out", len(plan.steps))
    execution = execute(graph, plan, durations, physics, bar.show)
    bar.close()
    summary, peaks = execution.summary(), execution.peaks
    print(
        f"{summary['steps_done']} of {summary['steps']} steps carried out, {execution.simulated_time:.0f} s simulated in "
        f"{execution.simulation_time:.1f} s"
    )
    for capture in execution.captures:
        print(
            f"  {capture.time:6.1f} s: limb {capture.limb} took hold of {capture.point}, "
            f"{1e3 * capture.distance:.1f} mm off"
        )
    print(
        f"peaks: joint torque {peaks.joint_torque.max():.2f} N m, RMS {peaks.torque_rms:.2f} N m, grasp force "
        f"{peaks.grasp_force.max():.1f} N, grasp torque {peaks.grasp_torque.max():.1f} N m, base error "
        f"{1e3 * peaks.base_error:.1f} mm"
    )
    if execution.failure is not None:
        failure = execution.failure
        print(
            f"failed at {failure.time:.2f} s, step {failure.step + 1}, {failure.phase}: {failure.kind}, {failure.message}"
        )
        _hint(graph, execution)
    execution.save(out / "simulation.npz")
    title = f"{plan.world.robot.name}, {len(plan.steps)} steps of {durations.total:g} s"
    simulation_figure(
        execution.recording, execution.captures, execution.failure, out / "simulation.png", title
    )
    print(
        f"measurements: {out / 'simulation.json'}, {out / 'simulation.npz'}; plot: {out / 'simulation.png'}"
    )
    if not args.no_film:
        _film(args, graph, execution, out / args.film)
    return 0 if execution.failure is None else 1


def _hint(graph: Any, execution: Any) -> None:
    """Say with what duration a walk that was too fast would probably succeed."""
    from mlivr_gym.simulation.pace import longer_step

    longer = longer_step(graph, execution)
    if longer is not None:
        print(
            f"hint: slower steps may succeed, try --duration {longer:g} (an estimate: torques and lag "
            f"go with 1 / duration^2; this was {execution.durations.total:g} s)"
        )


def _film(args: argparse.Namespace, graph: Any, execution: Any, path: Path) -> None:
    from mlivr_gym.pictures.film import film

    bar = Bar("pictures rendered", args.frames)
    plan = execution.plan
    try:
        film(
            graph.grasp_map, plan.world.robot, execution.recording, path, tuple(args.size), args.frames,
            obstacles=plan.world.obstacles, progress=bar.show,
        )  # fmt: skip
    except RenderError as error:
        bar.close()
        print(f"no film: {error}")
    else:
        bar.close()
        print(f"film: {path}")


class Bar:
    """A progress bar on a terminal; nothing elsewhere."""

    def __init__(self, what: str, total: int) -> None:
        """Count to `total`."""
        self._what, self._total = what, total
        self.show(0)

    def show(self, done: int) -> None:
        """Show how many are done."""
        if sys.stderr.isatty():
            filled = round(30 * done / self._total)
            bar = "#" * filled + "." * (30 - filled)
            print(
                f"\r\033[K[{bar}] {done}/{self._total} {self._what}",
                end="",
                file=sys.stderr,
                flush=True,
            )

    def close(self) -> None:
        """Clear it."""
        if sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr, flush=True)
