"""The command `mlivr-gym evaluate`."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from mlivr_gym.agents.evaluation import Evaluation, evaluate
from mlivr_gym.agents.policy_names import PLANNERS, policy_by_name
from mlivr_gym.agents.test_set import SPLITS, load_test_set
from mlivr_gym.cli.arguments import (
    EPISODES,
    SEED,
    environment_arguments,
    option,
    refuse_without_effect,
    world_options,
)
from mlivr_gym.cli.progress import Progress
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.schema import Choice, Integer


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    world_options(parser)
    text = f"pretrained, the path of a checkpoint without suffix, or {', '.join(PLANNERS)}"
    option(parser, "--policy POLICY", text, "pretrained")
    option(parser, "--episodes N", "number of episodes", 20, EPISODES)
    option(parser, "--seed N", "seed of the first episode", 0, SEED)
    option(parser, "--grasp-failure P", "mean probability that a grasp fails", 0.0)
    text = "width of a beam search guided by the pointer policy (default: no beam search)"
    option(parser, "--beam W", text, valid=Integer(1, 1000))
    text = "split of the test set, in place of seeded episodes"
    option(parser, "--split SPLIT", text, valid=Choice(SPLITS))


def run(args: argparse.Namespace) -> None:
    """Evaluate a policy or a planner: success, steps and base translation.

    They are those of seeded episodes, or of the tasks of the frozen test set (--split).
    """
    if args.split is not None:
        refuse_without_effect(args, "with --split, which determines it", "episodes", "map")
    if args.policy in PLANNERS:
        refuse_without_effect(args, f"with --policy {args.policy}", "beam")
    arguments = environment_arguments(args)
    results = []
    for world, episodes in _worlds(args):
        with Progress("building the environment", quiet=args.quiet):
            env = MlivrEnv(**(arguments | world))
            policy = policy_by_name(args.policy, env, args.seed, args.beam)
        total = episodes if isinstance(episodes, int) else len(episodes)
        with Progress(args.policy, total, args.quiet) as progress:
            results.append(evaluate(env, policy, episodes, args.seed, progress=progress.show))
    means = summary_of(results)
    args.result |= {"policy": args.policy} | means
    print(f"{args.policy}: {means['successes']} of {means['episodes']} episodes reach the goal")
    if means["successes"]:
        print(
            f"  means over these: {means['mean_steps']:.2f} steps, "
            f"{means['mean_base_translation']:.3f} m of base translation"
        )
    first = 1e3 * means["mean_first_action_time"]
    print(f"  first action after {first:.1f} ms on average, environment and policy together")


def _worlds(args: argparse.Namespace) -> list[tuple[dict[str, Any], Any]]:
    """Return the environment arguments of each world, and its number of episodes or its tasks."""
    if args.split is None:
        return [({}, args.episodes)]
    return [({"map": w.map()}, w.tasks) for w in load_test_set() if w.split == args.split]


def summary_of(results: list[Evaluation]) -> dict[str, Any]:
    """Return the means over the episodes of all worlds that `--json` prints.

    Steps and base translation [m] are means over the episodes that reach the goal, None if none
    does; the time of the first action [s] is a mean over all episodes.
    """
    success = np.concatenate([result.success for result in results])
    steps = np.concatenate([result.steps for result in results])[success]
    metres = np.concatenate([result.base_translation for result in results])[success]
    first = np.concatenate([result.first_decision for result in results])
    return {
        "episodes": len(success),
        "successes": int(success.sum()),
        "mean_steps": float(steps.mean()) if len(steps) else None,
        "mean_base_translation": float(metres.mean()) if len(metres) else None,
        "mean_first_action_time": float(first.mean()),
    }
