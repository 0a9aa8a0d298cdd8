"""Measure what the first use of an installation compiles and how long it takes, for each path.

    python experiments/start_up.py [--out results]

A path is a command or a short program. Each path runs in new processes twice: with empty caches and
the ready-made machine code, and again with everything cached. The paths of `COMPILED_TOO` also run
with empty caches and without the ready-made code, which takes a minute each. Counted are the
compiled functions; measured are wall-clock and processor time, and the load of the machine is
reported. Bytecode of the package exists, as after `pip install`. Writes `start_up.json` and
`start_up.md` in some minutes.
"""

from __future__ import annotations

import compileall
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numba
from reports import NOTHING, ROOT, experiment, table

from mlivr_gym.compiled.cache import CACHE_VARIABLE

QUERY = "--start D2a:4 D2b:4 --goal 6.0 0 0.42 --cost steps"
POSE = "2.03 -0.046 -0.324 0.5964 0.0785 0.1043 0.7920"

GRAPH = """
from mlivr_gym import stance_graph
from mlivr_gym.planners import Planner
planner = Planner(stance_graph())
"""

ENVIRONMENT = """
import gymnasium, mlivr_gym
env = gymnasium.make("{id}"{options})
_, info = env.reset(seed=1)
for k in range({steps}):
    legal = info["action_mask"].nonzero()[0]
    _, _, ended, cut, info = env.step(int(legal[k % len(legal)]))
    if ended or cut:
        _, info = env.reset()
"""

VECTOR = """
import gymnasium, mlivr_gym
env = gymnasium.make_vec("MLIVR-JEM-v0", num_envs=4)
_, info = env.reset(seed=1)
for _ in range(25):
    _, _, _, _, info = env.step(info["action_mask"].argmax(axis=1))
"""

TABLE = """
from mlivr_gym import jem_map, stance_graph
from mlivr_gym.stances.node_table_build import build
few = jem_map().subset(abs(jem_map().positions[:, 0] - 2.3) < 0.45)
for robot in ("mlivr3", "mlivr4"):
    build(stance_graph(few.subset([k % 2 == 0 for k in range(len(few))]), robot))
"""
"""A program that computes the nodes and edges of three and four limbs on a few points."""

PATHS = {
    "help": "mlivr-gym --help",
    "plan": f"mlivr-gym plan {QUERY}",
    "base cost": "mlivr-gym plan",
    "another heuristic": "mlivr-gym plan --heuristic consistent",
    "obstacles": "mlivr-gym plan --box 3.2 -1.0 -1.0 3.5 1.0 0.3 --occupied D3a:3 D3a:4",
    "other thresholds": "mlivr-gym plan --limb-threshold 0.12",
    "own start pose": f"mlivr-gym plan --start D1b:4 D2a:3 --start-pose {POSE}",
    "refined": "mlivr-gym plan --refined",
    "simulate": "mlivr-gym simulate --case 3 --no-film",
    "Table I": "mlivr-gym table1",
    "picture": "mlivr-gym render --start D2a:4 D2b:4 --out start.png",
    "exact cost-to-go": GRAPH + 'planner.cost_to_go((6.0, 0.0, 0.42), "steps")',
    "environment": ENVIRONMENT.format(id="MLIVR-JEM-v0", options="", steps=100),
    "environment, other thresholds": ENVIRONMENT.format(
        id="MLIVR-JEM-v0", options=", limb_threshold=0.12", steps=10
    ),
    "vector environment": VECTOR,
    "three limbs": "mlivr-gym plan --robot mlivr3",
    "four limbs": "mlivr-gym plan --robot mlivr4",
    "three limbs, improved": "mlivr-gym plan --robot mlivr3 --time-limit 3",
    "three limbs, obstacles": "mlivr-gym plan --robot mlivr3 --box 3.2 -1.0 -1.0 3.5 1.0 0.3",
    "table of three and four limbs": TABLE,
    "environment, three limbs": ENVIRONMENT.format(id="MLIVR3-JEM-v0", options="", steps=10),
}
"""Commands and programs by name."""

COMPILED_TOO = ("plan",)
"""Paths that are also measured without ready-made code."""

WITHOUT_NUMBA = ("help",)
"""Paths that compile nothing; counting compilations would import Numba."""

COUNTER = """
import atexit, os
from numba.core import event
compiled = event.RecordingListener()
event.register("numba:compile", compiled)
def write_count():
    with open(os.environ["COUNTED"], "a") as file:
        file.write(f"{len(compiled.buffer) // 2}\\n")
atexit.register(write_count)
"""
"""Code that each process runs at its start; at its end it writes how many functions it compiled."""


def run(path: str, cache: Path, **variables: str) -> dict[str, float]:
    """Run a path of `PATHS`; return the number of compiled functions and its times [s].

    `cache` is the folder of machine code and tables; `variables` are further environment variables.
    A path that fails raises `RuntimeError`.
    """
    given = PATHS[path]
    words = given.removeprefix("mlivr-gym").split()
    command = ["-m", "mlivr_gym", *words] if given.startswith("mlivr-gym") else ["-c", given]
    with tempfile.TemporaryDirectory() as folder:
        counted, work = Path(folder, "counted"), Path(folder, "work")
        work.mkdir()
        counted.touch()
        if path not in WITHOUT_NUMBA:
            Path(folder, "sitecustomize.py").write_text(COUNTER, encoding="utf-8")
        here = {CACHE_VARIABLE: str(cache), "COUNTED": str(counted)}
        here["PYTHONPATH"] = os.pathsep.join([folder, str(ROOT)])
        unset = ("NUMBA_", "PYTHONDONTWRITEBYTECODE")
        environment = {k: v for k, v in os.environ.items() if not k.startswith(unset)}
        began, before = time.perf_counter(), os.times()
        done = subprocess.run(
            [sys.executable, *command], cwd=work, env=environment | here | variables,
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        spent, after = time.perf_counter() - began, os.times()
        if done.returncode:
            raise RuntimeError(f"{path}: {done.stderr[-2000:]}")
        functions = sum(map(int, counted.read_text(encoding="utf-8").split()))
    used = after.children_user + after.children_system
    return {
        "functions": functions,
        "wall": round(spent, 2),
        "processor": round(used - before.children_user - before.children_system, 2),
    }


def measured(path: str) -> dict[str, dict[str, float]]:
    """Measure a path with ready-made code, again with caches, and some with nothing ready.

    With a processor named in `NUMBA_CPU_NAME`, ready-made code of another one is not used; the
    features of the processor remain those of the machine.
    """
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        found = {"ready-made": run(path, Path(first)), "again": run(path, Path(first))}
        if path in COMPILED_TOO:
            found["compiled"] = run(path, Path(second), NUMBA_CPU_NAME="generic")
    return found


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    rows, commands = [], []
    for path, found in data["paths"].items():
        times = {how: f"{one['wall']:.1f}, {one['processor']:.1f}" for how, one in found.items()}
        ready, compiled = found["ready-made"]["functions"], found.get("compiled", {})
        cells = [path, ready, times["ready-made"], times["again"]]
        rows.append([*cells, compiled.get("functions", NOTHING), times.get("compiled", NOTHING)])
        if PATHS[path].startswith("mlivr-gym"):
            commands.append(f"* {path}: `{PATHS[path]}`\n")
    return f"""# First use of an installation

Made by `experiments/start_up.py`. Number of functions that are compiled, and wall-clock and
processor time: with empty caches and the ready-made machine code, once more, and, where measured,
with empty caches and everything compiled on the machine.

Measured on {data["machine"]}, while other programs ran at a load of {max(data["load"], 0.0):.1f}.

{table("path | functions | first [s] | again [s] | all compiled | [s]", rows)}
The commands are:

{"".join(commands)}"""


def all_measured() -> dict[str, Any]:
    """Measure all paths, with the load of the machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    python, loads, paths = platform.python_version(), list[float](), {}
    compileall.compile_dir(ROOT / "mlivr_gym", quiet=2)
    for path in PATHS:
        paths[path] = measured(path)
        loads.append(os.getloadavg()[0])
        print(path, paths[path], flush=True)
    return {
        "machine": f"{cores} cores, Python {python}, Numba {numba.__version__}",
        "load": max(loads) - 1.0,
        "paths": paths,
    }


if __name__ == "__main__":
    experiment("start_up", __doc__, all_measured, markdown)
