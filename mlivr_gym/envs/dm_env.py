"""The environment with the interface of `dm_env` (extra `[dm]`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from mlivr_gym.arguments import SEED, InstanceOf, checked
from mlivr_gym.envs.arguments import EPISODE_STEPS
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.wrappers import ActionMaskObservation
from mlivr_gym.schema import OrNone

try:
    import dm_env
    from dm_env import specs
except ModuleNotFoundError:
    raise ModuleNotFoundError(
        "this needs the package 'dm_env': pip install 'mlivr-gym[dm]'", name="dm_env"
    ) from None


class MlivrDmEnvironment(dm_env.Environment):  # type: ignore[misc]
    """`MlivrEnv` as a `dm_env.Environment`, with the action mask in the observation.

    The discount is 0 when an episode terminates, because the goal is reached or a step failed, and
    1 otherwise, at the step limit too.

    Examples
    --------
    >>> environment = MlivrDmEnvironment(MlivrEnv(), seed=0)
    >>> timestep = environment.reset()
    >>> action = np.flatnonzero(timestep.observation["action_mask"])[0]
    >>> timestep = environment.step(action)
    """

    @checked(
        {"env": InstanceOf(MlivrEnv), "seed": OrNone(SEED), "max_episode_steps": EPISODE_STEPS}
    )
    def __init__(
        self, env: MlivrEnv, seed: int | None = None, max_episode_steps: int = 100
    ) -> None:
        """Wrap an environment, with a seed of the tasks, and a number of steps of an episode."""
        self.env, self._seed, self._limit = env, seed, max_episode_steps
        self._masked, self._ended = ActionMaskObservation(env), True
        self.info: dict[str, Any] = {}
        """Information that `MlivrEnv` returned with the last step."""

    def reset(self) -> dm_env.TimeStep:
        """Start an episode."""
        observation, self.info = self._masked.reset(seed=self._seed)
        self._seed, self._ended = None, False
        return dm_env.restart(observation)

    def step(self, action: int | NDArray[Any]) -> dm_env.TimeStep:
        """Take an action; before the first episode and after the end of one, start an episode."""
        if self._ended:
            return self.reset()
        observation, reward, terminated, _, self.info = self._masked.step(action)
        truncated = self.info["steps"] >= self._limit
        self._ended = terminated or truncated
        if terminated:
            return dm_env.termination(reward, observation)
        if truncated:
            return dm_env.truncation(reward, observation)
        return dm_env.transition(reward, observation)

    def observation_spec(self) -> dict[str, specs.Array]:
        """Return the spec of each entry of the observation."""
        entries = self._masked.observation_space
        assert isinstance(entries, spaces.Dict)
        return {name: _spec(name, space) for name, space in entries.spaces.items()}

    def action_spec(self) -> specs.DiscreteArray:
        """Return the spec of an action, the integer `limb * m + point`."""
        space = self.env.action_space
        assert isinstance(space, spaces.Discrete)
        return specs.DiscreteArray(int(space.n), dtype=np.int64, name="action")

    def close(self) -> None:
        """Release the window or GL context."""
        self.env.close()


def _spec(name: str, space: Any) -> specs.Array:
    """Return the `dm_env` spec of a Gymnasium space."""
    if isinstance(space, spaces.MultiDiscrete):
        return specs.BoundedArray(space.shape, np.int64, 0, space.nvec - 1, name)
    if isinstance(space, spaces.MultiBinary):
        return specs.BoundedArray(space.shape, np.int8, 0, 1, name)
    return specs.BoundedArray(space.shape, space.dtype, space.low, space.high, name)
