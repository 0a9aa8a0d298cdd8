"""Steps a second of the environment, beside two well-known ones in the same run.

    python experiments/benchmark_env.py [--out results] [--seconds 1]

writes `benchmark_env.json` and `benchmark_env.md`. Actions are drawn at random among those that are
possible; drawing them is not timed, starting new episodes is. Every figure is the best of ten short
repetitions on one core, each of other episodes, since other work on the machine only slows a
repetition down; wall time and processor time are both given.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np

import mlivr_gym  # noqa: F401  registers the environment
from mlivr_gym.files import write_whole

REPETITIONS = 10
"""Of which the best counts."""


class Clock:
    """Adds up wall and processor time of what runs inside `with`."""

    def __init__(self) -> None:
        """Start at zero."""
        self.wall = self.cpu = 0.0

    def __enter__(self) -> None:
        """Start."""
        self._cpu = time.process_time()  # first: it costs as much as a step
        self._wall = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        """Stop."""
        self.wall += time.perf_counter() - self._wall
        self.cpu += time.process_time() - self._cpu


class Measured(NamedTuple):
    """Steps a second."""

    what: str
    wall: float
    """Of the best repetition."""
    cpu: float
    """The same by processor time."""
    median: float
    """Of the median repetition."""


def single(
    env: gymnasium.Env[Any, Any], seconds: float, masked: bool, seed: int
) -> tuple[int, Clock]:
    """Steps of one environment and the time for them."""
    rng = np.random.default_rng(seed)
    clock, steps = Clock(), 0
    _, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    while clock.wall < seconds:
        if masked:
            legal = np.flatnonzero(info["action_mask"])
            action: Any = int(legal[int(rng.random() * len(legal))])
        else:
            action = env.action_space.sample()
        with clock:
            _, _, terminated, truncated, info = env.step(action)
            if terminated or truncated:
                _, info = env.reset()
        steps += 1
    return steps, clock


def vector(env: Any, seconds: float, seed: int) -> tuple[int, Clock]:
    """Steps of all copies of a vector environment and the time for them."""
    rng = np.random.default_rng(seed)
    clock, steps = Clock(), 0
    _, info = env.reset(seed=seed)
    while clock.wall < seconds:
        mask = info["action_mask"]
        actions = (rng.random(mask.shape, dtype=np.float32) * mask).argmax(axis=1)
        with clock:
            _, _, _, _, info = env.step(actions)
        steps += len(actions)
    return steps, clock


def best(what: str, run: Callable[[int], tuple[int, Clock]]) -> Measured:
    """The best of some repetitions, each with a seed of its own."""
    runs = [run(seed) for seed in range(REPETITIONS)]
    speeds = [n / c.wall for n, c in runs]
    by_processor = max(n / max(c.cpu, 1e-9) for n, c in runs)
    measured = Measured(what, max(speeds), by_processor, float(np.median(speeds)))
    print(f"{what}: {measured.wall:.0f} steps/s ({measured.cpu:.0f} by processor time)", flush=True)
    return measured


def measure(seconds: float) -> list[Measured]:
    """Steps a second of every environment, each repetition as long as is asked for [s]."""
    rows: list[Measured] = []
    plain: dict[str, Any] = {"disable_env_checker": True}
    world = gymnasium.make("MLIVR-JEM-v0", precompute=True, **plain)
    rows.append(
        best("MLIVR-JEM-v0, kinematic, exact tables", partial(single, world, seconds, True))
    )
    for num_envs in (64, 1024):
        copies = gymnasium.make_vec("MLIVR-JEM-v0", num_envs=num_envs)
        what = f"MLIVR-JEM-v0, native vector, {num_envs} copies"
        rows.append(best(what, partial(vector, copies, seconds)))
    sync = gymnasium.make_vec(
        "MLIVR-JEM-v0", num_envs=4, vectorization_mode="sync", precompute=True
    )
    rows.append(best("MLIVR-JEM-v0, SyncVectorEnv, 4 copies", partial(vector, sync, seconds)))
    variants: dict[str, dict[str, Any]] = {
        "MLIVR-JEM-v0, kinematic, steps checked when met": {},
        "MLIVR-JEM-v0, kinematic, steps checked when met, collisions not": {"collisions": False},
        "MLIVR-JEM-v0, four limbs, collisions not checked": {
            "robot": "mlivr4",
            "collisions": False,
        },
        "MLIVR-JEM-v0, four limbs, table of nodes": {"robot": "mlivr4"},
        "MLIVR-JEM-v0, three limbs, table of nodes": {"robot": "mlivr3"},
        "MLIVR-JEM-v0, MuJoCo": {"dynamics": "mujoco"},
    }
    for what, arguments in variants.items():
        env = gymnasium.make("MLIVR-JEM-v0", **plain, **arguments)
        rows.append(best(what, partial(single, env, seconds, True)))
    for name in ("Taxi-v4", "FrozenLake-v1", "Ant-v5"):
        env = gymnasium.make(name, **plain)
        rows.append(best(name, partial(single, env, seconds, name == "Taxi-v4")))
    return rows


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description="Steps a second.")
    parser.add_argument("--out", default="results", help="folder (default: %(default)s)")
    parser.add_argument(
        "--seconds", type=float, default=1.0, help="for each repetition (default: %(default)s)"
    )
    args = parser.parse_args()
    rows = measure(args.seconds)
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    data = {"machine": machine, "rows": [row._asdict() for row in rows]}
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "benchmark_env.json", json.dumps(data, indent=1) + "\n")
    lines = [
        "# Steps a second",
        "",
        f"Made by `experiments/benchmark_env.py` on {machine}; one core each, best of "
        f"{REPETITIONS} repetitions of {args.seconds:g} s. Actions are random possible ones; "
        "Taxi's are masked too. Each environment as `gymnasium.make` returns it, without its "
        "checker. Steps checked when met and those of many limbs are mostly new ones: each "
        "repetition draws other episodes.",
        "",
        "| environment | steps/s | by processor time | steps/s, median |",
        "|---|---|---|---|",
        *(f"| {row.what} | {row.wall:,.0f} | {row.cpu:,.0f} | {row.median:,.0f} |" for row in rows),
        "",
    ]
    write_whole(out / "benchmark_env.md", "\n".join(lines))


if __name__ == "__main__":
    main()
