"""Episodes of the expert with action masks in the observations, and data sets of them for Minari.

`lerobot_dataset` writes the same episodes for LeRobot.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import PurePosixPath
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from mlivr_gym import __version__
from mlivr_gym.agents.policies import ExpertPolicy
from mlivr_gym.arguments import SEED, checked
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.wrappers import ActionMaskObservation
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.extras import require
from mlivr_gym.schema import Anything, Integer
from mlivr_gym.settings import GRAPH_RULES, check_rules

REQUIRED_PACKAGES = ("minari", "h5py", "jax")
"""Packages of the extra [data]: Minari, its file format, and what it stacks episodes with."""

EXAMPLE_ID = "mlivr/jem/expert-v0"
"""Id of a data set, as an example in messages."""

RULES_KEY = "graph_rules"
"""Metadata key of the number of the stance graph's rules."""

DESCRIPTION = (
    "Episodes of the expert with a two-limb robot that climbs hand over hand, with action masks."
)
"""Description in the metadata of every data set."""


@checked({"dataset_id": Anything(), "episodes": Integer(1, 10**9), "seed": SEED})
def write_dataset(
    dataset_id: str,
    episodes: int,
    seed: int = 0,
    env_arguments: dict[str, Any] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Any:
    """Write episodes of the expert; episode k starts from `reset(seed=seed + k)`.

    The expert is an `ExpertPolicy`. `env_arguments` are those of `MLIVR-JEM-v0`, whose episodes are
    truncated after 100 steps; `progress` is called with the number of finished episodes. Returned
    is the `minari.MinariDataset`, which can rebuild its environment:
    `load_dataset(id).recover_environment()`.

    Raises a `SettingError` if `episodes` is below 1, the id is not valid for Minari (as
    `"mlivr/jem/expert-v0"` is) or exists already, or the extra [data] is not installed; all this is
    checked before the first episode.
    """
    require(*REQUIRED_PACKAGES, extra="data")
    import minari

    _check_id(dataset_id)
    env = expert_env(env_arguments)
    try:
        collector = minari.DataCollector(env, record_infos=False)
    except OSError as error:
        raise SettingError(f"data set {dataset_id!r} cannot be written: {error}") from None
    for _ in expert_episodes(collector, episodes, seed, progress):
        pass  # the collector records them
    with warnings.catch_warnings():
        # Authors and links are the user's to add; the temporary folder belongs to the collector.
        for message in (".*is set to None", "Implicitly cleaning up"):
            warnings.filterwarnings("ignore", message=message)
        dataset = collector.create_dataset(
            dataset_id=dataset_id,
            algorithm_name="expert (optimal by the exact cost-to-go)",
            description=DESCRIPTION,
            requirements=[f"mlivr-gym=={__version__}"],
        )
        dataset.storage.update_metadata({RULES_KEY: GRAPH_RULES})
        collector.close()
        del collector
    return dataset


class ExpertEpisode(NamedTuple):
    """An episode of k steps."""

    observations: list[dict[str, Any]]
    """What was seen before each step and at the end, k + 1 observations with action masks."""
    actions: list[int]
    """The actions, k numbers."""
    rewards: list[float]
    """The rewards, k numbers."""
    pictures: list[Any]
    """What the environment looked like before each step, if it renders; otherwise empty."""


def expert_env(env_arguments: dict[str, Any] | None) -> gymnasium.Env[Any, Any]:
    """Return a new `MLIVR-JEM-v0` that observes action masks, with arguments of its own."""
    return ActionMaskObservation(gymnasium.make("mlivr_gym:MLIVR-JEM-v0", **env_arguments or {}))


def expert_episodes(
    env: gymnasium.Env[Any, Any],
    episodes: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> Iterator[ExpertEpisode]:
    """Yield episodes of the expert in a `MlivrEnv` within wrappers; see `write_dataset`."""
    inner, expert = env.unwrapped, ExpertPolicy()
    assert isinstance(inner, MlivrEnv)
    for k in range(episodes):
        observation, _ = env.reset(seed=seed + k)
        made, ended = ExpertEpisode([observation], [], [], []), False
        while not ended:
            if inner.render_mode is not None:
                made.pictures.append(env.render())
            action = expert.act(inner, observation, inner.action_masks())
            observation, reward, terminated, truncated, _ = env.step(np.int64(action))
            ended = terminated or truncated
            made.observations.append(observation)
            made.actions.append(action)
            made.rewards.append(float(reward))
        yield made
        if progress is not None:
            progress(k + 1)


@checked()
def load_dataset(dataset_id: str) -> Any:
    """Return a data set that `write_dataset` wrote, a `minari.MinariDataset`.

    Raises a `SettingError` if no data set has this id, its episodes were made by other rules of the
    stance graph, or the extra [data] is not installed.
    """
    require(*REQUIRED_PACKAGES, extra="data")
    import minari

    try:
        dataset = minari.load_dataset(dataset_id)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SettingError(f"cannot load data set {dataset_id!r}: {error}") from None
    found = dataset.storage.metadata.get(RULES_KEY)
    check_rules(
        f"data set {dataset_id!r}", found, "write it again with write_dataset", SettingError
    )
    return dataset


def _check_id(dataset_id: str) -> None:
    """Check that an id is valid for Minari and not in use, before any episode is collected."""
    from minari.dataset.minari_dataset import parse_dataset_id
    from minari.storage.datasets_root_dir import get_dataset_path

    fault = "it must be names of letters, digits, - and _, joined by /, with a version at the end"
    with suppress(ValueError, TypeError):
        parse_dataset_id(dataset_id)
        fault = "" if PurePosixPath(dataset_id).as_posix() == dataset_id else "it has an empty part"
    if fault:
        raise SettingError(
            f"data set id {shortened(dataset_id)} is not valid: {fault}, for example {EXAMPLE_ID!r}"
        )
    try:
        get_dataset_path(dataset_id).lstat()
    except FileNotFoundError:
        return
    except OSError as error:
        raise SettingError(f"data set {dataset_id!r} cannot be written: {error}") from None
    raise SettingError(
        f"data set {dataset_id!r} exists already; choose another id, or delete it with "
        "minari.delete_dataset"
    )
