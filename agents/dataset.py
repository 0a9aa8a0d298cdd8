"""Data sets of expert episodes in the format of Minari, with action masks in the observations."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import PurePosixPath
from typing import Any

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
    if episodes < 1:
        raise SettingError(f"episodes is {episodes!r}; it must be at least 1")
    _check_id(dataset_id)
    collector, expert = _make_collector(dataset_id, env_arguments or {}), ExpertPolicy()
    for k in range(episodes):
        _collect_episode(collector, expert, seed + k)
        if progress is not None:
            progress(k + 1)
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


def _make_collector(dataset_id: str, env_arguments: dict[str, Any]) -> Any:
    """Return a `minari.DataCollector` around a new environment that observes action masks."""
    import minari

    masked = ActionMaskObservation(gymnasium.make("mlivr_gym:MLIVR-JEM-v0", **env_arguments))
    try:
        return minari.DataCollector(masked, record_infos=False)
    except OSError as error:
        raise SettingError(f"data set {dataset_id!r} cannot be written: {error}") from None


def _collect_episode(collector: Any, expert: ExpertPolicy, seed: int) -> None:
    """Record one episode of the expert."""
    env = collector.unwrapped
    assert isinstance(env, MlivrEnv)
    observation, _ = collector.reset(seed=seed)
    done = False
    while not done:
        action = expert.act(env, observation, env.action_masks())
        observation, _, terminated, truncated, _ = collector.step(np.int64(action))
        done = terminated or truncated


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
