"""Compare planners and learned policies on the frozen test set and with unreliable grasps.

    python experiments/planner_vs_rl.py [--policies runs] [--workers 2] [--out results]
    python experiments/planner_vs_rl.py --freeze     # draw the test set anew

`--policies` is the folder that `train_policies.py` filled. All methods run through
`mlivr_gym.agents.evaluate`: on the four splits of the test set, on a map with no step known, and
with grasps that fail. The episodes of all methods on the first `--execute N` tasks of the same map
are simulated in MuJoCo and refined. Writes `planner_vs_rl.json`, `planner_vs_rl.md`, of which
`readme.py` copies one table, and `planner_vs_rl.png` and `.svg`. With the training of the policies
it takes two to three hours (`make compare`).
"""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from comparison_report import figure, markdown
from reports import CORES, ROOT, experiment, study_rows
from train_policies import GRASP_FAILURE

from mlivr_gym import Settings, stance_graph
from mlivr_gym.agents import (
    Evaluation,
    ExpertPolicy,
    Policy,
    RandomPolicy,
    baseline_policy,
    evaluate,
    load_policy,
    load_test_set,
    planner_policy,
)
from mlivr_gym.agents.learned import beam_policy
from mlivr_gym.agents.test_set import freeze_test_set
from mlivr_gym.envs import MlivrEnv
from mlivr_gym.errors import PlanError
from mlivr_gym.planners import Planner, SearchOptions, plan_of
from mlivr_gym.planners.refinement import refined
from mlivr_gym.simulation import execute
from mlivr_gym.stances import State

SIZES = {"same": 60, "half": 52, "dense": 50, "occupied": 50}
"""Number of tasks in each split."""

SEED = 20261121

NO_THRESHOLDS = "no-manipulability-reached"
"""A* in a world without thresholds: whether it reaches the goal at all."""

MOST_STEPS = 60


def planners() -> dict[str, Callable[[MlivrEnv], Policy]]:
    """Return the methods that need no training, by name."""
    return {
        "astar-steps": lambda env: planner_policy("steps"),
        "astar-base": lambda env: planner_policy("base"),
        "dijkstra": lambda env: planner_policy("steps", options=SearchOptions(method="dijkstra")),
        "table": lambda env: ExpertPolicy(),
        "table-sure": lambda env: ExpertPolicy(expect_failures=False),
        "table-expected": lambda env: ExpertPolicy(),
        "greedy": lambda env: planner_policy("steps", options=SearchOptions(method="greedy")),
        "local": lambda env: baseline_policy("local"),
        "mcts": lambda env: baseline_policy("mcts"),
        "two-level": lambda env: baseline_policy("two_level"),
        "no-manipulability": without_manipulability,
        NO_THRESHOLDS: lambda env: planner_policy("steps"),
        "random": lambda env: RandomPolicy(0),
    }


def learned(folder: Path, names: Sequence[str] = ()) -> list[str]:
    """Return the trained policies in a folder, as `NAME/SEED`, all or those of some names.

    Pointer policies that imitate also guide a beam search, as `NAME-beam`.
    """
    found = []
    for file in sorted(folder.glob("*-*-*.pt")):
        name, _, seed = file.stem.rpartition("-")
        if not names or name in names:
            beam = [f"{name}-beam/{seed}"] if name in ("dagger-pointer", "risky-pointer") else []
            found += [f"{name}/{seed}", *beam]
    return found


def make(method: str, env: MlivrEnv, policies: str) -> Policy:
    """Return a policy of an environment by the name of its method, with `/SEED` if learned."""
    name, _, seed = method.partition("/")
    if not seed:
        return planners()[name](env)
    policy = load_policy(Path(policies) / f"{name.removesuffix('-beam')}-{seed}", env)
    return beam_policy(policy) if name.endswith("-beam") else policy


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


@cache
def environment(world: int, **arguments: Any) -> MlivrEnv:
    """Return an environment on the map of a world of the test set."""
    return MlivrEnv(map=load_test_set()[world].map(), **arguments)


@cache
def layouts() -> list[tuple[int, list[int]]]:
    """Return the numbers of worlds of the test set, and of their tasks that share a layout."""
    return [
        (number, [k for k, task in enumerate(world.tasks) if task.occupied == layout])
        for number, world in enumerate(load_test_set())
        for layout in dict.fromkeys(task.occupied for task in world.tasks)
    ]


def first_world(split: str) -> int:
    """Return the number of the first world of a split."""
    return next(k for k, world in enumerate(load_test_set()) if world.split == split)


def of_split(task: int, method: str, policies: str) -> dict[str, Any]:
    """Evaluate a method on the tasks of one layout of the test set."""
    at, group = layouts()[task]
    world, name = load_test_set()[at], method.partition("/")[0]
    if not meant_for(name, world.split):
        return {"family": None}
    lax = name == NO_THRESHOLDS
    arguments = {"manipulability": False} if lax else {}
    env, walks = environment(at, **arguments), list[list[list[int]]]()
    if not lax and world.split != "dense":
        env.table_moves()

    def keep(env: MlivrEnv, states: tuple[State, ...]) -> None:
        """Keep the points and branch sets of the limbs in each state of a walk."""
        walks.append([[*state.stance, *state.branch_sets] for state in states])

    tasks = [world.tasks[k] for k in group]
    env.graph.occupy(tasks[0].occupied)
    policy = make(method, env, policies)
    result = evaluate(env, policy, tasks, max_steps=MOST_STEPS, execute=keep)
    env.graph.vacate()
    found = record(result, group)
    if world.split == "same" and not lax:
        found["walks"] = [walks.pop(0) if reached else None for reached in result.success]
    return {"family": world.split, "part": f"{at}/{group[0]}", "found": found}


def cold(task: int, method: str, policies: str) -> dict[str, Any]:
    """Measure the time to the first action on the dense map with no step known."""
    at = first_world("dense")
    env = copy.deepcopy(environment(at))
    given = [load_test_set()[at].tasks[task]]
    found = record(evaluate(env, make(method, env, policies), given, max_steps=MOST_STEPS), [task])
    return {"family": "cold", "part": f"{task}/{task}", "found": found}


def unreliable(task: int, method: str, policies: str) -> dict[str, Any]:
    """Evaluate a method with failing grasps: an episode of each task of the same map."""
    at = first_world("same")
    env, tasks = environment(at, grasp_failure=GRASP_FAILURE), load_test_set()[at]
    env.table_moves()
    policy = make(method, env, policies)
    result = evaluate(env, policy, tasks.tasks, seed=1000 * task, max_steps=MOST_STEPS)
    found = record(result, range(len(tasks.tasks)))
    return {"family": "unreliable", "part": f"{task}/0", "found": found}


def outcome(task: int, walk: str) -> dict[str, Any]:
    """Simulate and refine a walk of a task; return success and refined base translation [m]."""
    number, rows = json.loads(walk)
    at = first_world("same")
    env = environment(at)
    env.table_moves()
    limbs = env.graph.limbs
    states = [State(tuple(row[:limbs]), tuple(row[limbs:])) for row in rows]
    goal = np.array(load_test_set()[at].tasks[number].goal)
    plan = plan_of(env.graph, states, goal, env.goal_tolerance, "walk")
    if plan is None:
        return {"carried_out": False, "refined_m": None}
    try:
        done = execute(env.graph, plan).failure is None
    except PlanError:  # it cannot be followed inside the joint limits
        done = False
    return {"carried_out": done, "refined_m": refined(env.graph, plan).base_translation}


def carry_out(rows: list[dict[str, Any]], count: int, workers: int) -> None:
    """Simulate and refine the walks of the first `count` tasks; store the outcomes in the rows.

    `rows` are the records of methods on the same map.
    """
    walks = [
        [
            json.dumps([task, walk]) if walk is not None and len(walk) > 1 else None
            for task, walk in zip(row["tasks"][:count], row["walks"], strict=False)
        ]
        for row in rows
    ]
    different = dict.fromkeys(one for some in walks for one in some if one is not None)
    found = study_rows("planner_vs_rl:outcome", 1, workers, walk=list(different))
    known = {one["walk"]: one for one in found}
    for row, some in zip(rows, walks, strict=True):
        row["carried_out"] = [None if one is None else known[one]["carried_out"] for one in some]
        row["refined"] = [None if one is None else known[one]["refined_m"] for one in some]


def measured(policies: str, execute: int, workers: int) -> dict[str, Any]:
    """Evaluate all methods; simulate and refine the walks on the first `execute` tasks."""
    torch.set_num_threads(1)
    folder, some = Path(policies), ["local", "mcts", "random", "astar-steps"]
    methods = {
        "of_split": [*planners(), *learned(folder)],
        "cold": ["astar-steps", "greedy", "local", *learned(folder, ["dagger-pointer"])[:1]],
        "unreliable": [*some, "table-sure", "table-expected",
                       *learned(folder, ["dagger-pointer", "risky-pointer"])],
    }  # fmt: skip
    counts, data = {"of_split": len(layouts()), "cold": 20, "unreliable": 3}, dict[str, Any]()
    for kind, names in methods.items():
        given = {"method": names, "policies": [policies]}
        for row in study_rows(f"planner_vs_rl:{kind}", counts[kind], workers, **given):
            if row["family"] is not None:
                name, _, seed = row["method"].partition("/")
                family = data.setdefault(row["family"], {})
                parts = family.setdefault(name, {}).setdefault(seed or "0", {})
                parts[row["part"]] = {k: v for k, v in row["found"].items() if v is not None}
    same = [row for seeds in data["same"].values() for parts in seeds.values()
            for row in parts.values() if "walks" in row]  # fmt: skip
    carry_out(same, execute, workers)
    return data


def meant_for(name: str, split: str) -> bool:
    """Return whether a method is evaluated on a split."""
    if name.startswith(("risky", "table-")):
        return False
    if split == "dense":
        # Steps are not checked beforehand; these methods need so many that a task takes minutes.
        slow = ("table", "dijkstra", "mcts", "no-manipulability", NO_THRESHOLDS)
        return name not in slow and not name.endswith(("mlp", "-beam"))
    return split != "half" or not name.endswith("mlp")  # trained for one number of points


if __name__ == "__main__":
    if "--freeze" in sys.argv:
        freeze_test_set(ROOT / "envs_assets" / "test_set.json", SEED, SIZES)
    else:
        experiment(
            "planner_vs_rl", __doc__, measured, markdown, figure,
            indent=None, policies="runs", execute=50, workers=CORES,
        )  # fmt: skip
