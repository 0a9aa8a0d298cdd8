"""Walks of `planner_vs_rl.py`: stored while methods are evaluated, then simulated and refined.

Planners and policies are treated alike: only the states of a walk are stored, and a walk that
several methods take is simulated once.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from reports import ROOT, study_rows

from mlivr_gym.agents.evaluation import Evaluation
from mlivr_gym.agents.test_set import HeldOutWorld, load_test_set
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import PlanError
from mlivr_gym.files import write_whole
from mlivr_gym.planners.refinement import refined
from mlivr_gym.planners.walks import plan_of
from mlivr_gym.simulation.execution import execute
from mlivr_gym.transitions.state import State

Walk = list[list[int]]
"""Points, then branch sets of the limbs in each state, as stored in the results."""


class Walks:
    """Recorder of the states of the episodes that reach their goal."""

    def __init__(self) -> None:
        """Create an empty recorder."""
        self._episode = 0
        self._found: dict[int, Walk] = {}

    def count(self, done: int) -> None:
        """Note that an episode has ended; `done` is the number of episodes so far."""
        self._episode = done

    def keep(self, env: MlivrEnv, states: tuple[State, ...]) -> None:
        """Store the states of the present episode."""
        self._found[self._episode] = [[*state.stance, *state.branch_sets] for state in states]

    def by_episode(self, result: Evaluation) -> list[Walk | None]:
        """Return the walk of each episode, None where the goal was not reached."""
        return [self._found.get(k) for k in range(len(result.steps))]


@cache
def same_map() -> tuple[MlivrEnv, HeldOutWorld]:
    """Return the environment and the tasks of the split `same`."""
    world = next(w for w in load_test_set() if w.split == "same")
    return MlivrEnv(map=world.map(), precompute=True), world


def outcome(task: int, file: str) -> dict[str, Any]:
    """Simulate and refine a walk of a file; return success and refined base translation [m]."""
    number, walk = json.loads(Path(file).read_text(encoding="utf-8"))[task]
    env, world = same_map()
    limbs = env.graph.limbs
    states = [State(tuple(row[:limbs]), tuple(row[limbs:])) for row in walk]
    goal = np.array(world.tasks[number].goal)
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
    requested: dict[str, tuple[int, Walk]] = {}
    for row in rows:
        for task, walk in zip(row["tasks"][:count], row["walks"], strict=False):
            if walk is not None and len(walk) > 1:
                requested[key_of(task, walk)] = (task, walk)
    file = ROOT / "runs" / "studies" / "walks.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, json.dumps(list(requested.values())))
    found = study_rows("comparison_walks:outcome", len(requested), workers, file=[str(file)])
    known = dict(zip(requested, found, strict=True))
    for row in rows:
        done = [
            None if walk is None else known.get(key_of(task, walk))
            for task, walk in zip(row["tasks"][:count], row["walks"], strict=False)
        ]
        row["carried_out"] = [None if one is None else one["carried_out"] for one in done]
        row["refined"] = [None if one is None else one["refined_m"] for one in done]


def key_of(task: int, walk: Walk) -> str:
    """Return the key of a walk in the stored outcomes."""
    return f"{task}: {json.dumps(walk)}"
