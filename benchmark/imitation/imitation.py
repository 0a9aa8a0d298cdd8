"""DAgger with the package's training, in two limbs on the known map, whatever the task is then."""

from functools import cache

import torch

from mlivr_gym.agents import train
from mlivr_gym.agents.hyperparameters import load_hyperparameters
from mlivr_gym.envs import MlivrEnv
from mlivr_gym.extensions.closed_loop import LookingPolicy, UnknownMapEnv


@cache
def learned(seed):
    """Return the pointer policy of a seed, and the environment steps that it learned from.

    Each state of a rollout is labelled by the expert and left by a step, so it counts twice.
    """
    torch.set_num_threads(1)
    given = load_hyperparameters("dagger")
    given["imitation"] |= {"rollouts": 16}
    counts = {}

    def note(phase, done, total, figures):
        counts["states"] = int(figures["states"])

    policy = train("dagger", seed=seed, env=MlivrEnv(), hyperparameters=given, progress=note)
    return policy, 2 * counts["states"]


class Imitation:
    """Learns in `MLIVR-JEM-v0` for every environment; in the unknown map it looks before grasps."""

    def train(self, env, seed):
        """Learn from the expert, by the steps and labels of an environment of its own."""
        self.policy, self.environment_steps = learned(seed)
        self.looking = LookingPolicy(self.policy)

    def act(self, env, observation, mask):
        """Return the most probable action that leads to a stance not held before."""
        if isinstance(env, UnknownMapEnv):
            return self.looking.act(env, observation, mask)
        steps = env.graph.limbs * len(env.graph.grasp_map)
        return self.policy.act(env, observation, mask[:steps])
