"""The command `mlivr-gym dataset`."""

from __future__ import annotations

import argparse

from mlivr_gym.agents.dataset import write_dataset
from mlivr_gym.agents.lerobot_dataset import write_lerobot_dataset
from mlivr_gym.cli.arguments import (
    EPISODES,
    SEED,
    environment_arguments,
    option,
    refuse_without_effect,
    world_options,
)
from mlivr_gym.cli.progress import Progress
from mlivr_gym.envs.rewards import REWARDS
from mlivr_gym.extras import require
from mlivr_gym.schema import Choice


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    option(parser, "--id ID", "id of the data set of Minari", "mlivr/jem/expert-v0")
    text = "write this new folder for LeRobot, in its format v3, instead of a data set of Minari"
    option(parser, "--lerobot FOLDER", text)
    option(parser, "--video", "add a video of each episode to --lerobot")
    option(parser, "--episodes N", "number of episodes", 200, EPISODES)
    option(parser, "--seed N", "seed of the first episode", 0, SEED)
    option(parser, "--reward REWARD", "reward of a step", "steps", Choice(tuple(REWARDS)))


def run(args: argparse.Namespace) -> None:
    """Write episodes of the optimal expert with action masks as a data set of Minari or LeRobot.

    Needs the extra 'data', and for videos the extra 'film'.
    """
    if args.lerobot is None:
        require("minari", extra="data")
        refuse_without_effect(args, "without --lerobot", "video")
    else:
        refuse_without_effect(args, "with --lerobot", "id")
    with Progress("episodes", args.episodes, args.quiet) as progress:
        given = args.episodes, args.seed, environment_arguments(args)
        if args.lerobot is None:
            dataset = write_dataset(args.id, *given, progress=progress.show)
            name, steps = args.id, int(dataset.total_steps)
            load = f"mlivr_gym.agents.dataset.load_dataset({args.id!r})"
        else:
            name, load = args.lerobot, f"LeRobotDataset('mlivr/jem', root={args.lerobot!r})"
            steps = write_lerobot_dataset(name, *given, video=args.video, progress=progress.show)
    args.result |= {"id": name, "episodes": args.episodes, "steps": steps}
    print(f"{name}: {args.episodes} episodes, {steps} steps; load it with {load}")
