"""The command `mlivr-gym dataset`."""

from __future__ import annotations

import argparse

from mlivr_gym.cli.arguments import Add, check_counts, command, environment_arguments, option
from mlivr_gym.cli.progress import Progress
from mlivr_gym.extras import need


def add_command(add: Add) -> None:
    """Add the command by `add_parser`, which is told its name and help."""
    parser = command(
        add,
        run,
        groups=("world",),
        description="Episodes of the A* expert with action masks as a Minari data set; "
        "needs minari[create,hdf5].",
    )
    option(parser, "--id ID", "id of the data set", "mlivr/jem/astar-v0")
    option(parser, "--episodes N", "episodes", 200)
    option(parser, "--seed N", "seed of the first episode", 0)
    option(parser, "--reward REWARD", "steps or base", "steps")


def run(args: argparse.Namespace) -> None:
    """Write the data set."""
    check_counts(args)
    need("minari", extra="data")
    from mlivr_gym.agents.dataset import write_dataset

    with Progress("episodes", args.episodes, args.quiet) as progress:
        given = args.id, args.episodes, args.seed, environment_arguments(args)
        dataset = write_dataset(*given, progress=progress.show)
    episodes, steps = int(dataset.total_episodes), int(dataset.total_steps)
    args.result |= {"id": args.id, "episodes": episodes, "steps": steps}
    print(
        f"{args.id}: {episodes} episodes, {steps} steps; "
        f"load with mlivr_gym.agents.dataset.load_dataset({args.id!r})"
    )
