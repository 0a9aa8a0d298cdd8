"""Other methods on the tasks of `many_limbs.py`, with the time limit of the search.

Greedy search, baselines from the literature and policies start without any checked step, as the
search does. The report shows how many tasks each method solves.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from reports import NOTHING, table

from mlivr_gym import stance_graph
from mlivr_gym.agents import RandomPolicy
from mlivr_gym.agents.learned import load_policy
from mlivr_gym.agents.policies import Policy
from mlivr_gym.arrays import Array
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.planners import Planner
from mlivr_gym.planners.baselines import find_walk
from mlivr_gym.planners.planning_result import PROVED_IMPOSSIBLE
from mlivr_gym.stances.moves import GraphMoves, Moves
from mlivr_gym.transitions.state import State, Successors

SEARCH = "the search, first plan"

METHODS = {
    "greedy": "greedy best-first",
    "local": "local choice (Bretl, Uno)",
    "two_level": "two levels (Rodriguez)",
    "mcts": "Monte Carlo tree search (Xu)",
    "pointer": "DAgger, pointer, trained with two limbs",
    "random": "random possible steps",
}
"""Names of the other methods in the table."""

MOST_STEPS = 60


class _LateError(Exception):
    """The time limit of a method has passed."""


@dataclass
class _Timed:
    """`Moves` that raise an error when the time limit has passed."""

    moves: Moves
    end: float

    def successors(self, state: State) -> Successors:
        """Return the steps that leave a state, unless the time limit has passed."""
        if time.perf_counter() > self.end:
            raise _LateError
        return self.moves.successors(state)

    def __getattr__(self, name: str) -> Any:
        """Return any other attribute of the moves."""
        return getattr(self.moves, name)


def walk_of(
    robot: str, method: str, start: State, goal: Array, seconds: float
) -> tuple[int, float] | None:
    """Return number of steps and duration [s] of a method's walk, or None if it finds none."""
    graph = stance_graph(robot=robot)
    env = MlivrEnv(robot=robot)
    began = time.perf_counter()
    if method == "greedy":
        found = Planner(graph).plan(
            start.stance, goal.tolist(), "steps", method=method, time_limit=seconds
        )
        steps = None if found.plan is None else len(found.plan.steps)
    elif method in ("pointer", "random"):
        policy: Policy = load_policy("pretrained", env) if method == "pointer" else RandomPolicy(0)
        steps = _episode(env, policy, start, goal, began + seconds)
    else:
        moves = _Timed(GraphMoves(graph), began + seconds)
        try:
            walk = find_walk(method, moves, start, goal, max_steps=MOST_STEPS)
            steps = len(walk.states) - 1 if walk.reached else None
        except _LateError:
            steps = None
    return None if steps is None else (steps, time.perf_counter() - began)


def _episode(env: MlivrEnv, policy: Policy, start: State, goal: Array, end: float) -> int | None:
    """Return the steps of a policy's episode, or None if it misses the goal or the time limit."""
    options = {"start": env.graph.ids(start.stance), "goal": goal.tolist()}
    observation, info = env.reset(options=options)
    for step in range(MOST_STEPS):
        mask = info["action_mask"].astype(np.bool_)
        if time.perf_counter() > end or not mask.any():
            return None
        observation, _, reached, _, info = env.step(policy.act(env, observation, mask))
        if reached or info["invalid_action"]:
            return step + 1 if reached else None
    return None


def section(measured: dict[str, list[dict[str, Any]]], seconds: float) -> str:
    """Return the section of the report on other methods, or nothing if they were not measured."""
    if not any(measured.values()):
        return ""
    rows = [row for robot, tasks in measured.items() for row in _rows(robot, tasks)]
    return f"""
## Other methods

Some of the tasks without a proof that no plan exists, {seconds:g} s each, at most {MOST_STEPS} \
steps; no step is known at the start. *Steps* (mean) and *time* (median) are those of the walks \
that a method finds, so methods differ in the tasks that count.

{table("robot | method | solved | steps | time [s]", rows)}"""


def _rows(robot: str, tasks: list[dict[str, Any]]) -> list[list[str]]:
    """Return the table rows of a robot, over its tasks for which no plan was ruled out."""
    able = [task for task in tasks if task["steps"]["reason"] not in PROVED_IMPOSSIBLE]
    firsts = [task["steps"]["improvements"][:1] for task in able]
    found = {SEARCH: [(one[0][1], one[0][0]) if one else None for one in firsts]}
    found |= {name: [task["methods"][key] for task in able] for key, name in METHODS.items()}
    rows = []
    for name, answers in found.items():
        good = [answer for answer in answers if answer is not None]
        steps = f"{np.mean([one[0] for one in good]):.1f}" if good else NOTHING
        seconds = f"{np.median([one[1] for one in good]):.2f}" if good else NOTHING
        rows.append([f"`{robot}`", name, f"{len(good)} of {len(able)}", steps, seconds])
    return rows
