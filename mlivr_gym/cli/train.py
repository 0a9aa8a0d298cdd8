"""The command `mlivr-gym train`."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

from mlivr_gym.cli.arguments import check_counts, environment_arguments, world_arguments
from mlivr_gym.cli.exits import LONG_GRACE, SUCCESS
from mlivr_gym.cli.extras import need
from mlivr_gym.cli.outputs import claim
from mlivr_gym.cli.progress import timed_bar
from mlivr_gym.files import FileError


def add_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser's."""
    parser = commands.add_parser(
        "train",
        parents=[world_arguments()],
        help="train a policy",
        description="Train a policy for two limbs. Every step of the map is checked first, once: "
        "one to two minutes for the JEM. Ctrl-C ends it early and leaves a checkpoint of what was "
        "learned so far.",
    )
    parser.add_argument(
        "--method", default="dagger", help="bc, dagger, ppo or finetune (default: %(default)s)"
    )
    parser.add_argument(
        "--network", default="pointer", help="pointer or mlp (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed (default: %(default)s)")
    parser.add_argument("--reward", default="steps", help="steps or base (default: %(default)s)")
    parser.add_argument(
        "--grasp-failure",
        type=float,
        default=0.0,
        metavar="P",
        help="mean probability that a grasp fails",
    )
    parser.add_argument(
        "--shaping", action="store_true", help="add potential-based shaping to the reward, for ppo"
    )
    parser.add_argument(
        "--hyperparameters",
        metavar="FILE",
        help="JSON file (default: training.json of the package)",
    )
    parser.add_argument(
        "--out",
        default="policy",
        metavar="PATH",
        help="checkpoint without suffix (default: %(default)s)",
    )
    parser.add_argument(
        "--init",
        metavar="PATH",
        help="checkpoint to start from, without suffix; finetune needs one",
    )
    parser.add_argument("--logs", metavar="FOLDER", help="write TensorBoard logs")
    parser.set_defaults(run=run, grace=LONG_GRACE)


def run(args: argparse.Namespace) -> int:
    """Train a policy and write its checkpoint."""
    check_counts(args)
    need("torch", "stable_baselines3", "sb3_contrib", extra="agents")
    from mlivr_gym.agents.hyperparameters import hyperparameters
    from mlivr_gym.agents.training import train

    out = Path(args.out)
    if not out.name:
        raise FileError(f"cannot write a checkpoint to {args.out!r}: it is a folder")
    claim(out.with_suffix(".pt"), out.with_suffix(".json"))
    settings = hyperparameters(args.method, args.hyperparameters)
    bars: dict[str, Callable[[int, int, str], None]] = {}

    def progress(phase: str, done: int, total: int, figures: dict[str, float]) -> None:
        shown = {
            name: figures[name]
            for name in ("loss", "walks_that_arrive", "mean_return")
            if name in figures
        }
        remark = ", ".join(f"{name} {value:.3g}" for name, value in shown.items())
        bars.setdefault(phase, timed_bar(phase))(done, total, remark)

    print("checking every step of the map, or reading what an earlier run kept ...", flush=True)
    policy = train(
        args.method,
        args.network,
        args.seed,
        env_arguments=environment_arguments(args),
        settings=settings,
        init=args.init,
        out=args.out,
        command=shlex.join(["mlivr-gym", *sys.argv[1:]]),
        progress=progress,
        logs=args.logs,
    )
    print(f"{out.with_suffix('.pt')} and .json: trained in {policy.config['seconds']:.0f} s")
    return SUCCESS
