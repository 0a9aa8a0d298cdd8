"""Evaluation of planners, baselines and learned policies by the same episodes and measures."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import NamedTuple

import numpy as np

from mlivr_gym.agents.policies import Policy
from mlivr_gym.arguments import SEED, InstanceOf, Reader, checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import SettingError
from mlivr_gym.schema import Anything, FieldPath, Integer, ListOf
from mlivr_gym.transitions.state import State
from mlivr_gym.values import MAX_POINTS


class EvaluationTask(NamedTuple):
    """Start and goal of an episode by the ids of points, as a file stores them."""

    start: tuple[str, ...]
    """Id of the point that each limb holds."""
    goal: tuple[float, ...]
    """Goal position of the base [m]."""
    occupied: tuple[str, ...] = ()
    """Ids of points that no limb may grasp."""


@dataclass(frozen=True)
class Evaluation:
    """Results of k episodes."""

    success: BoolArray
    """Whether the goal was reached, shape (k,)."""
    steps: IntArray
    """Number of actions, failed episodes included, shape (k,)."""
    base_translation: Array
    """Sum of base displacements [m], shape (k,)."""
    first_decision: Array
    """Time of the reset and of the choice of the first action [s], shape (k,)."""
    decision: Array
    """Mean time in which the policy chooses an action [s], shape (k,)."""
    failed_grasps: IntArray
    """Number of actions whose grasp failed by `MlivrEnv`'s `grasp_failure`, shape (k,). A step that
    fails in simulation is not among them."""
    executed: Array
    """1 if `execute` could execute the states of the episode, 0 if not, NaN if it was not asked,
    shape (k,)."""

    @property
    def success_rate(self) -> float:
        """Share of the episodes that reached the goal."""
        return float(self.success.mean())


EPISODES = Reader(
    lambda value, place: (
        ListOf(InstanceOf(EvaluationTask), 1, MAX_POINTS).read(value, place)
        if isinstance(value, (list, tuple))
        else Integer(1, 10**9).read(value, place)
    )
)
"""Validator of a number of episodes, or of their tasks."""


@checked({"env": Anything(), "episodes": EPISODES, "seed": SEED, "max_steps": Integer(0, 10**9)})
def evaluate(
    env: MlivrEnv,
    policy: Policy,
    episodes: int | Sequence[EvaluationTask],
    seed: int = 0,
    max_steps: int = 100,
    *,
    progress: Callable[[int], None] | None = None,
    execute: Callable[[MlivrEnv, tuple[State, ...]], bool | None] | None = None,
) -> Evaluation:
    """Run a policy and return its results; episode k starts from `reset(seed=seed + k)`.

    An episode that starts in the goal region is a success without an action. Raises a
    `SettingError` if there is no episode, or the environment is wrapped.

    Parameters
    ----------
    env
        The environment, unwrapped (`env.unwrapped`). Tasks may occupy points of its graph;
        afterwards the same points are occupied as before.
    policy
        The policy.
    episodes
        Number of episodes, or their tasks.
    seed
        Seed of the first episode.
    max_steps
        Number of actions after which an episode counts as failed. An episode also fails with the
        first invalid action, and when a simulated step fails.
    progress
        Function that is called with the number of finished episodes.
    execute
        Function that executes the states of a successful episode, for example in MuJoCo. It takes
        the environment and the states, and returns whether it could execute them, or None if it did
        not try.

    Examples
    --------
    >>> import gymnasium
    >>> from mlivr_gym.agents import ExpertPolicy
    >>> env = gymnasium.make("mlivr_gym:MLIVR-JEM-v0").unwrapped
    >>> evaluate(env, ExpertPolicy(), episodes=2).success_rate
    1.0
    """
    if not isinstance(env, MlivrEnv):
        place = FieldPath("env", SettingError)
        raise place.refused(env, "a MlivrEnv without wrappers, as env.unwrapped is")
    tasks = repeat(None, episodes) if isinstance(episodes, int) else episodes
    rows: list[tuple[float, ...]] = []
    before = env.graph.ids(sorted(env.graph.occupied))
    try:
        for k, task in enumerate(tasks):
            if task is not None:
                _set_occupied_points(env, task.occupied)
            rows.append(_run_episode(env, policy, task, seed + k, max_steps, execute))
            if progress is not None:
                progress(k + 1)
    finally:
        _set_occupied_points(env, before)
    return Evaluation(*(np.array(column) for column in zip(*rows, strict=True)))


def _set_occupied_points(env: MlivrEnv, points: Sequence[str]) -> None:
    """Make exactly these points occupied."""
    if {env.graph.grasp_map.index(point) for point in points} != env.graph.occupied:
        env.graph.vacate()
        env.graph.occupy(points)


def _run_episode(
    env: MlivrEnv,
    policy: Policy,
    task: EvaluationTask | None,
    seed: int,
    max_steps: int,
    execute: Callable[[MlivrEnv, tuple[State, ...]], bool | None] | None,
) -> tuple[float, ...]:
    """Run one episode; return its results in the order of `Evaluation`."""
    began = time.perf_counter()
    options = {} if task is None else {"start": task.start, "goal": task.goal}
    observation, info = env.reset(seed=seed, options=options)
    states, failed, spent, first = [env.state], 0, 0.0, 0.0
    ended = success = bool(info["is_success"])
    while not ended and info["steps"] < max_steps and not info["invalid_action"]:
        mask, asked = env.action_masks(), time.perf_counter()
        action = policy.act(env, observation, mask)
        now = time.perf_counter()
        spent += now - asked
        first = first or now - began
        observation, _, ended, _, info = env.step(action)
        # A simulated step that fails ends the episode too.
        success = bool(info["is_success"])
        failed += info["grasp_failed"]
        if not (info["grasp_failed"] or info["invalid_action"] or info.get("failure")):
            states.append(env.state)
    answer = execute(env, tuple(states)) if success and execute is not None else None
    steps = int(info["steps"])
    executed = math.nan if answer is None else float(answer)
    metres = float(info["base_translation"])
    return success, steps, metres, first, spent / max(steps, 1), failed, executed


def bootstrap(values: Array) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap interval of a mean, or NaN without values.

    `values` are independent, shape (k,).
    """
    if not len(values):
        return float("nan"), float("nan")
    rng = np.random.default_rng(0)
    drawn = values[rng.integers(len(values), size=(1000, len(values)))]
    low, high = np.percentile(drawn.mean(axis=1), (2.5, 97.5))
    return float(low), float(high)
