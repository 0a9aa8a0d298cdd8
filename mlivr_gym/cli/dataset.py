"""The command `mlivr-gym dataset`."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from mlivr_gym.cli.arguments import (
    check_counts,
    environment_arguments,
    output_arguments,
    world_arguments,
)
from mlivr_gym.cli.exits import SUCCESS
from mlivr_gym.cli.extras import need
from mlivr_gym.cli.progress import Progress


def add_command(add: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the command by `add_parser`, which is told its name and help."""
    parser = add(
        parents=[world_arguments(), output_arguments()],
        description="Episodes of the A* expert with action masks as a Minari data set; "
        "needs minari[create,hdf5].",
    )
    parser.add_argument(
        "--id", default="mlivr/jem/astar-v0", help="id of the data set (default: %(default)s)"
    )
    parser.add_argument("--episodes", type=int, default=200, help="episodes (default: %(default)s)")
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of the first episode (default: %(default)s)"
    )
    parser.add_argument("--reward", default="steps", help="steps or base (default: %(default)s)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the data set."""
    check_counts(args)
    need("minari", extra="data")
    from mlivr_gym.agents.dataset import write_dataset

    with Progress("episodes", args.episodes, args.quiet) as progress:
        dataset = write_dataset(
            args.id,
            args.episodes,
            args.seed,
            environment_arguments(args),
            progress=progress.show,
        )
    args.result |= {
        "id": args.id,
        "episodes": int(dataset.total_episodes),
        "steps": int(dataset.total_steps),
    }
    print(
        f"{args.id}: {dataset.total_episodes} episodes, {dataset.total_steps} steps; "
        f"load with mlivr_gym.agents.dataset.load_dataset({args.id!r})"
    )
    return SUCCESS
