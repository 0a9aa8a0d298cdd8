"""The command `mlivr-gym dataset`."""

from __future__ import annotations

import argparse

from mlivr_gym.agents.dataset import write_dataset
from mlivr_gym.cli.arguments import EPISODES, SEED, environment_arguments, option, world_options
from mlivr_gym.cli.progress import Progress
from mlivr_gym.envs.rewards import REWARDS
from mlivr_gym.extras import require
from mlivr_gym.schema import Choice


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    option(parser, "--id ID", "id of the data set", "mlivr/jem/expert-v0")
    option(parser, "--episodes N", "number of episodes", 200, EPISODES)
    option(parser, "--seed N", "seed of the first episode", 0, SEED)
    option(parser, "--reward REWARD", "reward of a step", "steps", Choice(tuple(REWARDS)))


def run(args: argparse.Namespace) -> None:
    """Write episodes of the optimal expert with action masks as a Minari data set.

    Needs the extra 'data'.
    """
    require("minari", extra="data")
    with Progress("episodes", args.episodes, args.quiet) as progress:
        env_arguments = environment_arguments(args)
        dataset = write_dataset(
            args.id, args.episodes, args.seed, env_arguments, progress=progress.show
        )
    episodes, steps = int(dataset.total_episodes), int(dataset.total_steps)
    args.result |= {"id": args.id, "episodes": episodes, "steps": steps}
    print(
        f"{args.id}: {episodes} episodes, {steps} steps; "
        f"load it with mlivr_gym.agents.dataset.load_dataset({args.id!r})"
    )
