"""Evaluation of planners, baselines and learned policies by the same episodes and measures."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any, NamedTuple

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


class Episode(NamedTuple):
    """What a policy did in an episode."""

    actions: tuple[int, ...]
    """The actions."""
    decisions: tuple[float, ...]
    """Time in which the policy chose each action [s]."""
    first_decision: float
    """Time of the reset and of the choice of the first action [s]."""
    total_reward: float
    """Sum of the rewards."""
    states: tuple[State, ...]
    """The state at the start, and after each action that made its step."""
    failed_grasps: int
    """Number of actions whose grasp failed."""
    start: dict[str, Any]
    """Information of the reset."""
    end: dict[str, Any]
    """Information at the end."""

    @property
    def success(self) -> bool:
        """Whether the goal was reached."""
        return bool(self.end["is_success"])


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
    optimal_cost: Array
    """Optimal cost from the start, NaN without the environment's `info_regret`, shape (k,)."""
    regret: Array
    """Regret at the end, NaN without the environment's `info_regret`, shape (k,)."""

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
            options = {} if task is None else {"start": task.start, "goal": task.goal}
            rows.append(_row(env, run_episode(env, policy, options, seed + k, max_steps), execute))
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


def run_episode(
    env: MlivrEnv, policy: Policy, options: dict[str, Any], seed: int | None, max_steps: int
) -> Episode:
    """Run one episode with options and a seed of `MlivrEnv.reset`; it ends as in `evaluate`."""
    began = time.perf_counter()
    observation, info = env.reset(seed=seed, options=options)
    start, states, failed, first, total = info, [env.state], 0, 0.0, 0.0
    actions: list[int] = []
    decisions: list[float] = []
    ended = bool(info["is_success"])
    while not ended and len(actions) < max_steps and not info["invalid_action"]:
        mask, asked = env.action_masks(), time.perf_counter()
        action = policy.act(env, observation, mask)
        now = time.perf_counter()
        decisions.append(now - asked)
        first = first or now - began
        observation, reward, ended, _, info = env.step(action)
        actions.append(int(action))
        total, failed = total + reward, failed + info["grasp_failed"]
        # A simulated step that fails ends the episode too.
        if not (info["grasp_failed"] or info["invalid_action"] or info.get("failure")):
            states.append(env.state)
    return Episode(
        tuple(actions), tuple(decisions), first, total, tuple(states), failed, start, info
    )


def _row(
    env: MlivrEnv,
    episode: Episode,
    execute: Callable[[MlivrEnv, tuple[State, ...]], bool | None] | None,
) -> tuple[float, ...]:
    """Return the results of an episode in the order of `Evaluation`."""
    answer = execute(env, episode.states) if episode.success and execute is not None else None
    steps, end = len(episode.actions), episode.end
    return (
        episode.success,
        steps,
        float(end["base_translation"]),
        episode.first_decision,
        sum(episode.decisions) / max(steps, 1),
        episode.failed_grasps,
        math.nan if answer is None else float(answer),
        episode.start.get("optimal_cost", math.nan),
        end.get("regret", math.nan),
    )


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
