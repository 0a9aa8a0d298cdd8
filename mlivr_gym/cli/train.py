"""The command `mlivr-gym train`."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

from mlivr_gym.agents.hyperparameters import METHODS, load_hyperparameters
from mlivr_gym.cli.arguments import (
    SEED,
    THREADS,
    environment_arguments,
    option,
    refuse_without_effect,
    world_options,
)
from mlivr_gym.cli.exits import LONG_GRACE, SUCCESS
from mlivr_gym.cli.outputs import check_outputs, input_files
from mlivr_gym.cli.progress import Progress
from mlivr_gym.envs.rewards import REWARDS
from mlivr_gym.extras import require
from mlivr_gym.files import FileError
from mlivr_gym.schema import Choice


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    text = "behaviour cloning (bc), dagger, ppo, or ppo from a checkpoint (finetune)"
    option(parser, "--method METHOD", text, "dagger", Choice(METHODS))
    option(parser, "--network NETWORK", "network of the policy: pointer or mlp", "pointer")
    option(parser, "--seed N", "seed of the training", 0, SEED)
    option(parser, "--reward REWARD", "reward of a step", "steps", Choice(tuple(REWARDS)))
    option(parser, "--grasp-failure P", "mean probability that a grasp fails", 0.0)
    option(parser, "--shaping", "add potential-based shaping to the reward, for ppo and finetune")
    option(parser, "--hyperparameters FILE", "JSON file (default: training.json of the package)")
    option(parser, "--out PATH", "path of the checkpoint without suffix", "policy")
    text = "checkpoint to start from, without suffix; required by finetune"
    option(parser, "--init PATH", text)
    text = "threads of PyTorch; the networks are small, so more threads are slower"
    option(parser, "--threads N", text, 1, THREADS)
    option(parser, "--logs FOLDER", "write TensorBoard logs to this folder")
    parser.set_defaults(grace=LONG_GRACE)


def run(args: argparse.Namespace) -> int:
    """Train a policy for two limbs.

    All steps of the map are checked once before, unless their table ships or is cached. Ctrl-C ends
    the training early and writes a checkpoint of the policy so far.
    """
    require("torch", "stable_baselines3", "sb3_contrib", extra="agents")
    import torch

    from mlivr_gym.agents.training import train

    out = Path(args.out)
    if not out.name:
        raise FileError(
            f"cannot write a checkpoint to {args.out!r}: it is a folder; add the name of a file"
        )
    check_outputs(*(out.with_suffix(end) for end in (".pt", ".json")), inputs=input_files(args))
    hyperparameters = load_hyperparameters(args.method, args.hyperparameters)
    if "ppo" not in hyperparameters:
        refuse_without_effect(
            args, f"with --method {args.method}, which uses no shaping", "shaping"
        )
    torch.set_num_threads(args.threads)
    with Progress("checking all steps of the map", quiet=args.quiet) as progress:
        policy = train(
            args.method,
            args.network,
            args.seed,
            env_arguments=environment_arguments(args),
            hyperparameters=hyperparameters,
            init=args.init,
            out=args.out,
            command=shlex.join(["mlivr-gym", *sys.argv[1:]]),
            progress=_progress_callback(progress),
            logs=args.logs,
        )
    args.result |= policy.config | {"files": [out.with_suffix(end) for end in (".pt", ".json")]}
    print(
        f"trained in {policy.config['seconds']:.0f} s; checkpoint: {out.with_suffix('.pt')}, .json"
    )
    return SUCCESS


def _progress_callback(progress: Progress) -> Callable[[str, int, int, dict[str, float]], None]:
    """Return a function that displays a phase of the training, its progress and its figures."""

    def show(phase: str, done: int, total: int, figures: dict[str, float]) -> None:
        if progress.what != phase:
            progress.begin(phase, total)
        shown = [
            f"{name} {figures[name]:.3g}"
            for name in ("loss", "rollout_success", "mean_return")
            if name in figures
        ]
        progress.show(done, ", ".join(shown))

    return show
