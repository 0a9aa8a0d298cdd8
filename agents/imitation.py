"""Imitation of the expert: behaviour cloning and DAgger with sets of optimal actions.

The expert is a table of the cost-to-go from every state to a goal, which one backward search
computes. It labels each state with the set of its optimal actions, of which there are often
several. The loss is minus the logarithm of the summed probability of this set.

Training goes in rounds. In each round states are gathered by rollouts, labelled by the expert and
added to those of the rounds before; then gradient steps follow on all of them. With behaviour
cloning the expert acts in all rounds, by a random one of the optimal actions. With DAgger (Ross et
al., 2011) the actor-critic acts after the first round, by its most probable action, even if this
leads back to a stance, which a `LearnedPolicy` avoids. A share of the actions is random in both, so
that states beside the expert's path occur too (Laskey et al., 2017). In most layouts points are
removed, so that the policy learns to act on maps that it has not seen.

The value head learns minus the cost-to-go: for the reward `"steps"` the discounted return `-(1 -
discount^n) / (1 - discount)` of n further steps, for `"base"` the undiscounted sum of base
displacements [m]. Success bonus and shaping are not part of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mlivr_gym.agents.features import TableFeatures, point_lookahead
from mlivr_gym.agents.hyperparameters import ImitationHyperparameters
from mlivr_gym.agents.networks import as_tensors, logits_and_value
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.envs.batch import ActionResults, SubEnvStates, TaskDistribution, advance, draw_tasks
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import ObservationArrays, ObservationTable
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.tasks import WalkTasks, draw_task
from mlivr_gym.errors import StanceError
from mlivr_gym.planners.table_values import TableValues, in_goal_region
from mlivr_gym.stances.step_tables import StepTables, without_points

MIN_GOAL_DISTANCE = 0.01
"""Minimum distance of a training goal from every held-out goal [m]."""


class Samples(NamedTuple):
    """k states that rollouts visited, with the labels of the expert."""

    stances: NDArray[Any]
    """Stance indices, shape (k,)."""
    branch_sets: NDArray[Any]
    """Branch sets of both limbs, shape (k, 2)."""
    goals: NDArray[Any]
    """Goal positions [m], shape (k, 3)."""
    goal_index: NDArray[Any]
    """Index of the goal among all goals of all layouts, shape (k,)."""
    free: NDArray[Any]
    """Whether each point may be grasped, as packed bits, shape (k, ceil(m / 8))."""
    optimal: NDArray[Any]
    """Whether each action is optimal, as packed bits, shape (k, ceil(2 m / 8))."""
    cost: NDArray[Any]
    """Cost-to-go, in steps or [m] by the reward of the environment, shape (k,)."""


class _Layout(NamedTuple):
    """A subset of the points of the map, with goals on it."""

    free: BoolArray
    """Whether each point belongs to the layout, shape (m,)."""
    goals: Array
    """Goal positions [m], shape (g, 3)."""
    values: TableValues
    """Cost-to-go to these goals."""
    first_goal: int
    """Index of the first of these goals among all goals of all layouts."""


def optimal_set_loss(logits: Tensor, valid: Tensor, optimal: Tensor) -> Tensor:
    """Return minus the mean logarithm of the summed probability of the optimal actions.

    Logits of the actions, whether each is valid, and whether it is optimal, as at least one in each
    row is, have shape (k, a).
    """
    best = logits.masked_fill(~optimal, -torch.inf).logsumexp(dim=1)
    every = logits.masked_fill(~valid, -torch.inf).logsumexp(dim=1)
    return (every - best).mean()


class Imitation:
    """Training of an actor-critic of sb3-contrib to imitate the expert.

    `data` are the samples of all rounds so far.
    """

    def __init__(
        self,
        env: MlivrEnv,
        actor_critic: Any,
        plain_observation: bool,
        hyperparameters: ImitationHyperparameters,
        seed: int,
        held_out: Array | None = None,
    ) -> None:
        """Compute all steps of the environment, or read them from the cache.

        The environment has two limbs and the reward `"steps"` or `"base"`; its `tasks` draw the
        goals. Starts are drawn among all stances from which the goal can be reached. The
        actor-critic is changed in place; with `plain_observation` it takes the observations of the
        environment itself, not `point_features`. `seed` is that of layouts, goals, rollouts and
        batches, and `held_out` are goals that must not be learned from [m], shape (g, 3). Raises a
        `SettingError` if the robot has more than two limbs.
        """
        self.env, self.actor_critic, self.hyperparameters = env, actor_critic, hyperparameters
        self.plain_observation = plain_observation
        self.moves = env.table_moves()
        self._observation_table = ObservationTable.of(self.moves.graph)
        self.features = TableFeatures(env)
        self.rng = np.random.default_rng(seed)
        self.m = len(env.graph.grasp_map)
        self._held_out = np.zeros((0, 3)) if held_out is None else held_out
        self.data: list[Samples] = []
        self._lookahead: list[NDArray[np.float32]] = []
        parameters = list(actor_critic.parameters())
        self._optimizer = torch.optim.Adam(parameters, lr=hyperparameters.learning_rate)
        self._average = [parameter.detach().clone() for parameter in parameters]
        self._streams = self.rng.integers(2**63, size=hyperparameters.goals).astype(np.uint64)

    def run(self, progress: Callable[[int, int, dict[str, float]], None] | None = None) -> None:
        """Gather data and learn from them, in all rounds.

        At the end the weights are the exponential moving average over all gradient steps.
        `progress` is called with the number of gradient steps done, their total number, and figures
        by name: `loss`, `value_error`, `states` gathered so far, `gathering_seconds` of the round,
        and `rollout_success`, the share of its rollouts that reached their goal. Raises a
        `MlivrError` if the reward is an object of the user, no task is found, or no goal can be
        reached.
        """
        given = self.hyperparameters
        for k in range(given.rounds):
            began, by_expert = time.perf_counter(), k == 0 or not given.dagger
            counts = np.zeros(2, dtype=np.int64)
            for layout in range(given.layouts):
                samples, counted = self.gather(self._layout(layout), by_expert)
                self.data.append(samples)
                counts += counted
            figures = {
                "gathering_seconds": time.perf_counter() - began,
                "rollout_success": float(counts[1] / max(counts[0], 1)),
                "states": float(sum(len(samples.stances) for samples in self.data)),
            }
            if not figures["states"]:
                raise StanceError(
                    "imitation has no state to learn from: no walk leads to a goal of the tasks"
                )
            self._learn(k, figures, progress)
        with torch.no_grad():
            parameters = self.actor_critic.parameters()
            for parameter, average in zip(parameters, self._average, strict=True):
                parameter.copy_(average)

    def _layout(self, number: int) -> BoolArray:
        """Return whether each point belongs to a layout, shape (m,), by the layout's number."""
        free = np.ones(self.m, dtype=np.bool_)
        if number % 3:
            share = self.rng.uniform(0.0, self.hyperparameters.most_removed)
            free[self.rng.permutation(self.m)[: int(share * self.m)]] = False
        return free

    def gather(self, free: BoolArray, by_expert: bool) -> tuple[Samples, IntArray]:
        """Return the states that rollouts visit on one layout, labelled by the expert.

        With them come the number of rollouts and of those that reached their goal. `free` is
        whether each point belongs to the layout, shape (m,). The expert acts, or the actor-critic
        takes its most probable action.
        """
        tables = without_points(self.moves.tables, ~free)
        goals, env = self._draw_goals(tables), self.env
        if not len(goals):
            return _no_samples(self.m), np.zeros(2, dtype=np.int64)
        cost, risk = env.reward.cost, env.failure_probability
        values = TableValues(tables, in_goal_region(tables, goals, env.goal_tolerance), cost, risk)
        goal_index, stances = self._draw_starts(values)
        layout = _Layout(free, goals, values, sum(map(len, self._lookahead)))
        held = (tables.branch_sets != 0).all(axis=1)
        graph, tolerance = self.moves.graph, env.goal_tolerance
        lookahead = [point_lookahead(graph, goal, tolerance, held) for goal in goals]
        self._lookahead.append(np.array(lookahead, dtype=np.float32))
        streams = self.rng.integers(2**63, size=len(stances)).astype(np.uint64)
        states = SubEnvStates(stances, tables.branch_sets[stances].astype(np.int64), streams)
        rows, count = [_no_samples(self.m)], len(stances)
        for _ in range(self.hyperparameters.max_rollout_steps):
            if not len(states.stances):
                break
            here, solvable, optimal = self._label_states(states, goal_index, layout)
            rows.append(here)
            chosen = optimal if by_expert else self._policy_actions(here)
            self._step(states, solvable, chosen, tables)
            going = ~values.is_goal[goal_index, states.stances]
            states = SubEnvStates._make(part[going] for part in states)
            goal_index = goal_index[going]
        samples = Samples(*(np.concatenate(column) for column in zip(*rows, strict=True)))
        known, reached = np.isfinite(samples.cost), count - len(goal_index)
        return Samples(*(column[known] for column in samples)), np.array([count, reached])

    def _draw_goals(self, tables: StepTables) -> Array:
        """Return goals that the environment's tasks draw, without held-out ones [m], (g, 3).

        A `WalkTasks` draws them on the layout, a user's generator on the whole map.
        """
        env, count = self.env, self.hyperparameters.goals
        goals, tolerance = np.zeros((count, 3)), env.goal_tolerance
        if isinstance(env.tasks, WalkTasks):
            every, zeros = np.ones(count, dtype=np.bool_), np.zeros((count, 2), dtype=np.int64)
            distribution = TaskDistribution.of(env.graph.grasp_map, tolerance, env.tasks)
            states = SubEnvStates(zeros[:, 0].copy(), zeros, self._streams)
            if draw_tasks(every, ~every, distribution, tables, states, goals) >= 0:
                return np.zeros((0, 3))
        else:
            for k in range(count):
                stream = Stream(int(self._streams[k]))
                goals[k] = draw_task(env.tasks, env.graph, stream, tolerance).goal
                self._streams[k] = stream.state
        apart = np.linalg.norm(goals[:, None] - self._held_out, axis=2)
        away = apart.min(axis=1, initial=np.inf)
        allowed: Array = goals[away > MIN_GOAL_DISTANCE]
        return allowed

    def _label_states(
        self, states: SubEnvStates, goal_index: IntArray, layout: _Layout
    ) -> tuple[Samples, BoolArray, BoolArray]:
        """Return k states, labelled with their optimal actions and costs.

        Two arrays of shape (k, 2 m) tell whether the goal can be reached after each action, and
        whether each action is optimal.
        """
        costs = layout.values.of_actions(states.stances, states.branch_sets, goal_index, 2 * self.m)
        least, solvable = costs.min(axis=1), np.isfinite(costs)
        optimal = solvable & (costs <= least[:, None] + 1e-6)
        samples = Samples(
            states.stances.copy(),
            states.branch_sets.copy(),
            layout.goals[goal_index],
            layout.first_goal + goal_index,
            np.tile(np.packbits(layout.free), (len(states.stances), 1)),
            np.packbits(optimal, axis=1),
            least.astype(np.float32),
        )
        return samples, solvable, optimal

    def _step(
        self, states: SubEnvStates, solvable: BoolArray, chosen: BoolArray, tables: StepTables
    ) -> None:
        """Take a chosen action in each state, or with probability `noise` any solvable one."""
        rng, count = self.rng, len(states.stances)
        noisy = rng.random(count) < self.hyperparameters.noise
        likely = np.where(noisy[:, None], solvable, chosen)
        actions = (rng.random(likely.shape, dtype=np.float32) * likely).argmax(axis=1)
        skip, risk = np.zeros(count, np.bool_), self.env.failure_probability
        advance(actions, skip, risk, tables, states, ActionResults.of(count))

    def _draw_starts(self, values: TableValues) -> tuple[IntArray, IntArray]:
        """Return goal indices, and starts from which the goal can be reached but is not yet."""
        goal_index, stances = [], []
        for g in range(len(values.is_goal)):
            cost = values.of_stances(g)
            far = np.flatnonzero(np.isfinite(cost) & ~values.is_goal[g])
            if len(far):
                chosen = self.rng.choice(far, self.hyperparameters.rollouts)
                goal_index.append(np.full(len(chosen), g))
                stances.append(chosen)
        nothing = np.zeros(0, dtype=np.int64)
        return np.concatenate([nothing, *goal_index]), np.concatenate([nothing, *stances])

    def _policy_actions(self, samples: Samples) -> BoolArray:
        """Return the most probable action of the actor-critic in each state, shape (k, 2 m)."""
        chosen = np.zeros((len(samples.stances), 2 * self.m), dtype=np.bool_)
        for at in range(0, len(chosen), 512):
            part = Samples(*(column[at : at + 512] for column in samples))
            observation, valid = self.observe(part)
            with torch.no_grad():
                logits, _ = logits_and_value(self.actor_critic, observation)
            best = logits.masked_fill(~valid, -torch.inf).argmax(dim=1).numpy()
            chosen[at + np.arange(len(best)), best] = True
        return chosen

    def observe(self, samples: Samples) -> tuple[dict[str, Tensor], Tensor]:
        """Return the observations of the actor-critic, and which actions are valid, (k, 2 m)."""
        free = np.unpackbits(samples.free, axis=1, count=self.m).view(np.bool_)
        if len(self._lookahead) > 1:
            self._lookahead = [np.concatenate(self._lookahead)]
        lookahead = self._lookahead[0][samples.goal_index].astype(np.float64)
        seen = self.features(
            self.moves.tables, samples.stances, samples.branch_sets, samples.goals, lookahead, free
        )
        valid = torch.as_tensor(seen["limbs"][..., 1].reshape(len(free), -1) > 0.5)
        if self.plain_observation:
            arrays = ObservationArrays.of(
                self._observation_table, samples.stances, samples.branch_sets, samples.goals
            )
            return as_tensors(self.actor_critic, arrays.observation()), valid
        return as_tensors(self.actor_critic, seen), valid

    def _learn(
        self,
        number: int,
        figures: dict[str, float],
        progress: Callable[[int, int, dict[str, float]], None] | None,
    ) -> None:
        """Take the gradient steps of round `number` (from 0) on all data gathered so far."""
        given = self.hyperparameters
        data = Samples(*(np.concatenate(column) for column in zip(*self.data, strict=True)))
        self.data = [data]
        total = given.rounds * given.updates
        for k in range(given.updates):
            done = number * given.updates + k
            for group in self._optimizer.param_groups:
                group["lr"] = given.learning_rate * (0.55 + 0.45 * np.cos(np.pi * done / total))
            chosen = self.rng.integers(len(data.stances), size=given.batch)
            batch = Samples(*(column[chosen] for column in data))
            observation, valid = self.observe(batch)
            bits = np.unpackbits(batch.optimal, axis=1, count=2 * self.m)
            optimal = torch.as_tensor(bits.view(np.bool_))
            logits, value = logits_and_value(self.actor_critic, observation)
            loss = optimal_set_loss(logits, valid, optimal)
            cost = torch.as_tensor(batch.cost)
            if self.env.reward.cost.name == "steps" and given.discount < 1.0:
                # minus the discounted return of this many steps
                cost = (1.0 - given.discount**cost) / (1.0 - given.discount)
            error = (value + cost).square().mean()
            self._optimizer.zero_grad()
            torch.autograd.backward(loss + given.value_weight * error)
            torch.nn.utils.clip_grad_norm_(self.actor_critic.parameters(), 1.0)
            self._optimizer.step()
            with torch.no_grad():
                # A smaller decay at first, so that the initial weights are soon forgotten.
                decay = min(given.averaging, (1.0 + done) / (10.0 + done))
                for average, parameter in zip(
                    self._average, self.actor_critic.parameters(), strict=True
                ):
                    average.lerp_(parameter, 1.0 - decay)
            losses = {"loss": loss.item(), "value_error": error.item()}
            if progress is not None:
                progress(done + 1, total, figures | losses)


def _no_samples(m: int) -> Samples:
    """Return samples without states, for a map of m points."""
    whole = np.zeros(0, dtype=np.int64)
    free, optimal = (np.zeros((0, -(-size // 8)), dtype=np.uint8) for size in (m, 2 * m))
    branch_sets, goals = np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3))
    return Samples(whole, branch_sets, goals, whole, free, optimal, np.zeros(0, dtype=np.float32))
