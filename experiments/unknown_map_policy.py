"""Train the correction of expected costs on `MLIVR-JEM-Unknown-v0`, by an expert that sees all.

    python experiments/unknown_map_policy.py [--rounds 2] [--states 12000] [--updates 1500]

The expert knows the layout, the policy (`unknown_map.CorrectedPolicy`) what the robot knows. Each
state is labelled with what each action costs more than the best one, looks included, for a robot
that then acts as the expert does; the network learns to keep the expected value of that small
(aggregated values: Ross and Bagnell 2014; clairvoyant oracles: Choudhury et al., The International
Journal of Robotics Research 37, 2018). Expected costs take each unknown point to be occupied with
the same probability; the network can learn that occupied points lie in clusters. In the first round
the steps of least expected cost are taken, in others those of the policy. `--workers` processes
gather the states, and `--device` takes the gradient steps. Writes the checkpoint
`runs/unknown_map`.
"""

from __future__ import annotations

import multiprocessing
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from reports import CORES, command_line
from tqdm import tqdm
from unknown_map import (
    MOST_REGRET,
    TRAINED,
    CorrectedPolicy,
    above_least,
    made_env,
    scores,
)

from mlivr_gym.agents import ExpertPolicy, LookingPolicy
from mlivr_gym.agents.features import env_features
from mlivr_gym.agents.hyperparameters import load_hyperparameters
from mlivr_gym.agents.learned import load_policy, made_for, save_policy
from mlivr_gym.agents.networks import logits_and_value, make_actor_critic
from mlivr_gym.agents.policies import cost_of
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.envs.unknown_map import UnknownMapEnv
from mlivr_gym.planners.table_values import TableValues, in_goal_region
from mlivr_gym.stances.moves import TableMoves
from mlivr_gym.stances.step_tables import step_tables, without_points

BATCH, LEARNING_RATE, MOST_ACTIONS = 512, 1e-3, 30

PART = 50
"""States that a process gathers at a time."""


class Samples(NamedTuple):
    """States that were visited: `k` of them, of a robot with N limbs on m points."""

    points: NDArray[np.float16]
    """Features, see `agents.features.point_features`."""
    limbs: NDArray[np.float16]
    goal: NDArray[np.float16]
    valid: BoolArray
    """Which actions are valid, shape (k, N m)."""
    planned: NDArray[np.float16]
    """Expected cost of each action above the least one, shape (k, N m)."""
    regrets: NDArray[np.float16]
    """What each valid action costs more than the best one, shape (k, N m)."""


class Clairvoyant:
    """The expert that knows the layout of the episode."""

    def __init__(self, env: UnknownMapEnv) -> None:
        """Compute the steps without occupied points."""
        env.graph.vacate()
        self.env, self.free = env, TableMoves(env.graph, step_tables(env.graph))

    def begin(self, layout: frozenset[int]) -> None:
        """Compute the costs of an episode."""
        env = self.env
        self.occupied = np.zeros(len(env.seen), dtype=np.bool_)
        self.occupied[list(layout)] = True
        tables = without_points(self.free.tables, self.occupied)
        goals = in_goal_region(tables, env.goal[None], env.goal_tolerance)
        self.values = TableValues(tables, goals, cost_of(env))

    def regrets(self) -> Array | None:
        """Return what each action costs more than the best one in the present state, shape (N m,).

        It is None if no action leads to the goal. A point that was not seen is looked at before it
        is grasped, if it is in sight; else the attempt fails if it is occupied.
        """
        env, state, none = self.env, self.env.state, np.zeros(1, dtype=np.int64)
        s = np.array([self.free.stance_at[state.stance]], dtype=np.int64)
        count, limbs = len(env.seen), len(state.stance)
        sets = np.array([state.branch_sets])
        costs = self.values.of_actions(s, sets, none, limbs * count)[0].reshape(limbs, count)
        if not np.isfinite(costs.min()):
            return None
        looks = np.zeros(count, dtype=np.bool_)
        looks[env.in_sight()] = True
        looks &= ~env.seen
        found = costs - costs.min() + np.where(looks, env.look_cost, 0.0)
        found[:, self.occupied] = np.where(looks, env.look_cost, 1.0)[self.occupied]
        return np.minimum(found, MOST_REGRET).ravel()


@cache
def expert() -> Clairvoyant:
    """Return the expert of this process."""
    torch.set_num_threads(1)
    return Clairvoyant(made_env())


def gathered(job: tuple[str, int]) -> Samples:
    """Return `PART` states that a policy visits from the episode of a seed on.

    The policy is that of a checkpoint, or, without one, takes the steps of least expected cost.
    """
    path, seed = job
    env, knowing, found = made_env(), expert(), []
    steps = CorrectedPolicy(load_policy(path, env).actor_critic) if path else ExpertPolicy()
    policy = LookingPolicy(steps)
    expecting = steps.expert if isinstance(steps, CorrectedPolicy) else steps
    while len(found) < PART:
        observation, info = env.reset(seed=seed)
        knowing.begin(env.layout)
        seed, ended = seed + 1, False
        while not ended and info["steps"] < MOST_ACTIONS and len(found) < PART:
            mask = env.action_masks()
            action = policy.act(env, observation, mask)
            regrets = knowing.regrets()
            if action < len(mask) - 1 and regrets is not None:
                seen = {k: v[0].astype(np.float16) for k, v in env_features(env).items()}
                planned, labels = (
                    np.where(mask[:-1], costs, 0.0).astype(np.float16)
                    for costs in (above_least(expecting.costs(env)), regrets)
                )
                found.append(Samples(**seen, valid=mask[:-1], planned=planned, regrets=labels))
            observation, _, ended, _, info = env.step(action)
    return Samples(*map(np.stack, zip(*found, strict=True)))


def expected_regret(actor_critic: Any, batch: list[torch.Tensor]) -> torch.Tensor:
    """Return the mean regret of the actions that an actor-critic draws, shape ()."""
    points, limbs, goal, valid, planned, regrets = batch
    seen = {"points": points.float(), "limbs": limbs.float(), "goal": goal.float()}
    found = scores(logits_and_value(actor_critic, seen)[0], planned.float())
    chances = torch.softmax(found.masked_fill(~valid, -torch.inf), dim=1)
    return (chances * regrets.float()).sum(dim=1).mean()


def learn(actor_critic: Any, data: list[torch.Tensor], updates: int) -> float:
    """Take the gradient steps of a round; return the mean expected regret of the last tenth."""
    optimizer = torch.optim.Adam(actor_critic.parameters(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, updates)
    losses = []
    with tqdm(range(updates), desc="updates", mininterval=5.0) as bar:
        for _ in bar:
            chosen = torch.randint(len(data[0]), (BATCH,), device=data[0].device)
            loss = expected_regret(actor_critic, [part[chosen] for part in data])
            optimizer.zero_grad()
            torch.autograd.backward(loss)
            torch.nn.utils.clip_grad_norm_(actor_critic.parameters(), 1.0)
            optimizer.step()
            schedule.step()
            losses.append(loss.detach())
    return float(torch.stack(losses[-max(updates // 10, 1) :]).mean())


def main() -> None:
    """Train the policy."""
    device = "cuda" if torch.cuda.is_available() else "cpu"
    options = {"rounds": 2, "states": 12_000, "updates": 1500, "workers": CORES, "device": device}
    given = command_line(__doc__, None, **options).parse_args()
    torch.manual_seed(0)
    env, sizes = made_env(), load_hyperparameters("dagger")["networks"]["pointer"]
    actor_critic = make_actor_critic(env, "pointer", sizes)
    config = {"network": "pointer", "sizes": sizes, **made_for(env, "pointer")}
    TRAINED.parent.mkdir(exist_ok=True)
    samples, acting = list[Samples](), ""
    with multiprocessing.get_context("spawn").Pool(given.workers) as pool:
        for k in range(given.rounds):
            seeds = range(1_000_000 * k, 1_000_000 * (k + 1), 1000)[: -(-given.states // PART)]
            jobs = pool.imap(gathered, [(acting, seed) for seed in seeds])
            samples += tqdm(jobs, total=len(seeds), desc=f"{PART} states", mininterval=5.0)
            whole = Samples(*map(np.concatenate, zip(*samples, strict=True)))
            data = [torch.as_tensor(part, device=given.device) for part in whole]
            regret = learn(actor_critic.to(given.device), data, given.updates)
            print(f"{len(data[0])} states, expected regret {regret:.4f}", flush=True)
            acting, training = str(TRAINED), {"states": len(data[0]), "updates": given.updates}
            save_policy(acting, actor_critic.to("cpu"), config | {"training": training})


if __name__ == "__main__":
    main()
