"""Measure environment steps per second, compared with well-known environments in the same run.

    python experiments/benchmark_env.py [--out results] [--seconds 1]

Actions are drawn at random among the possible ones; drawing them is not timed, starting new
episodes is. Each value is the best of ten repetitions of `--seconds` on one core, each with other
episodes, because other work on the machine only slows a repetition down. Only many simulated robots
have all cores. Writes `benchmark_env.json` and `benchmark_env.md`.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from reports import experiment, table

from mlivr_gym import robot_spec

ID = "MLIVR-JEM-v0"
NUMBERS = {2: "two", 3: "three", 4: "four"}
SINGLE: tuple[dict[str, Any], ...] = (
    {},
    {"collisions": False},
    {"clearance": 0.021},
    {"robot": "mlivr3"},
    {"robot": "mlivr4"},
    {"robot": "mlivr4", "collisions": False},
    {"dynamics": "mujoco"},
)
"""Arguments of the environments that are measured singly, the default ones first."""

REPETITIONS = 10
"""Number of repetitions, of which the best counts."""


def single(env: gymnasium.Env[Any, Any], seconds: float, masked: bool, seed: int) -> float:
    """Return the steps per second of a single environment."""
    rng = np.random.default_rng(seed)
    spent, steps = 0.0, 0
    _, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    while spent < seconds:
        if masked:
            legal = np.flatnonzero(info["action_mask"])
            action: Any = int(legal[int(rng.random() * len(legal))])
        else:
            action = env.action_space.sample()
        began = time.perf_counter()
        _, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            _, info = env.reset()
        spent += time.perf_counter() - began
        steps += 1
    return steps / spent


def vector(env: Any, seconds: float, seed: int) -> float:
    """Return the steps per second of all sub-environments of a vector environment."""
    rng = np.random.default_rng(seed)
    spent, steps = 0.0, 0
    _, info = env.reset(seed=seed)
    while spent < seconds:
        mask = info["action_mask"]
        actions = (rng.random(mask.shape, dtype=np.float32) * mask).argmax(axis=1)
        began = time.perf_counter()
        _, _, _, _, info = env.step(actions)
        spent += time.perf_counter() - began
        steps += len(actions)
    return steps / spent


def settings_of(native: bool = False, **arguments: Any) -> str:
    """Return arguments of an environment in words; `native` is the vector environment."""
    limbs = robot_spec(arguments.get("robot", "mlivr2")).limbs
    collisions = arguments.get("collisions", True)
    found = [f"{NUMBERS[limbs]} limbs", "collisions on" if collisions else "collisions off"]
    if "clearance" in arguments:
        found.append(f"`clearance={arguments['clearance']}`, steps checked when met")
    elif native or limbs == 2:
        found.append("table that ships")
    elif collisions:
        found.append("table of nodes")
    else:
        found.append("steps checked when met")
    if "dynamics" in arguments:
        found.append('`dynamics="mujoco"`')
    return ", ".join(found)


def best(what: str, settings: str, run: Callable[[int], float]) -> dict[str, Any]:
    """Return the best and the median of the repetitions, each with its own seed."""
    speeds = [run(seed) for seed in range(REPETITIONS)]
    print(f"{what}, {settings}: {max(speeds):.0f} steps/s", flush=True)
    median = float(np.median(speeds))
    return {"what": what, "settings": settings, "wall": max(speeds), "median": median}


def measured(seconds: float) -> dict[str, Any]:
    """Return the speeds, measured in repetitions of some time [s], and the machine."""
    rows, plain = [], dict[str, Any](disable_env_checker=True)
    for arguments in SINGLE:
        env = gymnasium.make(ID, **plain, **arguments)
        run = partial(single, env, seconds, True)
        rows.append(best(ID, settings_of(**arguments), run))
    for count in (256, 1024):
        copies = gymnasium.make_vec(ID, num_envs=count)
        run = partial(vector, copies, seconds)
        rows.append(
            best(f"{ID}, native vector, {count} sub-environments", settings_of(native=True), run)
        )
    with_simulation = gymnasium.make_vec(ID, num_envs=32, dynamics="mujoco")
    run = partial(vector, with_simulation, seconds)
    what = f"{ID}, 32 processes on {len(os.sched_getaffinity(0))} cores"
    rows.append(best(what, settings_of(dynamics="mujoco"), run))
    with_simulation.close()
    sync = gymnasium.make_vec(ID, num_envs=4, vectorization_mode="sync")
    run = partial(vector, sync, seconds)
    rows.append(best(f"{ID}, SyncVectorEnv, 4 sub-environments", settings_of(), run))
    for name in ("Taxi-v4", "FrozenLake-v1", "Ant-v5"):
        env = gymnasium.make(name, **plain)
        rows.append(best(name, "", partial(single, env, seconds, name == "Taxi-v4")))
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    return {"machine": machine, "seconds": seconds, "rows": rows}


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    rows = [
        (row["what"], row["settings"], f"{row['wall']:,.0f}", f"{row['median']:,.0f}")
        for row in data["rows"]
    ]
    return f"""# Steps per second

Made by `experiments/benchmark_env.py` on {data["machine"]}; one core each if \
none are named, best of {REPETITIONS} \
repetitions of {data["seconds"]:g} s. Actions are drawn at random among the possible ones, in Taxi \
too. Each environment is as `gymnasium.make` returns it, without its checker; the first one has \
all its defaults. Each repetition draws other episodes, so steps that are checked when met, and \
those of many limbs, are mostly new.

{table("environment | settings | steps/s | steps/s, median", rows)}"""


if __name__ == "__main__":
    experiment("benchmark_env", __doc__, measured, markdown, seconds=1.0)
