"""Write episodes of the expert as a Minari data set, and read them (extra [data]).

Minari stores data sets in `~/.minari`, or in the folder that `MINARI_DATASETS_PATH` names.
"""

import minari
import numpy as np

from mlivr_gym import jem_map
from mlivr_gym.agents import load_dataset, write_dataset

NAME = "mlivr/example/expert-v0"

if NAME in minari.list_local_datasets():
    minari.delete_dataset(NAME)
points = jem_map()
near = points.subset((points.positions[:, 0] > 1.0) & (points.positions[:, 0] < 3.5), "two racks")
write_dataset(NAME, episodes=20, env_arguments={"map": near})

dataset = load_dataset(NAME)  # `minari.load_dataset` with a check of the graph rules
print(f"{dataset.total_episodes} episodes, {dataset.total_steps} steps")
for episode in dataset.sample_episodes(3):
    masks = episode.observations["action_mask"]
    print(
        f"episode {episode.id}: {len(episode.actions)} steps, return {episode.rewards.sum():.0f}, "
        f"{np.mean(masks.sum(axis=1)):.0f} valid actions on average"
    )

env = dataset.recover_environment()  # the environment in which the walks were made
print(env.spec.id, env.observation_space["action_mask"])
minari.delete_dataset(NAME)
