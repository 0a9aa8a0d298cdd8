"""Train the pointer policy on `MLIVR-JEM-Unknown-v0`, by imitation of an expert that sees all.

    python experiments/unknown_map_policy.py [--rounds 4] [--states 3000] [--updates 2000]

The expert knows the layout, the policy what the robot knows, so that it learns the actions that are
optimal most often given what was seen (imitation of clairvoyant oracles: Choudhury et al., The
International Journal of Robotics Research 37, 2018). It starts from the policy that ships, looks
before it grasps an unknown point, and acts itself in all rounds but the first (DAgger: Ross, Gordon
and Bagnell 2011), in which A* acts. Writes the checkpoint `runs/unknown_map`; takes ten minutes.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm
from unknown_map import TRAINED, TRAINING, made_env

from mlivr_gym.agents import LookingPolicy
from mlivr_gym.agents.features import env_features
from mlivr_gym.agents.imitation import optimal_set_loss
from mlivr_gym.agents.learned import LearnedPolicy, load_policy, save_policy
from mlivr_gym.agents.networks import as_tensors, logits_and_value
from mlivr_gym.agents.policies import cost_of
from mlivr_gym.agents.policy_names import policy_by_name
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs.unknown_map import UnknownMapEnv
from mlivr_gym.planners.table_values import TableValues, in_goal_region
from mlivr_gym.stances.moves import TableMoves
from mlivr_gym.stances.step_tables import step_tables, without_points

BATCH, LEARNING_RATE, MOST_ACTIONS = 128, 5e-4, 30

Sample = tuple[dict[str, NDArray[Any]], BoolArray, BoolArray]
"""Features of a state, and which of its actions are valid and optimal, shape (2 m,) each."""


class Clairvoyant:
    """The expert that knows the layout of the episode."""

    def __init__(self, env: UnknownMapEnv) -> None:
        """Compute the steps without occupied points."""
        env.graph.vacate()
        self.env, self.free = env, TableMoves(env.graph, step_tables(env.graph))

    def begin(self, layout: frozenset[int]) -> None:
        """Compute the costs of an episode."""
        env, taken = self.env, np.zeros(len(self.env.seen), dtype=np.bool_)
        taken[list(layout)] = True
        tables = without_points(self.free.tables, taken)
        goals = in_goal_region(tables, env.goal[None], env.goal_tolerance)
        self.values = TableValues(tables, goals, cost_of(env))

    def optimal(self) -> BoolArray:
        """Return which actions are optimal in the present state, shape (2 m,)."""
        state, none = self.env.state, np.zeros(1, dtype=np.int64)
        s = np.array([self.free.stance_at[state.stance]], dtype=np.int64)
        sets = np.array([state.branch_sets])
        costs = self.values.of_actions(s, sets, none, 2 * len(self.env.seen))[0]
        found: BoolArray = np.isfinite(costs) & (costs <= costs.min() + 1e-6)
        return found


def gathered(expert: Clairvoyant, policy: LookingPolicy, count: int, seed: int) -> list[Sample]:
    """Return the states that a policy visits in new episodes, labelled by the expert."""
    env, samples = expert.env, list[Sample]()
    with tqdm(total=count, desc="states", mininterval=5.0) as bar:
        while len(samples) < count:
            observation, info = env.reset(seed=seed)
            expert.begin(env.layout)
            seed, ended = seed + 1, False
            while not ended and info["steps"] < MOST_ACTIONS and len(samples) < count:
                mask = env.action_masks()
                action, best = policy.act(env, observation, mask), expert.optimal()
                if action < len(mask) - 1 and best.any():
                    seen = {k: v[0].astype(np.float16) for k, v in env_features(env).items()}
                    samples.append((seen, mask[:-1], best))
                    bar.update()
                observation, _, ended, _, info = env.step(action)
    return samples


def learn(policy: LearnedPolicy, samples: list[Sample], updates: int, number: int) -> None:
    """Take the gradient steps of a round, by its number from 0, on all samples."""
    actor_critic, rng = policy.actor_critic, np.random.default_rng(number)
    rate = LEARNING_RATE * 0.5**number
    optimizer = torch.optim.Adam(actor_critic.parameters(), lr=rate)
    with tqdm(range(updates), desc="updates", mininterval=5.0) as bar:
        for _ in bar:
            chosen = [samples[k] for k in rng.integers(len(samples), size=BATCH)]
            names = chosen[0][0]
            batch = {n: np.stack([c[0][n] for c in chosen]).astype(np.float32) for n in names}
            valid, best = (torch.as_tensor(np.stack([c[k] for c in chosen])) for k in (1, 2))
            logits, _ = logits_and_value(actor_critic, as_tensors(actor_critic, batch))
            loss = optimal_set_loss(logits, valid, best)
            optimizer.zero_grad()
            torch.autograd.backward(loss)
            torch.nn.utils.clip_grad_norm_(actor_critic.parameters(), 1.0)
            optimizer.step()
            bar.set_postfix(loss=f"{loss.item():.3f}")


def main() -> None:
    """Train the policy."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, default in TRAINING.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args()
    env = made_env()
    policy, samples = load_policy("pretrained", env), list[Sample]()
    config = {**policy.config, "method": "clairvoyant imitation", "init": "pretrained"}
    expert = Clairvoyant(env)
    for k in range(given.rounds):
        acting = policy if k else policy_by_name("astar", env)
        samples += gathered(expert, LookingPolicy(acting), given.states, 1_000_000 * k)
        learn(policy, samples, given.updates, k)
        save_policy(TRAINED, policy.actor_critic, config)


if __name__ == "__main__":
    main()
