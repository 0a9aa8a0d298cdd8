"""The vector environment as a `VecEnv` of stable-baselines3, with action masks."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from mlivr_gym.agents.features import DEPTH, TableFeatures, point_lookahead, point_space
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.errors import SettingError, choice
from mlivr_gym.sharing import Independent

OBSERVATIONS = ("points", "plain")
"""Names of the observations: `point_features`, or those of the environment itself."""


class TableVecEnv(Independent, VecEnv):
    """`MlivrVectorEnv` as a `VecEnv` of stable-baselines3, with two limbs.

    Points that are occupied in the environment's graph are not grasped. `MaskablePPO` finds the
    action masks by `env_method`.

    Examples
    --------
    >>> from sb3_contrib import MaskablePPO
    >>> envs = TableVecEnv(MlivrEnv(), num_envs=4, observation="plain")
    >>> model = MaskablePPO("MultiInputPolicy", envs, n_steps=8, batch_size=16, device="cpu")
    >>> model.learn(32).num_timesteps
    32
    """

    def __init__(
        self,
        env: MlivrEnv,
        num_envs: int,
        observation: str = "points",
        max_episode_steps: int = 100,
    ) -> None:
        """Make sub-environments with world, rewards and tasks of an unwrapped environment.

        The observation is one of `OBSERVATIONS`. Episodes are truncated after `max_episode_steps`.
        """
        self.plain = choice("observation", observation, OBSERVATIONS) == "plain"
        self.vector_env = MlivrVectorEnv(num_envs, max_episode_steps, AutoresetMode.DISABLED, env)
        self.features = TableFeatures(env)
        self._info: dict[str, Any] = {}
        self._return = np.zeros(num_envs)
        self._goals = np.full((num_envs, 3), np.nan)
        self._lookahead = np.zeros((num_envs, 2, len(env.graph.grasp_map), 2 * DEPTH))
        space = env.observation_space if self.plain else point_space(env)
        super().__init__(num_envs, space, env.action_space)

    def _observe(self, plain: Observation) -> dict[str, NDArray[Any]]:
        """Return the observations of all sub-environments for the policy."""
        if self.plain:
            return dict[str, Any](**plain)
        batch = self.vector_env
        graph = batch.env.graph
        free = np.ones(len(self.features.grasp_map), dtype=np.bool_)
        free[list(graph.occupied)] = False
        for k in np.flatnonzero((self._goals != batch.goals).any(axis=1)):
            self._goals[k] = batch.goals[k]
            self._lookahead[k] = point_lookahead(graph, batch.goals[k], batch.env.goal_tolerance)
        where = batch.tables, batch.stances, batch.branch_sets, batch.goals
        return dict(self.features(*where, self._lookahead, free))

    def reset(self) -> dict[str, NDArray[Any]]:
        """Reset all sub-environments and return their observations."""
        seed = self._seeds[0]
        plain, self._info = self.vector_env.reset(seed=None if seed is None else int(seed))
        self._reset_seeds()
        self._reset_options()
        self._return[:] = 0.0
        return self._observe(plain)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions for `step_wait`."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[dict[str, NDArray[Any]], NDArray[Any], NDArray[Any], list[dict[str, Any]]]:
        """Take the stored actions; those whose episode has ended are reset at once."""
        plain, reward, terminated, truncated, self._info = self.vector_env.step(self._actions)
        done = terminated | truncated
        self._return += reward
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        seen = self._observe(plain)
        if done.any():
            for k in np.flatnonzero(done):
                episode = {"r": float(self._return[k]), "l": int(self._info["steps"][k]), "t": 0.0}
                infos[k] = {
                    "terminal_observation": {name: array[k] for name, array in seen.items()},
                    "TimeLimit.truncated": bool(truncated[k] and not terminated[k]),
                    "episode": episode,
                    "is_success": bool(self._info["is_success"][k]),
                }
            self._return[done] = 0.0
            plain, self._info = self.vector_env.reset(options={"reset_mask": done})
            seen = self._observe(plain)
        return seen, reward.astype(np.float32), done, infos

    def action_masks(self) -> BoolArray:
        """Return which actions are valid, shape (k, N m).

        Raises a `gymnasium.error.ResetNeeded` before the first reset.
        """
        if not self._info:
            raise gymnasium.error.ResetNeeded("call reset() before action_masks()")
        mask: NDArray[np.int8] = self._info["action_mask"]
        return mask.view(np.bool_)

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """Return the action masks of sub-environments; they have no other method."""
        choice("method", method_name, ["action_masks"])
        masks = self.action_masks()
        return [masks[k] for k in self._get_indices(indices)]

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the environment, once for each sub-environment."""
        owner = self if attr_name == "action_masks" else self.vector_env.env
        return [getattr(owner, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise an error, since the sub-environments share one world."""
        raise SettingError(
            f"attribute {attr_name!r} cannot be set: the sub-environments share one world, "
            "`vector_env.env`"
        )

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each sub-environment, since none is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def close(self) -> None:
        """Do nothing, since there is nothing to release."""
