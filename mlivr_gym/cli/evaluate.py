"""The command `mlivr-gym evaluate`."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sized
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium

from mlivr_gym.cli.arguments import check_counts, environment_arguments, world_arguments
from mlivr_gym.cli.exits import SUCCESS
from mlivr_gym.cli.extras import need
from mlivr_gym.cli.progress import timed_bar
from mlivr_gym.errors import SettingError, choice, shown

if TYPE_CHECKING:  # agents and environment import MuJoCo, which loads a GL library
    from mlivr_gym.agents.evaluation import Evaluation
    from mlivr_gym.agents.policies import Policy
    from mlivr_gym.envs.env import MlivrEnv

PLANNERS = (
    "expert",
    "astar",
    "astar-base",
    "dijkstra",
    "greedy",
    "local",
    "two_level",
    "mcts",
    "random",
)
"""What can be measured besides learned policies."""


def add_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser's."""
    parser = commands.add_parser(
        "evaluate",
        parents=[world_arguments()],
        help="measure a policy or planner",
        description="Success, steps and base translation over seeded episodes, "
        "or over the frozen test set.",
    )
    parser.add_argument(
        "--policy",
        default="pretrained",
        help=f"pretrained, a checkpoint, or {', '.join(PLANNERS)} (default: %(default)s)",
    )
    parser.add_argument("--episodes", type=int, default=20, help="episodes (default: %(default)s)")
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of the first episode (default: %(default)s)"
    )
    parser.add_argument(
        "--grasp-failure",
        type=float,
        default=0.0,
        metavar="P",
        help="mean probability that a grasp fails",
    )
    parser.add_argument(
        "--beam",
        type=int,
        metavar="W",
        help="let the pointer policy guide a beam search of this width",
    )
    parser.add_argument(
        "--split", help="a split of the frozen test set in place of seeded episodes"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure what acts, in every world that is asked for, and print the means."""
    from mlivr_gym.agents.evaluation import evaluate
    from mlivr_gym.envs.env import MlivrEnv

    check_counts(args)
    arguments = environment_arguments(args)
    results = []
    for world, episodes in _worlds(args):
        made = gymnasium.make("MLIVR-JEM-v0", disable_env_checker=True, **(arguments | world))
        env = made.unwrapped
        assert isinstance(env, MlivrEnv)
        progress = _progress(args.policy, episodes)
        policy = make_acting(args.policy, env, args.seed, args.beam)
        results.append(evaluate(env, policy, episodes, args.seed, progress=progress))
    _report(args.policy, results)
    return SUCCESS


def _worlds(args: argparse.Namespace) -> list[tuple[dict[str, Any], Any]]:
    """Arguments of each world's environment besides the given ones, and its episodes or tasks."""
    from mlivr_gym.agents.test_set import SPLITS, load_test_set

    if args.split is None:
        return [({}, args.episodes)]
    choice("split", args.split, SPLITS)
    return [({"map": w.map()}, w.tasks) for w in load_test_set() if w.split == args.split]


def _progress(name: str, episodes: int | Sized) -> Callable[[int], None]:
    """A bar over episodes or tasks, called with the number that is done."""
    show, total = timed_bar(name), episodes if isinstance(episodes, int) else len(episodes)
    return lambda done: show(done, total, "")


def _report(name: str, results: list[Evaluation]) -> None:
    """Print success, steps, base translation and the time of the first action."""
    success = [bool(value) for result in results for value in result.success]
    steps = [int(s) for r in results for s, good in zip(r.steps, r.success, strict=True) if good]
    metres = [
        float(t)
        for r in results
        for t, good in zip(r.base_translation, r.success, strict=True)
        if good
    ]
    first = [float(t) for r in results for t in r.first_decision]
    print(f"{name}: {sum(success)} of {len(success)} episodes reach the goal")
    if steps:
        print(
            f"  where it is reached: {sum(steps) / len(steps):.2f} steps, "
            f"{sum(metres) / len(metres):.3f} m of base translation"
        )
    print(f"  first action after {1e3 * sum(first) / len(first):.1f} ms on average, world included")


def make_acting(name: str, env: MlivrEnv, seed: int = 0, beam: int | None = None) -> Policy:
    """What acts, by the name that `evaluate` takes.

    Args:
        name: One of `PLANNERS`, `"pretrained"`, or the path of a checkpoint without suffix.
        env: The environment it shall act in.
        seed: Seed of what is random.
        beam: Width of the beam search that a learned policy guides, if it shall.
    """
    from mlivr_gym.agents import policies

    if name in ("local", "two_level", "mcts"):
        return policies.baseline_policy(name, seed=seed)
    if name in ("astar", "dijkstra", "greedy"):
        return policies.planner_policy("steps", name)
    if name == "astar-base":
        return policies.planner_policy("base")
    if name == "expert":
        return policies.ExpertPolicy()
    if name == "random":
        return policies.RandomPolicy(seed)
    checkpoint = Path(name).name and os.path.isfile(Path(name).with_suffix(".pt"))
    if name != "pretrained" and not checkpoint:
        raise SettingError(
            f"policy is {shown(name)}; it must be pretrained, a checkpoint, or "
            f"{', '.join(PLANNERS)}"
        )
    need("torch", "stable_baselines3", "sb3_contrib", extra="agents")
    from mlivr_gym.agents.learned import beam_policy, load_policy

    policy = load_policy(name, env)
    return policy if beam is None else beam_policy(policy, beam)
