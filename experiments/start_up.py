"""Measure what the first use of an installation compiles and how long it takes, for each path.

    python experiments/start_up.py [--newest PYTHON] [--out results]

A path is a command or a short program. The package is installed into a fresh environment of the
Python that runs this, with the versions in `constraints.txt`, and into one of the newest Python
that is found, with the newest versions. There each path runs twice in new processes: with an empty
cache, so that all it needs is compiled, and again; those with late entries once more in a cache
that `mlivr-gym warmup` has filled. Counted are the compiled functions; measured are wall-clock and
processor time and the peak memory of a process, and the load of the machine is reported. A unit is
the time in which the kernel of one search is compiled. Writes `start_up.json` and `start_up.md` in
a quarter of an hour for each Python.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

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
    "warmup": "mlivr-gym warmup",
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

ON_OLDEST = (
    "help", "plan", "base cost", "obstacles", "simulate", "environment", "vector environment",
    "three limbs", "four limbs",
)  # fmt: skip
"""Paths that are measured with the oldest Python; the others are for tests."""

ON_NEWEST = ("plan", "simulate", "environment", "three limbs")
"""Paths that are measured with the newest Python, too."""

WITH_LATE_ENTRIES = ("plan", "base cost", "simulate")
"""Paths that are measured after `warmup`, too, which is there for them."""

WITHOUT_NUMBA = ("help",)
"""Paths that compile nothing; counting compilations would import Numba."""

COUNTER = """
import atexit, json, os, time
from numba.core import event
compiled = event.RecordingListener()
event.register("numba:compile", compiled)
def write_count():
    began, unit = {}, 0.0
    for at, one in compiled.buffer:
        name = one.data["dispatcher"].py_func.__qualname__
        if one.is_start:
            began[name] = at
        elif one.data["dispatcher"].py_func.__module__ == "mlivr_gym.planners.label_search":
            unit = at - began[name] if name == "_search" else unit
    try:
        import resource
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    except ImportError:
        memory = 0.0
    with open(os.environ["COUNTED"], "a") as file:
        file.write(json.dumps([len(compiled.buffer) // 2, unit, memory]) + "\\n")
atexit.register(write_count)
"""
"""Code that each process runs at its start; at its end it writes how many functions it compiled,
how long the search took of these [s], and its peak memory [MB]."""


def run(
    path: str, cache: Path, python: str = "", root: Path | None = ROOT, **variables: str
) -> dict[str, float]:
    """Run a path of `PATHS`; return the number of compiled functions, times [s] and memory [MB].

    `cache` is the folder of machine code and tables; `python` another Python, in whose environment
    the package is installed, or lies in `root`; `variables` are further environment variables. A
    path that fails raises `RuntimeError`.
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
        here["PYTHONPATH"] = os.pathsep.join([folder, *([str(root)] if root else [])])
        unset = ("NUMBA_", "PYTHONDONTWRITEBYTECODE")
        environment = {k: v for k, v in os.environ.items() if not k.startswith(unset)}
        began, before = time.perf_counter(), os.times()
        done = subprocess.run(
            [python or sys.executable, *command], cwd=work, env=environment | here | variables,
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        spent, after = time.perf_counter() - began, os.times()
        if done.returncode:
            raise RuntimeError(f"{path}: {done.stderr[-2000:]}")
        lines = counted.read_text(encoding="utf-8").splitlines()
        functions, units, memory = zip(*map(json.loads, lines), strict=True) if lines else [[0]] * 3
    used = after.children_user + after.children_system
    return {
        "functions": sum(functions),
        "unit": round(max(units), 2),
        "wall": round(spent, 2),
        "processor": round(used - before.children_user - before.children_system, 2),
        "memory": round(max(memory)),
    }


VERSIONS = """
import json, platform
from importlib.metadata import version
print(json.dumps({"Python": platform.python_version()} | {
    name: version(name.lower()) for name in ("Numba", "NumPy", "SciPy", "MuJoCo", "Gymnasium")}))
"""


def installed(python: str, folder: Path, constraints: Path | None) -> str:
    """Install the package into a new environment in a folder; return its Python."""
    subprocess.run([python, "-m", "venv", str(folder)], check=True)
    made = str(folder / ("Scripts" if os.name == "nt" else "bin") / "python")
    limits = ["--constraint", str(constraints)] if constraints else []
    command = [made, "-m", "pip", "install", "--quiet", *limits, str(ROOT)]
    subprocess.run(command, check=True)
    return made


def measured(python: str, paths: Sequence[str]) -> dict[str, Any]:
    """Measure paths with the package installed for a Python, with an empty cache and again."""
    found, loads = dict[str, Any](), list[float]()
    versions = subprocess.run([python, "-c", VERSIONS], capture_output=True, text=True, check=True)
    for path in paths:
        with tempfile.TemporaryDirectory() as cache:
            first, again = (run(path, Path(cache), python, root=None) for _ in range(2))
        found[path] = {"first": first, "again": again}
        loads.append(os.getloadavg()[0])
        print(path, found[path], flush=True)
    with tempfile.TemporaryDirectory() as cache:
        run("warmup", Path(cache), python, root=None)
        for path in WITH_LATE_ENTRIES:
            if path in found:
                run(path, Path(cache), python, root=None)
                found[path]["warmed"] = run(path, Path(cache), python, root=None)
    unit = max(one["first"]["unit"] for one in found.values())
    return {
        "versions": json.loads(versions.stdout),
        "load": max(loads) - 1.0,
        "unit": unit,
        "paths": found,
    }


def _times(found: dict[str, float] | None) -> str:
    """Return wall-clock and processor time of a run [s]."""
    return f"{found['wall']:.1f}, {found['processor']:.1f}" if found else NOTHING


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    parts, commands = [], []
    for one in data["pythons"]:
        rows = []
        for path, found in one["paths"].items():
            first, again = found["first"], found["again"]
            times = [_times(one) for one in (first, again, found.get("warmed"))]
            units = f"{first['wall'] / one['unit']:.1f}"
            memory = max(first["memory"], again["memory"]) or NOTHING
            rows.append([path, first["functions"], times[0], units, *times[1:], memory])
        versions = ", ".join(f"{name} {number}" for name, number in one["versions"].items())
        head = "path | functions | first [s] | units | again [s] | warmed [s] | memory [MB]"
        parts.append(
            f"## Python {one['versions']['Python']}\n\n{versions}; a unit is {one['unit']:.1f} s; "
            f"other programs ran at a load of {max(one['load'], 0.0):.1f}.\n\n{table(head, rows)}"
        )
    for path in ON_OLDEST:
        if PATHS[path].startswith("mlivr-gym"):
            commands.append(f"* {path}: `{PATHS[path]}`\n")
    return f"""# First use of an installation

Made by `experiments/start_up.py` on {data["cores"]} cores: `pip install .` into a fresh
environment, with the versions of `constraints.txt` for the oldest Python and the newest versions
for the newest one. Number of functions that are compiled with an empty cache, wall-clock and
processor time then, the former also in units of the time that one search kernel takes to compile,
both times once more, both after `mlivr-gym warmup`, and the peak memory of a process.

{chr(10).join(parts)}
The commands are:

{"".join(commands)}"""


def all_measured(newest: str) -> dict[str, Any]:
    """Measure all paths with this Python, and some with the newest one."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    found = []
    with tempfile.TemporaryDirectory() as folder:
        oldest = installed(sys.executable, Path(folder, "oldest"), ROOT / "constraints.txt")
        found.append(measured(oldest, ON_OLDEST))
        if newest:
            python = installed(newest, Path(folder, "newest"), None)
            found.append(measured(python, ON_NEWEST))
    return {"cores": cores, "pythons": found}


def newest_python() -> str:
    """Return the newest Python that is found, `""` if none is newer than this one."""
    command = [sys.executable, str(ROOT / ".ci" / "newest.py")]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    experiment("start_up", __doc__, all_measured, markdown, newest=newest_python())
