"""Walks of the comparison: kept while methods are measured, carried out in MuJoCo, and refined.

Planners and policies are treated alike: what is kept of a walk are its states, and a walk that
several methods take is carried out once.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from processes import Processes

from mlivr_gym.agents.evaluation import Evaluation
from mlivr_gym.agents.test_set import HeldOutWorld, load_test_set
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import PlanError
from mlivr_gym.planners.refinement import refined
from mlivr_gym.planners.walks import plan_of
from mlivr_gym.simulation.execution import execute
from mlivr_gym.transitions.state import State

Walk = list[list[int]]
"""Points and then branches of the limbs in each state, as a file keeps them."""


KEPT = 10
"""Walks after which what is known is kept."""

ASKED: list[tuple[int, Walk]] = []
"""Tasks and walks with which processes are forked."""


class Walks:
    """Keeps the states of the episodes that reach their goal, while they are measured."""

    def __init__(self, told: Callable[[], Any]) -> None:
        """Call `told` after each episode."""
        self._told, self._episode = told, 0
        self._found: dict[int, Walk] = {}

    def count(self, done: int) -> None:
        """An episode has ended."""
        self._episode = done
        self._told()

    def keep(self, env: MlivrEnv, states: tuple[State, ...]) -> None:
        """The states of the present episode; it tells nothing of an execution."""
        self._found[self._episode] = [[*state.stance, *state.masks] for state in states]

    def of(self, result: Evaluation) -> list[Walk | None]:
        """The walk of each episode, None where the goal was not reached."""
        return [self._found.get(k) for k in range(len(result.steps))]


@cache
def same_map() -> tuple[MlivrEnv, HeldOutWorld]:
    """The environment and the tasks of the same map."""
    world = next(w for w in load_test_set() if w.split == "same")
    return MlivrEnv(map=world.map(), precompute=True), world


def outcome(task: int, walk: Walk) -> dict[str, Any]:
    """What becomes of a walk: whether MuJoCo carries it out, and its translation when refined.

    Parameters
    ----------
    task
        Number of the task on the same map.
    walk
        The states.
    """
    env, world = same_map()
    limbs = env.graph.limbs
    states = [State(tuple(row[:limbs]), tuple(row[limbs:])) for row in walk]
    goal = np.array(world.tasks[task].goal)
    plan = plan_of(env.graph, states, goal, env.goal_tolerance, "walk")
    if plan is None:
        return {"carried_out": False, "refined_m": None}
    try:
        done = execute(env.graph, plan).failure is None
    except PlanError:  # it cannot be followed inside the joint limits
        done = False
    return {"carried_out": done, "refined_m": refined(env.graph, plan).base_translation}


def _outcome_of(k: int) -> dict[str, Any]:
    """What becomes of one of the walks that are asked for."""
    return outcome(*ASKED[k])


def walked(
    rows: list[dict[str, Any]], count: int, known: dict[str, Any], keep: Callable[[], None]
) -> None:
    """Carry out and refine the walks of the first tasks; what came of it goes into the rows.

    Parameters
    ----------
    rows
        Records of methods on the same map, with their walks.
    count
        How many tasks.
    known
        What is known of walks, by their task and states; it grows, the short ones first.
    keep
        Called now and then, to keep what is known.
    """
    asked: dict[str, tuple[int, Walk]] = {}
    for row in rows:
        for task, walk in zip(row["tasks"][:count], row["walks"], strict=False):
            if walk is not None and len(walk) > 1:
                asked[name_of(task, walk)] = (task, walk)
    missing = sorted((name for name in asked if name not in known), key=lambda k: len(asked[k][1]))
    if missing:
        same_map()  # before processes are forked
        work = Processes(len(os.sched_getaffinity(0)))
        ASKED[:] = [asked[name] for name in missing]
        answers = work.answers(_outcome_of, range(len(missing)), "walks carried out")
        for k, (name, answer) in enumerate(zip(missing, answers, strict=True)):
            known[name] = answer
            if k % KEPT == 0:
                keep()
    for row in rows:
        found = [
            None if walk is None else known.get(name_of(task, walk))
            for task, walk in zip(row["tasks"][:count], row["walks"], strict=False)
        ]
        row["carried_out"] = [None if one is None else one["carried_out"] for one in found]
        row["refined"] = [None if one is None else one["refined_m"] for one in found]


def name_of(task: int, walk: Walk) -> str:
    """Name of a walk among those that are known."""
    return f"{task}: {json.dumps(walk)}"
