"""Walks of `planner_vs_rl.py`: stored while methods are evaluated, then simulated and refined.

Planners and policies are treated alike: only the states of a walk are stored, and a walk that
several methods take is simulated once.
"""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
from reports import study_rows

from mlivr_gym.agents.test_set import HeldOutWorld, load_test_set
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import PlanError
from mlivr_gym.planners.refinement import refined
from mlivr_gym.planners.walks import plan_of
from mlivr_gym.simulation.execution import execute
from mlivr_gym.transitions.state import State

Walk = list[list[int]]
"""Points, then branch sets of the limbs in each state, as stored in the results."""


@cache
def same_map() -> tuple[MlivrEnv, HeldOutWorld]:
    """Return the environment and the tasks of the split `same`."""
    world = next(w for w in load_test_set() if w.split == "same")
    return MlivrEnv(map=world.map(), precompute=True), world


def outcome(task: int, walk: str) -> dict[str, Any]:
    """Simulate and refine a walk of a task; return success and refined base translation [m]."""
    number, rows = json.loads(walk)
    env, world = same_map()
    limbs = env.graph.limbs
    states = [State(tuple(row[:limbs]), tuple(row[limbs:])) for row in rows]
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
    walks = [
        [
            json.dumps([task, walk]) if walk is not None and len(walk) > 1 else None
            for task, walk in zip(row["tasks"][:count], row["walks"], strict=False)
        ]
        for row in rows
    ]
    different = dict.fromkeys(one for some in walks for one in some if one is not None)
    found = study_rows("comparison_walks:outcome", 1, workers, walk=list(different))
    known = {one["walk"]: one for one in found}
    for row, some in zip(rows, walks, strict=True):
        row["carried_out"] = [None if one is None else known[one]["carried_out"] for one in some]
        row["refined"] = [None if one is None else known[one]["refined_m"] for one in some]
