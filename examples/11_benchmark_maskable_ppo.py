"""A policy of the benchmark with MaskablePPO of sb3-contrib (extra [agents])."""

import gymnasium
import numpy as np
import torch
from sb3_contrib import MaskablePPO

from mlivr_gym.extensions.benchmark import TrainingEnv

SEEN = ("grasps", "base_position", "base_quaternion", "goal", "branches", "occupied", "unknown")


class Shaped(gymnasium.Wrapper):
    """Adds to the reward the discounted approach to the goal, which changes no optimal policy."""

    def reset(self, **options):
        """Start an episode."""
        observation, info = self.env.reset(**options)
        self.away = np.linalg.norm(observation["base_position"] - observation["goal"])
        return observation, info

    def step(self, action):
        """Take an action."""
        observation, reward, *ends, info = self.env.step(action)
        before = self.away
        self.away = np.linalg.norm(observation["base_position"] - observation["goal"])
        return observation, reward + 3.0 * (before - 0.99 * self.away), *ends, info


class MaskedPPO:
    """Learns by trial and error until the budget is spent."""

    def train(self, env, seed):
        """Learn in a `TrainingEnv`."""
        torch.set_num_threads(1)  # small networks are slower with more threads
        self.seen = [key for key in SEEN if key in env.observation_space.spaces]
        shown = gymnasium.wrappers.FilterObservation(Shaped(env), self.seen)
        settings = {"n_steps": 1000, "batch_size": 250, "n_epochs": 5, "ent_coef": 0.005}
        self.model = MaskablePPO("MultiInputPolicy", shown, seed=seed, device="cpu", **settings)
        self.model.learn(env.budget)

    def act(self, env, observation, mask):
        """Return an action drawn from the policy, which a loop of the most probable ones is not."""
        seen = {key: observation[key] for key in self.seen}
        return int(self.model.predict(seen, action_masks=mask, deterministic=False)[0])


if __name__ == "__main__":
    env = gymnasium.make("mlivr_gym:MLIVR-JEM-v0", disable_env_checker=True).unwrapped
    MaskedPPO().train(TrainingEnv(env, 3000), seed=0)
