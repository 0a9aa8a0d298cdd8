"""A policy of the benchmark in CleanRL's style: REINFORCE in one file of PyTorch ([agents])."""

import gymnasium
import numpy as np
import torch
from torch.distributions import Categorical
from torch.nn import Linear, Sequential, Tanh

from mlivr_gym.extensions.benchmark import TrainingEnv

SEEN = ("grasps", "base_position", "base_quaternion", "goal", "branches", "occupied", "unknown")


class Reinforce:
    """Learns by the gradient of the policy (Williams 1992): from episodes better than usual."""

    def train(self, env, seed):
        """Learn in a `TrainingEnv`."""
        torch.manual_seed(seed)
        torch.set_num_threads(1)  # small networks are slower with more threads
        observation, _ = env.reset(seed=seed)
        width = sum(len(observation[key]) for key in SEEN if key in observation)
        self.net = Sequential(Linear(width, 128), Tanh(), Linear(128, env.action_space.n))
        optimiser, usual = torch.optim.Adam(self.net.parameters(), 1e-3), -60.0
        while env.environment_steps < env.budget:
            logs, rewards, over = [], [], False
            while not over and env.environment_steps < env.budget:
                choices = self.choices(observation, env.action_masks())
                action = choices.sample()
                observation, reward, ended, truncated, _ = env.step(int(action))
                logs.append(choices.log_prob(action))
                rewards.append(reward)
                over = ended or truncated
            gain, usual = sum(rewards) - usual, usual + 0.05 * (sum(rewards) - usual)
            optimiser.zero_grad()
            (-gain * torch.stack(logs).mean()).backward()
            optimiser.step()
            observation, _ = env.reset()

    def choices(self, observation, mask):
        """Return the distribution of the next action."""
        seen = np.concatenate([observation[key] for key in SEEN if key in observation])
        logits = self.net(torch.as_tensor(seen, dtype=torch.float32))
        masked = logits.masked_fill(~torch.as_tensor(mask), -1e9)
        return Categorical(logits=masked, validate_args=False)

    def act(self, env, observation, mask):
        """Return an action drawn from the policy, which a loop of the most probable ones is not."""
        return int(self.choices(observation, mask).sample())


if __name__ == "__main__":
    env = gymnasium.make("mlivr_gym:MLIVR-JEM-v0", disable_env_checker=True).unwrapped
    Reinforce().train(TrainingEnv(env, 3000), seed=0)
