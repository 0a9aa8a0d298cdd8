"""A policy of the benchmark in CleanRL's style: masked PPO in plain PyTorch (extra [agents])."""

import gymnasium
import numpy as np
import torch
from torch.distributions import Categorical
from torch.nn import Linear, Sequential, Tanh

from mlivr_gym.extensions.benchmark import TrainingEnv

SEEN = ("grasps", "base_position", "base_quaternion", "goal", "branches", "occupied", "unknown")
ROLLOUT, BATCH, EPOCHS, GAMMA, CLIP, ENTROPY, RATE = 1000, 250, 5, 0.99, 0.2, 0.005, 5e-4


class PlainPPO:
    """Learns by trial and error until the budget is spent."""

    def train(self, env, seed):
        """Learn in a `TrainingEnv`."""
        torch.manual_seed(seed)
        torch.set_num_threads(1)  # small networks are slower with more threads
        state, width = flat(env.reset(seed=seed)[0]), 128
        layers = Linear(len(state), width), Tanh(), Linear(width, width), Tanh()
        self.net = Sequential(*layers, Linear(width, env.action_space.n + 1))
        optimiser = torch.optim.Adam(self.net.parameters(), RATE)
        for _ in range(env.budget // ROLLOUT):
            kept = []
            for _ in range(ROLLOUT):
                mask = torch.as_tensor(env.action_masks())
                action, log, worth, _ = self.choice(state, mask)
                observation, reward, ended, truncated, _ = env.step(int(action))
                kept.append((state, mask, action, log, worth, reward, ended, ended or truncated))
                state = flat(env.reset()[0] if ended or truncated else observation)
            columns = [
                torch.stack([torch.as_tensor(x) for x in c]) for c in zip(*kept, strict=True)
            ]
            learn(self, optimiser, columns, self.choice(state, mask)[2])

    def choice(self, state, mask, action=None):
        """Return an action, its logarithmic probability, the value, and the entropy."""
        with torch.set_grad_enabled(action is not None):
            out = self.net(state)
        chances = Categorical(logits=out[..., :-1].masked_fill(~mask, -1e9), validate_args=False)
        action = chances.sample() if action is None else action
        return action, chances.log_prob(action), out[..., -1], chances.entropy()

    def act(self, env, observation, mask):
        """Return an action drawn from the policy, which a loop of the most probable ones is not."""
        return int(self.choice(flat(observation), torch.as_tensor(mask))[0])


def flat(observation):
    """Return what the network sees of an observation."""
    parts = [observation[key] for key in SEEN if key in observation]
    return torch.as_tensor(np.concatenate(parts), dtype=torch.float32)


def learn(policy, optimiser, columns, worth):
    """Take the gradient steps of one rollout; `worth` is the value of the state after it."""
    states, masks, actions, logs, worths, rewards, ends, breaks = columns
    returns = torch.zeros(len(rewards))
    for t in reversed(range(len(rewards))):
        # An episode that is cut off goes on with the value of its last state.
        after = worths[t] if breaks[t] else worth
        worth = returns[t] = rewards[t] + GAMMA * after * ~ends[t]
    gains = returns - worths
    gains = (gains - gains.mean()) / (gains.std() + 1e-8)
    for rows in (r for _ in range(EPOCHS) for r in torch.randperm(len(gains)).split(BATCH)):
        _, log, value, entropy = policy.choice(states[rows], masks[rows], actions[rows])
        ratio, gain = (log - logs[rows]).exp(), gains[rows]
        chosen = torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
        loss = 0.5 * (value - returns[rows]).square().mean() - chosen - ENTROPY * entropy.mean()
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(policy.net.parameters(), 0.5)
        optimiser.step()


if __name__ == "__main__":
    env = gymnasium.make("mlivr_gym:MLIVR-JEM-v0", disable_env_checker=True).unwrapped
    PlainPPO().train(TrainingEnv(env, 3000), seed=0)
