"""The hot code before and after a change: sizes, compile times and speed, beside another checkout.

    python experiments/hot_code.py ../before

Old and new are measured in turns, each in a process of its own, and the best of several is taken.
Writes `results/hot_code.json` and `results/hot_code.md`.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "results"
ROUNDS = 3

SPEED = r"""
import json, time
began = time.perf_counter()
import numpy as np, gymnasium
from mlivr_gym import Settings, stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.planners import Planner
start, goal, out = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), {}
first = stance_graph()
planner = Planner(first)
planner.plan(start, goal, "steps").unwrap()
out["first plan of a new process [s]"] = time.perf_counter() - began
def best(run, times):
    spent = []
    for _ in range(times):
        began = time.perf_counter()
        run()
        spent.append(time.perf_counter() - began)
    return min(spent)
out["stance set [s]"] = best(stance_graph, 3)
out["known goal [ms]"] = 1e3 * best(lambda: planner.plan(start, goal, "steps"), 40)
rng = np.random.default_rng(5)
graph = stance_graph()
tasks = [sample_task(graph, rng, 0.2) for _ in range(60)]
spent = []
for state, goal in tasks:
    began = time.perf_counter()
    Planner(graph).plan(state.stance, goal, "base")
    spent.append(time.perf_counter() - began)
out["new goal, base cost, median [ms]"] = 1e3 * float(np.median(spent))
out["new goal, base cost, 95th percentile [ms]"] = 1e3 * float(np.percentile(spent, 95))
for collisions, name in ((False, "without"), (True, "with")):
    graph = stance_graph(robot="mlivr4", settings=Settings(collisions=collisions))
    states = [random_state(graph, np.random.default_rng(k)) for k in range(4)]
    graph.successors(states[0])
    def neighbours():
        graph._released.clear()
        for state in states[1:]:
            graph.successors(state)
    out[f"neighbours of a four-limb stance, {name} collisions [ms]"] = 1e3 * best(neighbours, 4) / 3
for precompute in (True,):
    env = gymnasium.make(
        "MLIVR-JEM-v0", collisions=False, precompute=precompute, disable_env_checker=True
    ).unwrapped
    def episode():
        env.reset(seed=3)
        draw, mask = np.random.default_rng(1), env.action_masks()
        for _ in range(400):
            legal = np.flatnonzero(mask)
            _, _, ended, _, info = env.step(int(legal[draw.integers(len(legal))]))
            mask = info["action_mask"]
            if ended:
                env.reset(seed=int(draw.integers(1000)))
                mask = env.action_masks()
    episode()
    out["environment, 400 steps [ms]"] = 1e3 * best(episode, 5)
vector = gymnasium.make_vec("MLIVR-JEM-v0", num_envs=1024, collisions=False)
_, info = vector.reset(seed=1)
actions = info["action_mask"].argmax(axis=1)
vector.step(actions)
out["vector of 1,024, one step [ms]"] = 1e3 * best(lambda: vector.step(actions), 30)
print(json.dumps(out))
"""

FIRST = r"""
import json, os, time
began = time.perf_counter()
from mlivr_gym import stance_graph
from mlivr_gym.planners import Planner
Planner(stance_graph()).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps").unwrap()
spent = os.times()
print(json.dumps([time.perf_counter() - began, sum(spent[:4])]))
"""


def run(code: str, tree: Path, cache: str | None = None) -> Any:
    """What a piece of Python prints as JSON with the package of a checkout."""
    given = {"PYTHONPATH": str(tree)} | ({"MLIVR_GYM_CACHE": cache} if cache else {})
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", code], env=os.environ | given, cwd=folder,
            capture_output=True, text=True, check=True,
        )  # fmt: skip
    return json.loads(done.stdout.strip().splitlines()[-1])


def sizes(tree: Path) -> dict[str, float]:
    """Kernels of a checkout: how many, how long, and with how many parameters."""
    counts, lines, positions = [], 0, 0
    for folder in ("mlivr_gym", "planners", "agents"):
        for path in sorted((tree / folder).rglob("*.py")):
            if any(part.is_symlink() for part in path.parents):
                continue
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.FunctionDef) and _is_kernel(node):
                    counts.append(len(node.args.args))
                    text = ast.get_docstring(node, clean=False) or ""
                    lines += node.end_lineno - node.lineno + 1 - len(text.splitlines())
                    positions += _positions(ast.unparse(node))
    return {
        "kernels": len(counts),
        "lines of kernels, docstrings aside": lines,
        "most parameters": max(counts),
        "parameters on average": round(statistics.mean(counts), 2),
        "tuples taken apart by position": positions,
    }


def _is_kernel(node: ast.FunctionDef) -> bool:
    names = {mark.id for mark in node.decorator_list if isinstance(mark, ast.Name)}
    return bool(names & {"kernel", "allocating_kernel", "part", "entry"})


def _positions(text: str) -> int:
    """Look-ups by position in the nested tuples of arrays, and names unpacked from them."""
    handed = r"(edges|shapes|world|collision_model|checker|room|poses|arm|path|head|boxes)"
    looked = len(re.findall(rf"\b{handed}\[\d+\]", text))
    return looked + sum(
        names.count(",") + 1
        for names in re.findall(rf"^\s*\(?([\w, ]+,[\w, ]+)\)? = {handed}(?:\[.*\])?$", text, re.M)
        if isinstance(names, str)
    )


def main() -> None:
    """Measure both and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path, help="checkout to compare with")
    before = parser.parse_args().before.resolve()
    trees = {"before": before, "after": ROOT}
    out: dict[str, Any] = {name: {"sizes": sizes(tree)} for name, tree in trees.items()}
    for name, tree in trees.items():
        with tempfile.TemporaryDirectory() as cache:
            out[name]["first"] = run(FIRST, tree, cache)
        print(name, out[name], flush=True)
    rounds: dict[str, list[dict[str, float]]] = {name: [] for name in trees}
    for _ in range(ROUNDS):
        for name, tree in trees.items():
            rounds[name].append(run(SPEED, tree))
            print(name, rounds[name][-1], flush=True)
    for name, found in rounds.items():
        out[name]["speed"] = {key: min(one[key] for one in found) for key in found[0]}
    RESULTS.joinpath("hot_code.json").write_text(json.dumps(out, indent=1) + "\n", encoding="utf-8")
    RESULTS.joinpath("hot_code.md").write_text(report(out), encoding="utf-8")


def report(out: dict[str, Any]) -> str:
    """The table."""
    rows = ["| | before | after | after / before |", "|---|---|---|---|"]
    old, new = out["before"], out["after"]
    for key, value in new["sizes"].items():
        rows.append(f"| {key} | {old['sizes'][key]:g} | {value:g} | |")
    for k, name in enumerate(("waiting", "processor time")):
        rows.append(
            _row(f"first plan of an installation, {name} [s]", old["first"], new["first"], k)
        )
    for key in new["speed"]:
        rows.append(_row(key, old["speed"], new["speed"], key))
    text = (
        "# Hot code\n\nMade by `experiments/hot_code.py` beside the commit before the records, in "
        f"turns,\nthe best of {ROUNDS} processes each.\n\n"
    )
    return text + "\n".join(rows) + "\n"


def _row(name: str, old: Any, new: Any, key: Any) -> str:
    """A row of the table."""
    return f"| {name} | {old[key]:.3g} | {new[key]:.3g} | {new[key] / old[key]:.2f} |"


if __name__ == "__main__":
    main()
