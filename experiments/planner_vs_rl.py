"""Compare planners and learned policies on the frozen test set and with unreliable grasps.

    python experiments/planner_vs_rl.py [--policies runs] [--out results] [--only NAME ...]
        [--families NAME ...]
    python experiments/planner_vs_rl.py --freeze     # draw the test set anew
    python experiments/planner_vs_rl.py --report     # only write page and figure

`--policies` is the folder that `train_policies.py` filled. All methods run through
`mlivr_gym.agents.evaluate`: on the four splits of the test set, on a map with no step known, and
with grasps that fail. The episodes of all methods on the first `--execute N` tasks of the same map
are simulated in MuJoCo and refined. Results are added to `planner_vs_rl.json` part by part, and a
part that it holds is not measured again. Writes `planner_vs_rl.md`, of which `readme.py` copies one
table, and `planner_vs_rl.png` and `.svg`. With the training of the policies it takes two to three
hours (`make compare`).
"""

from __future__ import annotations

import argparse
import copy
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from comparison_report import figure, markdown
from comparison_walks import Walks, carry_out
from reports import ROOT, command_line, keep, publish, read
from tqdm import tqdm
from train_policies import GRASP_FAILURE

from mlivr_gym import Settings, stance_graph
from mlivr_gym.agents import (
    ExpertPolicy,
    Policy,
    RandomPolicy,
    baseline_policy,
    evaluate,
    planner_policy,
)
from mlivr_gym.agents.evaluation import Evaluation
from mlivr_gym.agents.learned import beam_policy, load_policy
from mlivr_gym.agents.test_set import HeldOutWorld, freeze_test_set, load_test_set
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.planners import Planner

SIZES = {"same": 60, "half": 52, "dense": 50, "occupied": 50}
"""Number of tasks in each split."""

SEED = 20261121

FAMILIES = ("splits", "executed", "cold", "unreliable")
"""Splits of the test set, simulated walks, first action on an unknown map, and unreliable
grasps."""

NO_THRESHOLDS = "no-manipulability-reached"
"""A* in a world without thresholds: whether it reaches the goal at all."""

MOST_STEPS = 60

Make = Callable[[MlivrEnv], Policy]


def planners() -> dict[str, Make]:
    """Return the methods that need no training, by name."""
    return {
        "astar-steps": lambda env: planner_policy("steps"),
        "astar-base": lambda env: planner_policy("base"),
        "dijkstra": lambda env: planner_policy("steps", "dijkstra"),
        "table": lambda env: ExpertPolicy(),
        "greedy": lambda env: planner_policy("steps", "greedy"),
        "local": lambda env: baseline_policy("local"),
        "mcts": lambda env: baseline_policy("mcts"),
        "two-level": lambda env: baseline_policy("two_level"),
        "no-manipulability": without_manipulability,
        NO_THRESHOLDS: lambda env: planner_policy("steps"),
        "random": lambda env: RandomPolicy(0),
    }


def learned(folder: Path, only: Sequence[str] = ()) -> dict[str, dict[int, Make]]:
    """Return the trained policies in a folder, by name and seed.

    Pointer policies that imitate also guide a beam search, as `NAME-beam`.
    """
    found: dict[str, dict[int, Make]] = {}
    for file in sorted(folder.glob("*-*-*.pt")):
        name, _, seed = file.stem.rpartition("-")
        path = file.with_suffix("")
        if only and name not in only:
            continue
        found.setdefault(name, {})[int(seed)] = partial(load_policy, path)
        if name in ("dagger-pointer", "risky-pointer"):
            by_seed = found.setdefault(f"{name}-beam", {})
            by_seed[int(seed)] = partial(beam_of, path)
    return found


def beam_of(path: Path, env: MlivrEnv) -> Policy:
    """Return the beam search that a checkpoint guides."""
    return beam_policy(load_policy(path, env))


def without_manipulability(env: MlivrEnv) -> Policy:
    """Return A* on the stance graph without thresholds."""
    graph = stance_graph(env.graph.grasp_map, settings=Settings(manipulability=False))
    graph.occupy(sorted(env.graph.occupied))
    return planner_policy(planner=Planner(graph))


def record(result: Evaluation, ids: Sequence[int]) -> dict[str, Any]:
    """Return an evaluation as plain data."""
    data = {
        name: np.round(getattr(result, name), 6).tolist()
        for name in ("base_translation", "first_decision", "decision")
    }
    data |= {name: getattr(result, name).tolist() for name in ("success", "steps", "failed_grasps")}
    return data | {"tasks": list(ids)}


class Results:
    """The stored results: a part that exists is not measured again."""

    def __init__(self, out: Path) -> None:
        """Read the stored results, if any."""
        self.out, self.data = out, read(out, "planner_vs_rl")

    def has(self, family: str, name: str, seed: int, part: int, first: int) -> bool:
        """Return whether a part is stored; `first` is its first task."""
        return f"{part}/{first}" in self.data.get(family, {}).get(name, {}).get(str(seed), {})

    def add(self, family: str, name: str, seed: int, part: int, result: dict[str, Any]) -> None:
        """Add a part and write the file."""
        parts = self.data.setdefault(family, {}).setdefault(name, {}).setdefault(str(seed), {})
        parts[f"{part}/{result['tasks'][0]}"] = result
        self.write()

    def write(self) -> None:
        """Write the file."""
        keep(self.out, "planner_vs_rl", self.data, indent=None)


def evaluate_splits(args: argparse.Namespace, results: Results) -> None:
    """Evaluate all methods on the worlds of the test set."""
    for at, world in enumerate(load_test_set()):
        if world.split in args.splits:
            evaluate_world(world, at, args, results)


def evaluate_world(
    world: HeldOutWorld, at: int, args: argparse.Namespace, results: Results
) -> None:
    """Evaluate all methods on one world of the test set."""
    env = MlivrEnv(map=world.map(), precompute=world.split != "dense")
    lax = MlivrEnv(map=world.map(), manipulability=False)
    makes = {name: {0: make} for name, make in planners().items()} | learned(Path(args.policies))
    for layout in dict.fromkeys(task.occupied for task in world.tasks):
        group = [k for k, task in enumerate(world.tasks) if task.occupied == layout]
        tasks = [world.tasks[k] for k in group]
        env.graph.occupy(layout)
        for name, seeds in makes.items():
            if (args.only and name not in args.only) or not meant_for(name, world.split):
                continue
            for seed, make in seeds.items():
                if results.has(world.split, name, seed, at, group[0]):
                    continue
                title = f"{world.split} {at} {name} {seed}"
                world_env = lax if name == NO_THRESHOLDS else env
                with tqdm(total=len(tasks), desc=title, mininterval=5.0) as bar:
                    walks = Walks(bar.update)
                    result = evaluate(world_env, make(world_env), tasks, max_steps=MOST_STEPS,
                                      progress=walks.count, execute=walks.keep)  # fmt: skip
                found = record(result, group)
                if world.split == "same" and name != NO_THRESHOLDS:
                    found["walks"] = walks.by_episode(result)
                results.add(world.split, name, seed, at, found)
        env.graph.vacate()


def meant_for(name: str, split: str) -> bool:
    """Return whether a method is evaluated on a split."""
    if name.startswith("risky"):
        return False
    if split == "dense":
        # Steps are not checked beforehand; these methods need so many that a task takes minutes.
        slow = ("table", "dijkstra", "mcts", "no-manipulability", NO_THRESHOLDS)
        return name not in slow and not name.endswith(("mlp", "-beam"))
    return split != "half" or not name.endswith("mlp")  # trained for one number of points


def executed(args: argparse.Namespace, results: Results) -> None:
    """Simulate and refine all walks on the first tasks of the same map."""
    same = results.data.get("same", {})
    rows = [
        part
        for seeds in same.values()
        for parts in seeds.values()
        for part in parts.values()
        if "walks" in part
    ]
    carry_out(rows, args.execute, results.data.setdefault("walks", {}), results.write)
    results.write()


def cold(args: argparse.Namespace, results: Results) -> None:
    """Measure the time to the first action on the dense map with no step known."""
    world = next(w for w in load_test_set() if w.split == "dense")
    unknown = MlivrEnv(map=world.map())
    makes = {name: planners()[name] for name in ("astar-steps", "greedy", "local")}
    makes |= {
        name: seeds[min(seeds)]
        for name, seeds in learned(Path(args.policies), ["dagger-pointer"]).items()
    }
    for name, make in makes.items():
        if args.only and name not in args.only:
            continue
        for k, task in enumerate(tqdm(world.tasks[:20], desc=f"cold {name}", mininterval=5.0)):
            if results.has("cold", name, 0, k, k):
                continue
            env = copy.deepcopy(unknown)
            found = evaluate(env, make(env), [task], max_steps=MOST_STEPS)
            results.add("cold", name, 0, k, record(found, [k]))


def unreliable(args: argparse.Namespace, results: Results) -> None:
    """Evaluate methods with failing grasps: the tasks of the same map, three episodes each."""
    world = next(w for w in load_test_set() if w.split == "same")
    env = MlivrEnv(map=world.map(), grasp_failure=GRASP_FAILURE, precompute=True)
    untrained = planners()
    makes: dict[str, dict[int, Make]] = {
        "astar-steps": {0: untrained["astar-steps"]},
        "table-sure": {0: lambda env: ExpertPolicy(expect_failures=False)},
        "table-expected": {0: untrained["table"]},
        **{name: {0: untrained[name]} for name in ("local", "mcts", "random")},
    }
    makes |= learned(Path(args.policies), ["dagger-pointer", "risky-pointer"])
    for name, by_seed in makes.items():
        if args.only and name not in args.only:
            continue
        for seed, make in by_seed.items():
            for episode in range(3):
                if results.has("unreliable", name, seed, episode, 0):
                    continue
                result = evaluate(
                    env, make(env), world.tasks, seed=1000 * episode, max_steps=MOST_STEPS
                )
                data = record(result, range(len(world.tasks)))
                results.add("unreliable", name, seed, episode, data)


def main() -> None:
    """Run the requested measurements, and write page and figure."""
    parser = command_line(__doc__)
    parser.add_argument("--policies", default="runs", help="folder of checkpoints")
    parser.add_argument("--only", nargs="+", help="only these methods")
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=FAMILIES)
    parser.add_argument("--splits", nargs="+", default=tuple(SIZES), choices=tuple(SIZES))
    parser.add_argument("--execute", type=int, default=50, help="tasks carried out")
    parser.add_argument("--freeze", action="store_true", help="draw the test set anew and stop")
    parser.add_argument("--report", action="store_true", help="only write the report")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.freeze:
        freeze_test_set(ROOT / "envs_assets" / "test_set.json", SEED, SIZES)
        return
    results = Results(args.out)
    runs: dict[str, Callable[[argparse.Namespace, Results], None]] = {
        "splits": evaluate_splits, "executed": executed, "cold": cold, "unreliable": unreliable,
    }  # fmt: skip
    for family in FAMILIES:
        if family in args.families and not args.report:
            runs[family](args, results)
    publish(args.out, "planner_vs_rl", results.data, markdown, indent=None)
    figure(results.data, args.out / "planner_vs_rl.png")


if __name__ == "__main__":
    main()
