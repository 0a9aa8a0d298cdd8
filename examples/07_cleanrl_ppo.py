"""Train with masked PPO in a single file, in the style of CleanRL, on the vector environment.

The program trains for one task on a part of the module, so that results appear within a minute.
"""

import gymnasium
import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical

import mlivr_gym  # registers the environment
from mlivr_gym import jem_map
from mlivr_gym.envs import Task

COPIES, LENGTH, UPDATES, EPOCHS, BATCH = 64, 32, 60, 4, 512
GAMMA, LAMBDA, CLIP, ENTROPY, RATE = 0.99, 0.95, 0.2, 0.01, 1e-3

START, GOAL = ("D2a:4", "D2b:4"), (2.4, 0.6, 0.0)


class OneTask:
    """Task generator that always returns the same task; it needs only the method `draw`."""

    def draw(self, graph, rng, tolerance, start=None):
        """Return the task from the deck to the aft wall."""
        return Task(graph.state(START), np.array(GOAL))


torch.manual_seed(0)
torch.set_num_threads(1)
points = jem_map()
near = points.subset((points.positions[:, 0] > 1.0) & (points.positions[:, 0] < 3.5), "two racks")
envs = gymnasium.make_vec(
    "MLIVR-JEM-v0", num_envs=COPIES, map=near, tasks=OneTask(), shaping=True, max_episode_steps=40
)
KEYS = ("grasps", "base_position", "base_quaternion", "goal", "branches")
print(mlivr_gym.__version__, near)


def flat(observation, info):
    """Return observation and mask as tensors."""
    parts = [np.asarray(observation[key], dtype=np.float32) for key in KEYS]
    state = torch.from_numpy(np.concatenate(parts, axis=1))
    return state, torch.from_numpy(np.asarray(info["action_mask"], dtype=bool))


state, mask = flat(*envs.reset(seed=0))
actions = envs.single_action_space.n
trunk = nn.Sequential(nn.Linear(state.shape[1], 128), nn.Tanh(), nn.Linear(128, 128), nn.Tanh())
policy, value = nn.Linear(128, actions), nn.Linear(128, 1)
weights = [*trunk.parameters(), *policy.parameters(), *value.parameters()]
optimiser = torch.optim.Adam(weights, RATE)


def act(state, mask):
    """Return the distribution over the valid actions, and the value."""
    hidden = trunk(state)
    scores = policy(hidden).masked_fill(~mask, -1e9)
    return Categorical(logits=scores), value(hidden).squeeze(-1)


counted, ended = 0, 0
for update in range(UPDATES):
    kept, over = [], np.zeros(COPIES, dtype=bool)
    for _ in range(LENGTH):
        with torch.no_grad():
            chances, worth = act(state, mask)
            action = chances.sample()
        observation, reward, terminated, truncated, info = envs.step(action.numpy())
        live = torch.from_numpy(~over)  # the step after the end of an episode resets it
        over = terminated | truncated
        end = torch.from_numpy(over).float()
        gain = torch.from_numpy(np.asarray(reward, dtype=np.float32))
        kept.append((state, mask, action, chances.log_prob(action), worth, gain, end, live))
        state, mask = flat(observation, info)
    rows = map(torch.stack, zip(*kept, strict=True))
    states, masks, taken, logs, worths, gains, ends, lives = rows
    with torch.no_grad():
        after = torch.cat([worths[1:], act(state, mask)[1][None]])
    advantage, last = torch.zeros_like(gains), torch.zeros(COPIES)
    for t in reversed(range(LENGTH)):
        surprise = gains[t] + GAMMA * after[t] * (1 - ends[t]) - worths[t]
        last = advantage[t] = surprise + GAMMA * LAMBDA * (1 - ends[t]) * last
    use = lives.flatten().nonzero().squeeze(-1)
    states, masks, taken, logs, advantage, worths = (
        x.flatten(0, 1)[use] for x in (states, masks, taken, logs, advantage, worths)
    )
    returns = advantage + worths
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(use)).split(BATCH):
            chances, worth = act(states[rows], masks[rows])
            ratio = (chances.log_prob(taken[rows]) - logs[rows]).exp()
            gained = torch.min(
                ratio * advantage[rows], ratio.clamp(1 - CLIP, 1 + CLIP) * advantage[rows]
            )
            loss = (worth - returns[rows]).pow(2).mean() - gained.mean()
            loss = loss - ENTROPY * chances.entropy().mean()
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(weights, 0.5)
            optimiser.step()
    counted, ended = counted + int(lives.sum()), ended + int(ends.sum())
    if (update + 1) % 10 == 0:
        print(f"update {update + 1}: {counted / max(ended, 1):.1f} steps an episode")
        counted, ended = 0, 0
