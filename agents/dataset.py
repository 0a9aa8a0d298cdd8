"""Planner episodes as a Minari data set, with action masks in the observations."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

from mlivr_gym import __version__
from mlivr_gym.agents.policies import ExpertPolicy
from mlivr_gym.env import ActionMaskObservation, MlivrEnv
from mlivr_gym.errors import SettingError


def write_dataset(
    dataset_id: str,
    episodes: int,
    seed: int = 0,
    env_arguments: dict[str, Any] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Any:
    """Write episodes of the optimal expert; episode k starts from `reset(seed=seed + k)`.

    The data set rebuilds its environment: `minari.load_dataset(id).recover_environment()`.

    Args:
        dataset_id: Id, for example `"mlivr/jem/astar-v0"`.
        episodes: Number of episodes.
        seed: Seed of the first episode.
        env_arguments: Arguments of `MlivrEnv`.
        progress: Called with the number of episodes done.

    Returns:
        The `minari.MinariDataset`.

    Raises:
        SettingError: If there is no episode, or there is a data set of that id already.
    """
    import minari

    if episodes < 1:
        raise SettingError(f"episodes is {episodes!r}; it must be at least 1")
    if dataset_id in minari.list_local_datasets():
        raise SettingError(f"there is a data set {dataset_id!r} already; delete it with minari.delete_dataset")
    masked = ActionMaskObservation(gymnasium.make("mlivr_gym:MLIVR-JEM-v0", **(env_arguments or {})))
    env = masked.unwrapped
    assert isinstance(env, MlivrEnv)
    expert = ExpertPolicy()
    collector = minari.DataCollector(masked, record_infos=False)
    for k in range(episodes):
        observation, _ = collector.reset(seed=seed + k)
        done = False
        while not done:
            action = expert.act(env, observation, env.action_masks())
            observation, _, terminated, truncated, _ = collector.step(np.int64(action))
            done = terminated or truncated
        if progress is not None:
            progress(k + 1)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*is set to None")  # author and link are the user's to add
        # Minari leaves its temporary folders to the garbage collector.
        warnings.filterwarnings("ignore", message="Implicitly cleaning up", category=ResourceWarning)
        dataset = collector.create_dataset(
            dataset_id=dataset_id,
            algorithm_name="optimal expert (exact cost-to-go: the costs of A*)",
            description="Optimal walks of a two-limb robot through the Japanese Experiment Module, with action masks.",
            requirements=[f"mlivr-gym=={__version__}"],
        )
        collector.close()
        del collector
    return dataset
