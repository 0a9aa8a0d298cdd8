"""What `gymnasium.make_vec` makes of the environments with two limbs."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

from gymnasium.vector import AsyncVectorEnv, AutoresetMode, VectorEnv
from gymnasium.wrappers import TimeLimit

from mlivr_gym.arguments import checked
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.vector_env import VECTOR_ARGUMENTS, MlivrVectorEnv


@checked({name: VECTOR_ARGUMENTS[name] for name in VECTOR_ARGUMENTS if name != "env"})
def vector_env(
    num_envs: int = 1,
    max_episode_steps: int | None = 100,
    autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
    **kwargs: Any,
) -> VectorEnv[Any, Any, Any]:
    """Return a vector environment; `kwargs` are arguments of `MlivrEnv`.

    It is a `MlivrVectorEnv`, or with `dynamics="mujoco"` Gymnasium's `AsyncVectorEnv` of processes,
    in each of which a `MlivrEnv` simulates one robot. Raises a `MlivrError` if an argument cannot
    be used.
    """
    if kwargs.get("dynamics") != "mujoco":
        return MlivrVectorEnv(num_envs, max_episode_steps, autoreset_mode, **kwargs)
    env: Any = MlivrEnv(**kwargs)
    # What a first step loads and finds out is there before the processes fork, which then share it.
    first = deepcopy(env, {id(env.graph): env.graph})
    first.step(int(first.reset(seed=0)[1]["action_mask"].argmax()))
    if max_episode_steps is not None:
        env = TimeLimit(env, max_episode_steps)
    return AsyncVectorEnv([lambda: env] * num_envs, autoreset_mode=autoreset_mode)
