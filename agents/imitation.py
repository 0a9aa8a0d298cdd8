"""Imitation of the planner: behaviour cloning and DAgger (Ross et al., 2011) on sets of actions.

The expert is a table of the cost-to-go from every state to a goal, which one backward search
computes. It has the cost of all actions. Several actions are often optimal, so the loss is minus
the logarithm of the summed probability of all optimal actions. Points are removed at random, layout
by layout, so that the policy learns to act on maps that it has not seen.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mlivr_gym.agents.features import TableFeatures, reach_of_points
from mlivr_gym.agents.hyperparameters import ImitationSettings
from mlivr_gym.agents.networks import as_tensors, scores_and_value
from mlivr_gym.agents.policies import cost_of
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.envs.batch import ActionResults, CopyStates, TaskDistribution, advance, draw_tasks
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import ObservationArrays, ObservationTable
from mlivr_gym.envs.rewards import StepReward
from mlivr_gym.envs.tasks import WalkTasks
from mlivr_gym.planners.table_values import TableValues, stances_at
from mlivr_gym.stances.step_tables import StepTables, without_points

MIN_GOAL_DISTANCE = 0.01
"""Minimum distance of a training goal from every held-out goal [m]."""


class Samples(NamedTuple):
    """States that were visited on walks, with their optimal actions and costs."""

    stances: NDArray[Any]
    """Stance indices, shape (k,)."""
    branch_sets: NDArray[Any]
    """Branch sets of both limbs, shape (k, 2)."""
    goals: NDArray[Any]
    """Goal positions [m], shape (k, 3)."""
    which: NDArray[Any]
    """Index of the goal among those for which `Imitation` stores the reach, shape (k,)."""
    free: NDArray[Any]
    """Whether each point may be grasped, as packed bits, shape (k, ceil(m / 8))."""
    optimal: NDArray[Any]
    """Whether each action is optimal, as packed bits, shape (k, ceil(2 m / 8))."""
    cost: NDArray[Any]
    """Cost-to-go, shape (k,)."""


class _Layout(NamedTuple):
    """A subset of the points of the map, with goals on it."""

    free: BoolArray
    """Whether each point belongs to the layout, shape (m,)."""
    goals: Array
    """Goal positions [m], shape (g, 3)."""
    values: TableValues
    """Cost-to-go to these goals."""
    first: int
    """Index of the first of these goals among the goals of all layouts."""


def optimal_set_loss(scores: Tensor, legal: Tensor, optimal: Tensor) -> Tensor:
    """Return minus the mean logarithm of the summed probability of the optimal actions.

    Parameters
    ----------
    scores
        Scores (logits) of the actions, shape (k, a).
    legal
        Whether each action is possible, shape (k, a).
    optimal
        Whether each action is optimal, at least one in each row, shape (k, a).
    """
    best = scores.masked_fill(~optimal, -torch.inf).logsumexp(dim=1)
    every = scores.masked_fill(~legal, -torch.inf).logsumexp(dim=1)
    return (every - best).mean()


class Imitation:
    """Training of a policy to imitate the planner.

    Attributes
    ----------
    policy
        Policy of sb3-contrib that is trained.
    settings
        Hyperparameters.
    success
        Share of the policy's walks in the last round that reached their goal.
    """

    def __init__(
        self,
        env: MlivrEnv,
        policy: Any,
        plain: bool,
        settings: ImitationSettings,
        seed: int,
        held_out: Array | None = None,
    ) -> None:
        """Compute all steps of the environment, or read them from the cache.

        Parameters
        ----------
        env
            The environment, with two limbs.
        policy
            The policy, which is changed in place.
        plain
            Whether the policy takes the observations of the environment itself.
        settings
            Hyperparameters.
        seed
            Seed of layouts, goals, walks and batches.
        held_out
            Goals that must not be learned from [m], shape (g, 3).
        """
        self.env, self.policy, self.plain, self.settings = env, policy, plain, settings
        self.moves = env.table_moves()
        self._observation_table = ObservationTable.of(self.moves.graph)
        self.features = TableFeatures(env)
        self.rng = np.random.default_rng(seed)
        self.m = len(env.graph.grasp_map)
        self._held_out = np.zeros((0, 3)) if held_out is None else held_out
        self.data: list[Samples] = []
        self._reach: list[NDArray[np.float32]] = []
        self.success = 0.0
        self._optimizer = torch.optim.Adam(policy.parameters(), lr=settings.learning_rate)
        self._average = [parameter.detach().clone() for parameter in policy.parameters()]
        self._streams = self.rng.integers(2**63, size=settings.goals).astype(np.uint64)

    def run(self, progress: Callable[[int, int, dict[str, float]], None] | None = None) -> None:
        """Gather data and learn from them, in all rounds.

        Parameters
        ----------
        progress
            Function that is called with the number of gradient steps done, their total number, and
            figures by name.
        """
        for k in range(self.settings.rounds):
            began = time.perf_counter()
            expert = k == 0 or not self.settings.dagger
            success = []
            for layout in range(self.settings.layouts):
                samples, reached = self.gather(self._layout(layout), expert)
                self.data.append(samples)
                success.append(reached)
            if not expert:
                self.success = float(np.mean(success))
            figures = {
                "gathered_in": time.perf_counter() - began,
                "walks_that_arrive": float(np.mean(success)),
            }
            figures["states"] = float(sum(len(d.stances) for d in self.data))
            self._learn(k, figures, progress)
        with torch.no_grad():
            for parameter, average in zip(self.policy.parameters(), self._average, strict=True):
                parameter.copy_(average)

    def _layout(self, number: int) -> BoolArray:
        """Return whether each point belongs to a layout, shape (m,), by the layout's number."""
        free = np.ones(self.m, dtype=np.bool_)
        if number % 3:
            share = self.rng.uniform(0.0, self.settings.most_removed)
            free[self.rng.permutation(self.m)[: int(share * self.m)]] = False
        return free

    def gather(self, free: BoolArray, expert: bool) -> tuple[Samples, float]:
        """Return the states of walks on one layout, and the share of walks that arrive."""
        tables = without_points(self.moves.tables, ~free)
        goals = self._draw_goals(tables)
        if not len(goals):
            return _no_samples(self.m), 1.0
        env = self.env
        cost, risk = cost_of(env), env.failure_probability
        values = TableValues(tables, stances_at(tables, goals, env.goal_tolerance), cost, risk)
        which, stances = self._draw_starts(values)
        layout = _Layout(free, goals, values, sum(map(len, self._reach)))
        held = (tables.branch_sets != 0).all(axis=1)
        graph, tolerance = self.moves.graph, env.goal_tolerance
        reach = [reach_of_points(graph, goal, tolerance, held) for goal in goals]
        self._reach.append(np.array(reach, dtype=np.float32))
        streams = self.rng.integers(2**63, size=len(stances)).astype(np.uint64)
        walks = CopyStates(stances, tables.branch_sets[stances].astype(np.int64), streams)
        rows, count = [_no_samples(self.m)], len(stances)
        for _ in range(self.settings.longest):
            if not len(walks.stances):
                break
            here, legal, optimal = self._label_states(walks, which, layout)
            rows.append(here)
            self._step(walks, legal, optimal if expert else self._policy_actions(here), tables)
            going = ~values.goals[which, walks.stances]
            walks, which = CopyStates._make(part[going] for part in walks), which[going]
        samples = Samples(*(np.concatenate(column) for column in zip(*rows, strict=True)))
        known, walking = np.isfinite(samples.cost), len(which)
        return Samples(*(column[known] for column in samples)), 1.0 - walking / max(count, 1)

    def _draw_goals(self, tables: StepTables) -> Array:
        """Return goals that can be reached on a layout and are not held out [m], shape (g, 3)."""
        env, count = self.env, self.settings.goals
        goals = np.zeros((count, 3))
        stances, branch_sets = np.zeros(count, dtype=np.int64), np.zeros((count, 2), dtype=np.int64)
        every, grasp_map = np.ones(count, dtype=np.bool_), env.graph.grasp_map
        tasks = env.tasks if isinstance(env.tasks, WalkTasks) else WalkTasks()
        distribution = TaskDistribution.of(grasp_map, env.goal_tolerance, tasks)
        copies = CopyStates(stances, branch_sets, self._streams)
        missing = draw_tasks(every, ~every, distribution, tables, copies, goals)
        if missing >= 0:
            return np.zeros((0, 3))
        if not len(self._held_out):
            return goals
        away = np.linalg.norm(goals[:, None] - self._held_out, axis=2).min(axis=1)
        allowed: Array = goals[away > MIN_GOAL_DISTANCE]
        return allowed

    def _label_states(
        self, walks: CopyStates, which: IntArray, layout: _Layout
    ) -> tuple[Samples, BoolArray, BoolArray]:
        """Return the states of k walks, labelled with their optimal actions and costs.

        Returns
        -------
        tuple[Samples, BoolArray, BoolArray]
            The samples, and whether each action is possible and optimal, both of shape (k, 2 m).
        """
        costs = layout.values.of_actions(walks.stances, walks.branch_sets, which, 2 * self.m)
        least = costs.min(axis=1)
        legal = np.isfinite(costs)
        optimal = legal & (costs <= least[:, None] + 1e-6)
        samples = Samples(
            walks.stances.copy(),
            walks.branch_sets.copy(),
            layout.goals[which],
            layout.first + which,
            np.tile(np.packbits(layout.free), (len(walks.stances), 1)),
            np.packbits(optimal, axis=1),
            least.astype(np.float32),
        )
        return samples, legal, optimal

    def _step(
        self, walks: CopyStates, legal: BoolArray, preferred: BoolArray, tables: StepTables
    ) -> None:
        """Take a preferred action on each walk, or with probability `noise` any possible one."""
        rng, count = self.rng, len(walks.stances)
        noisy = rng.random(count) < self.settings.noise
        likely = np.where(noisy[:, None], legal, preferred)
        actions = (rng.random(likely.shape, dtype=np.float32) * likely).argmax(axis=1)
        skip, risk = np.zeros(count, np.bool_), self.env.failure_probability
        advance(actions, skip, risk, tables, walks, ActionResults.of(count))

    def _draw_starts(self, values: TableValues) -> tuple[IntArray, IntArray]:
        """Return goals and start stances of walks; each goal can be reached, and is not yet."""
        which, stances = [], []
        for g in range(len(values.goals)):
            cost = values.of_stances(g)
            far = np.flatnonzero(np.isfinite(cost) & ~values.goals[g])
            if len(far):
                chosen = self.rng.choice(far, self.settings.walks)
                which.append(np.full(len(chosen), g))
                stances.append(chosen)
        nothing = [np.zeros(0, dtype=np.int64)]
        return np.concatenate(which or nothing), np.concatenate(stances or nothing).astype(np.int64)

    def _policy_actions(self, samples: Samples) -> BoolArray:
        """Return the action with the best score of the policy in each state, shape (k, 2 m)."""
        chosen = np.zeros((len(samples.stances), 2 * self.m), dtype=np.bool_)
        for at in range(0, len(chosen), 512):
            part = Samples(*(column[at : at + 512] for column in samples))
            observation, legal = self.observe(part)
            with torch.no_grad():
                scores, _ = scores_and_value(self.policy, observation)
            best = scores.masked_fill(~legal, -torch.inf).argmax(dim=1).numpy()
            chosen[at + np.arange(len(best)), best] = True
        return chosen

    def observe(self, samples: Samples) -> tuple[dict[str, Tensor], Tensor]:
        """Return the observations of the policy, and which actions are possible, shape (k, 2 m)."""
        free = np.unpackbits(samples.free, axis=1, count=self.m).view(np.bool_)
        if len(self._reach) > 1:
            self._reach = [np.concatenate(self._reach)]
        reach = self._reach[0][samples.which].astype(np.float64)
        seen = self.features(
            self.moves.tables, samples.stances, samples.branch_sets, samples.goals, reach, free
        )
        legal = torch.as_tensor(seen["limbs"][..., 1].reshape(len(free), -1) > 0.5)
        if self.plain:
            arrays = ObservationArrays.of(
                self._observation_table, samples.stances, samples.branch_sets, samples.goals
            )
            return as_tensors(self.policy, arrays.observation()), legal
        return as_tensors(self.policy, seen), legal

    def _learn(
        self,
        number: int,
        figures: dict[str, float],
        progress: Callable[[int, int, dict[str, float]], None] | None,
    ) -> None:
        """Take the gradient steps of round `number` (from 0) on all data gathered so far."""
        settings = self.settings
        data = Samples(*(np.concatenate(column) for column in zip(*self.data, strict=True)))
        self.data = [data]
        total = settings.rounds * settings.updates
        for k in range(settings.updates):
            done = number * settings.updates + k
            for group in self._optimizer.param_groups:
                group["lr"] = settings.learning_rate * (0.55 + 0.45 * np.cos(np.pi * done / total))
            chosen = self.rng.integers(len(data.stances), size=settings.batch)
            batch = Samples(*(column[chosen] for column in data))
            observation, legal = self.observe(batch)
            optimal = torch.as_tensor(
                np.unpackbits(batch.optimal, axis=1, count=2 * self.m).astype(bool)
            )
            scores, value = scores_and_value(self.policy, observation)
            loss = optimal_set_loss(scores, legal, optimal)
            cost = torch.as_tensor(batch.cost)
            if isinstance(self.env.reward.reward, StepReward):
                # the discounted sum of the rewards of this many steps
                cost = (1.0 - settings.discount**cost) / (1.0 - settings.discount)
            error = (value + cost).square().mean()
            self._optimizer.zero_grad()
            torch.autograd.backward(loss + settings.value_weight * error)
            torch.nn.utils.clip_grad_norm_(self.policy.parameters(), 1.0)
            self._optimizer.step()
            with torch.no_grad():
                # A smaller decay at first, so that the initial weights are soon forgotten.
                decay = min(settings.averaging, (1.0 + done) / (10.0 + done))
                for average, parameter in zip(self._average, self.policy.parameters(), strict=True):
                    average.lerp_(parameter, 1.0 - decay)
            if progress is not None:
                progress(
                    done + 1, total, figures | {"loss": loss.item(), "value_error": error.item()}
                )


def _no_samples(m: int) -> Samples:
    """Return samples without states, for a map of m points."""
    whole = np.zeros(0, dtype=np.int64)
    free, optimal = (np.zeros((0, -(-size // 8)), dtype=np.uint8) for size in (m, 2 * m))
    branch_sets, goals = np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3))
    return Samples(whole, branch_sets, goals, whole, free, optimal, np.zeros(0, dtype=np.float32))
