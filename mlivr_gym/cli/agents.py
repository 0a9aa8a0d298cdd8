"""The commands `mlivr-gym train`, `evaluate` and `dataset`."""

from __future__ import annotations

import argparse
import importlib.util
import shlex
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mlivr_gym.cli.exits import LONG_GRACE
from mlivr_gym.errors import SettingError, choice
from mlivr_gym.values import whole

LARGEST_SEED = 2**31
"""Largest seed; each episode takes the next, and NumPy's old generator takes 32 bits."""

MOST_EPISODES = 10**6
"""Most episodes of one command."""

WIDEST_BEAM = 1000
"""Most walks that a beam search keeps."""

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
"""What `evaluate` knows besides learned policies."""


def add_commands(commands: Any, world: argparse.ArgumentParser) -> None:
    """Add the commands to the parser's; `world` holds the arguments of map, robot and thresholds."""
    train = commands.add_parser(
        "train", parents=[world], help="train a policy",
        description="Train a policy for two limbs. Every step of the map is checked first, once: one to two minutes "
        "for the JEM. Ctrl-C ends it early and leaves a checkpoint of what was learned so far.",
    )  # fmt: skip
    train.add_argument(
        "--method", default="dagger", help="bc, dagger, ppo or finetune (default: %(default)s)"
    )
    train.add_argument("--network", default="pointer", help="pointer or mlp (default: %(default)s)")
    train.add_argument("--seed", type=int, default=0, help="seed (default: %(default)s)")
    train.add_argument("--reward", default="steps", help="steps or base (default: %(default)s)")
    train.add_argument(
        "--grasp-failure",
        type=float,
        default=0.0,
        metavar="P",
        help="mean probability that a grasp fails",
    )
    train.add_argument(
        "--shaping", action="store_true", help="add potential-based shaping to the reward, for ppo"
    )
    train.add_argument(
        "--hyperparameters",
        metavar="FILE",
        help="JSON file (default: training.json of the package)",
    )
    train.add_argument(
        "--out",
        default="policy",
        metavar="PATH",
        help="checkpoint without suffix (default: %(default)s)",
    )
    train.add_argument(
        "--init",
        metavar="PATH",
        help="checkpoint to start from, without suffix; finetune needs one",
    )
    train.add_argument("--logs", metavar="FOLDER", help="write TensorBoard logs")
    train.set_defaults(run=_train, grace=LONG_GRACE)

    evaluate = commands.add_parser(
        "evaluate", parents=[world], help="measure a policy or planner",
        description="Success, steps and base translation over seeded episodes, or over the frozen test set.",
    )  # fmt: skip
    evaluate.add_argument(
        "--policy",
        default="pretrained",
        help=f"pretrained, a checkpoint, or {', '.join(PLANNERS)} (default: %(default)s)",
    )
    evaluate.add_argument(
        "--episodes", type=int, default=20, help="episodes (default: %(default)s)"
    )
    evaluate.add_argument(
        "--seed", type=int, default=0, help="seed of the first episode (default: %(default)s)"
    )
    evaluate.add_argument(
        "--grasp-failure",
        type=float,
        default=0.0,
        metavar="P",
        help="mean probability that a grasp fails",
    )
    evaluate.add_argument(
        "--beam",
        type=int,
        metavar="W",
        help="let the pointer policy guide a beam search of this width",
    )
    evaluate.add_argument(
        "--split", help="a split of the frozen test set in place of seeded episodes"
    )
    evaluate.set_defaults(run=_evaluate)

    dataset = commands.add_parser(
        "dataset", parents=[world], help="write planner episodes as a Minari data set",
        description="Episodes of the A* expert with action masks as a Minari data set; needs minari[create,hdf5].",
    )  # fmt: skip
    dataset.add_argument(
        "--id", default="mlivr/jem/astar-v0", help="id of the data set (default: %(default)s)"
    )
    dataset.add_argument(
        "--episodes", type=int, default=200, help="episodes (default: %(default)s)"
    )
    dataset.add_argument(
        "--seed", type=int, default=0, help="seed of the first episode (default: %(default)s)"
    )
    dataset.add_argument("--reward", default="steps", help="steps or base (default: %(default)s)")
    dataset.set_defaults(run=_dataset)


def bar(what: str) -> Callable[[int, int, str], None]:
    """A progress bar on a terminal: call it with what is done, all there is, and a remark."""
    began = time.perf_counter()

    def show(done: int, total: int, remark: str = "") -> None:
        if sys.stderr.isatty():
            filled, spent = int(24 * done / max(total, 1)), time.perf_counter() - began
            left = spent * (total - done) / max(done, 1)
            line = f"{what} [{'#' * filled}{'.' * (24 - filled)}] {done}/{total} {spent:.0f}<{left:.0f} s {remark}"
            print(f"\r\033[K{line}", end="\n" if done >= total else "", file=sys.stderr, flush=True)

    return show


def need(*modules: str, extra: str) -> None:
    """Refuse in one sentence where an extra is not installed."""
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise SettingError(
                f"this needs the package {module!r}: pip install 'mlivr-gym[{extra}]'"
            )


def check_counts(args: argparse.Namespace) -> None:
    """Refuse a seed, a number of episodes or a width of a beam that cannot be."""
    for name, least, most in (
        ("seed", 0, LARGEST_SEED),
        ("episodes", 1, MOST_EPISODES),
        ("beam", 1, WIDEST_BEAM),
    ):
        value = getattr(args, name, None)
        if value is not None:
            whole(value, f"--{name}", SettingError, least, most)


def environment_arguments(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `MlivrEnv` from the command line, without defaults."""
    given: dict[str, Any] = {
        "robot": args.robot if args.robot != "mlivr2" else None, "map": args.map,
        "manipulability": False if args.no_manipulability else None,
        "transitions": False if args.no_transitions else None,
        "collisions": False if args.no_collisions else None,
        "clearance": args.clearance if args.clearance != 0.02 else None,
        "base_threshold": args.base_threshold,
        "limb_threshold": args.limb_threshold if args.limb_threshold != 0.1 else None,
        "reward": getattr(args, "reward", None),
        "grasp_failure": getattr(args, "grasp_failure", 0.0) or None,
        "shaping": getattr(args, "shaping", False) or None,
    }  # fmt: skip
    return {name: value for name, value in given.items() if value is not None}


def _train(args: argparse.Namespace) -> int:
    check_counts(args)
    need("torch", "stable_baselines3", "sb3_contrib", extra="agents")
    from mlivr_gym.agents.training import hyperparameters, train

    settings = hyperparameters(args.method, args.hyperparameters)
    bars: dict[str, Callable[[int, int, str], None]] = {}

    def progress(phase: str, done: int, total: int, figures: dict[str, float]) -> None:
        shown = {
            name: figures[name]
            for name in ("loss", "walks_that_arrive", "mean_return")
            if name in figures
        }
        remark = ", ".join(f"{name} {value:.3g}" for name, value in shown.items())
        bars.setdefault(phase, bar(phase))(done, total, remark)

    print("checking every step of the map, or reading what an earlier run kept ...", flush=True)
    command = shlex.join(["mlivr-gym", *sys.argv[1:]])
    policy = train(
        args.method, args.network, args.seed, env_arguments=environment_arguments(args),
        settings=settings, init=args.init, out=args.out,
        command=command, progress=progress, logs=args.logs,
    )  # fmt: skip
    print(
        f"{Path(args.out).with_suffix('.pt')} and .json: trained in {policy.config['seconds']:.0f} s"
    )
    return 0


def _evaluate(args: argparse.Namespace) -> int:
    import gymnasium

    from mlivr_gym.agents.evaluation import Evaluation, evaluate
    from mlivr_gym.agents.test_set import SPLITS, load_test_set
    from mlivr_gym.envs.env import MlivrEnv

    check_counts(args)
    arguments = environment_arguments(args)
    worlds: list[tuple[dict[str, Any], Any]] = [({}, args.episodes)]
    if args.split is not None:
        choice("split", args.split, SPLITS)
        worlds = [({"map": w.map()}, w.tasks) for w in load_test_set() if w.split == args.split]
    results: list[Evaluation] = []
    for own, episodes in worlds:
        env = gymnasium.make(
            "MLIVR-JEM-v0", disable_env_checker=True, **(arguments | own)
        ).unwrapped
        assert isinstance(env, MlivrEnv)
        show, total = bar(args.policy), episodes if isinstance(episodes, int) else len(episodes)
        policy = make_acting(args.policy, env, args.seed, args.beam)
        results.append(
            evaluate(
                env, policy, episodes, args.seed, progress=lambda k, n=total, s=show: s(k, n, "")
            )  # type: ignore[misc]
        )
    success = [bool(value) for result in results for value in result.success]
    steps = [int(s) for r in results for s, good in zip(r.steps, r.success, strict=True) if good]
    metres = [
        float(t)
        for r in results
        for t, good in zip(r.base_translation, r.success, strict=True)
        if good
    ]
    first = [float(t) for r in results for t in r.first_decision]
    print(f"{args.policy}: {sum(success)} of {len(success)} episodes reach the goal")
    if steps:
        print(
            f"  where it is reached: {sum(steps) / len(steps):.2f} steps, {sum(metres) / len(metres):.3f} m of base translation"
        )
    print(f"  first action after {1e3 * sum(first) / len(first):.1f} ms on average, world included")
    return 0


def make_acting(name: str, env: Any, seed: int = 0, beam: int | None = None) -> Any:
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
    if name != "pretrained" and not Path(name).with_suffix(".pt").exists():
        raise SettingError(
            f"policy is {name!r}; it must be pretrained, a checkpoint, or {', '.join(PLANNERS)}"
        )
    need("torch", "stable_baselines3", "sb3_contrib", extra="agents")
    from mlivr_gym.agents.learned import beam_policy, load_policy

    policy = load_policy(name, env)
    return policy if beam is None else beam_policy(policy, beam)


def _dataset(args: argparse.Namespace) -> int:
    check_counts(args)
    need("minari", extra="data")
    from mlivr_gym.agents.dataset import write_dataset

    show = bar("episodes")
    dataset = write_dataset(
        args.id, args.episodes, args.seed, environment_arguments(args),
        progress=lambda k: show(k, args.episodes, "")
    )  # fmt: skip
    print(
        f"{args.id}: {dataset.total_episodes} episodes, {dataset.total_steps} steps; "
        f"load with mlivr_gym.agents.dataset.load_dataset({args.id!r})"
    )
    return 0
