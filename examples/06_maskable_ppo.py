"""Train with MaskablePPO of sb3-contrib, as in its documentation (extra [agents]).

The program trains for one task on a part of the module, so that results appear within a minute.
For policies that solve any task use `mlivr-gym train`.
"""

import gymnasium
import numpy as np
import torch
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.evaluation import evaluate_policy
from sb3_contrib.common.maskable.utils import get_action_masks

import mlivr_gym
from mlivr_gym import jem_map
from mlivr_gym.envs import Task

START, GOAL, STEPS = ("D2a:4", "D2b:4"), (2.4, 0.6, 0.0), 16_000


class OneTask:
    """Task generator that always returns the same task; it needs only the method `draw`."""

    def draw(self, graph, rng, tolerance, start=None):
        """Return the task from the deck to the aft wall."""
        return Task(graph.state(START), np.array(GOAL))


torch.set_num_threads(1)  # small networks are slower with more threads
points = jem_map()
near = points.subset((points.positions[:, 0] > 1.0) & (points.positions[:, 0] < 3.5), "two racks")
print(mlivr_gym.__version__, near)
env = gymnasium.make("MLIVR-JEM-v0", map=near, tasks=OneTask(), shaping=True, max_episode_steps=40)
env.unwrapped.table_moves()  # computes all steps at once, of which training needs most

model = MaskablePPO("MultiInputPolicy", env, n_steps=512, gamma=0.99, seed=0, device="cpu")
for steps in (0, STEPS):
    if steps:
        model.learn(steps)
    _, lengths = evaluate_policy(
        model, env, n_eval_episodes=10, deterministic=False, return_episode_rewards=True, warn=False
    )
    print(f"after {steps} steps of training: {np.mean(lengths):.1f} steps an episode")

observation, info = env.reset(seed=1)
over = False
while not over:
    masks = get_action_masks(env)
    action, _ = model.predict(observation, action_masks=masks, deterministic=False)
    observation, reward, terminated, truncated, info = env.step(action)
    over = terminated or truncated
print("reached" if info["is_success"] else "not reached", "after", info["steps"], "steps")
