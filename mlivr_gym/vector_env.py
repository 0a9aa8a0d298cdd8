"""Many copies of the two-limb environment in one: `gymnasium.make_vec("MLIVR-JEM-v0", num_envs=...)`.

Every copy steps through the same read-only tables of exact steps, so that a step costs well under a microsecond a copy beside
the mask and the observation that it returns.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from mlivr_gym.env import MlivrEnv
from mlivr_gym.errors import SettingError, StanceError, choice
from mlivr_gym.plain_data import plain_spec
from mlivr_gym.step_tables import StepTables
from mlivr_gym.table_kernels import advance, draw_tasks, legal_actions

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

MODES = {mode.value: mode for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED)}


class MlivrVectorEnv(VectorEnv[Any, Any, Any]):
    """A batch of `MlivrEnv`s with two limbs and kinematic steps.

    Spaces, rewards and arguments are those of `MlivrEnv`, batched. `info` holds arrays: `action_mask` (k, N m) int8,
    `base_position` (k, 3), `base_translation`, `steps`, `limb_manipulability` (k, N), `base_manipulability`, `is_success`,
    `invalid_action` and `grasp_failed`, each (k,) if not said otherwise. Start and goal are drawn as `MlivrEnv` does, from a stream
    of random numbers of each copy's own. By default a copy whose episode has ended starts anew on the next step, whose action it
    ignores; with `autoreset_mode="Disabled"` call `reset(options={"reset_mask": ...})`.

    Attributes:
        tables: The steps.
        goals: Goal positions [m], shape (k, 3).
        stances: Stance index of each copy in `tables`, shape (k,).
        masks: Branches each limb may still be on, shape (k, 2).
        steps: Steps since reset, shape (k,).
        base_translation: Sum of base displacements since reset [m], shape (k,).
    """

    _spec: EnvSpec | None = None

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = 100,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        env: MlivrEnv | None = None,
        **kwargs: Any,
    ) -> None:
        """Work every step out, or read it from the cache.

        Args:
            num_envs: Number of copies k.
            max_episode_steps: Steps after which an episode is truncated.
            autoreset_mode: `"NextStep"` or `"Disabled"`.
            env: An environment whose world and rewards to take, in place of `kwargs`.
            **kwargs: Arguments of `MlivrEnv`.

        Raises:
            MlivrError: If an argument cannot be used; the message names it.
        """
        if num_envs < 1:
            raise SettingError(f"num_envs is {num_envs!r}; it must be at least 1")
        mode = autoreset_mode.value if isinstance(autoreset_mode, AutoresetMode) else autoreset_mode
        self.metadata = {"autoreset_mode": MODES[choice("autoreset_mode", mode, MODES)]}
        if kwargs.pop("render_mode", None) is not None:
            raise SettingError("the vector environment does not render; use MlivrEnv")
        self.env = MlivrEnv(**(kwargs | {"precompute": True})) if env is None else env
        moves = self.env.table_moves()
        self.tables: StepTables = moves.tables
        self.num_envs, self.max_episode_steps = num_envs, max_episode_steps or np.iinfo(np.int64).max
        self.single_action_space: spaces.Space[Any] = self.env.action_space
        self.single_observation_space: spaces.Space[Any] = self.env.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._stance_at, self._looks = moves.stance_at, moves.observations
        self._w_m, self._w_b = moves.graph.w_m, moves.graph.w_b
        self._streams = np.zeros(num_envs, dtype=np.uint64)
        self.goals: Array = np.zeros((num_envs, 3))
        self.stances: IntArray = np.zeros(num_envs, dtype=np.int64)
        self.masks: IntArray = np.zeros((num_envs, 2), dtype=np.int64)
        self.steps: IntArray = np.zeros(num_envs, dtype=np.int64)
        self.base_translation: Array = np.zeros(num_envs)
        self._ended = np.ones(num_envs, dtype=np.bool_)
        self._all = np.ones(num_envs, dtype=np.bool_)

    @property
    def spec(self) -> EnvSpec | None:
        """What made the environment, its arguments as plain data; None without `make_vec`."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = plain_spec(spec)

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Start every copy anew, or those of `options["reset_mask"]`, shape (k,).

        Args:
            seed: Copy i draws from seed + i, or from its own seed of a list.
            options: `reset_mask`; `start`, point ids or indices of each copy's stance, shape (k, N); `goal`, shape (k, 3).
        """
        given = dict(options or {})
        which = np.array(given.pop("reset_mask", self._all), dtype=np.bool_)
        if seed is not None or not self._streams.any():
            base = int(self.np_random.integers(2**31)) if seed is None else seed
            seeds = [base + i for i in range(self.num_envs)] if isinstance(base, int) else list(base)
            states = [np.random.SeedSequence(s).generate_state(1, np.uint64)[0] for s in seeds]
            self._streams[:] = np.array(states, dtype=np.uint64)
        starts, goals = given.pop("start", None), given.pop("goal", None)
        if given:
            raise SettingError(
                f"unknown reset option {sorted(given)[0]!r}; valid options are 'start', 'goal', 'reset_mask'"
            )
        if starts is None or goals is None:
            self._draw(which)
        graph = self.env.graph
        for k in np.flatnonzero(which):
            if starts is not None:
                state = graph.state(starts[k])
                self.stances[k], self.masks[k] = self._stance_at[state.stance], state.masks
            if goals is not None:
                self.goals[k] = graph.grasp_map.check_goal(goals[k])
        self._begin(which)
        return self._observation(), self._info(np.zeros(self.num_envs, np.bool_), np.zeros(self.num_envs, np.bool_))

    def step(
        self, actions: NDArray[np.integer]
    ) -> tuple[dict[str, NDArray[Any]], Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Take one action in each copy."""
        actions = np.asarray(actions, dtype=np.int64)
        if actions.shape != (self.num_envs,) or ((actions < 0) | (actions >= self.single_action_space.n)).any():  # type: ignore[attr-defined]
            raise SettingError(f"actions must be {self.num_envs} numbers of {self.single_action_space}")
        env, restart = self.env, self._ended.copy()
        if restart.any():
            if self.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
                raise SettingError(f"episode {int(np.flatnonzero(restart)[0])} has ended; reset it first")
            self._draw(restart)
            self._begin(restart)
        before = self._potential() if env.shaping else None
        moved, outcome = np.zeros(self.num_envs), np.zeros(self.num_envs, dtype=np.int64)
        advance(
            actions, restart, env.failure_probability, env.graph.max_step, self._stance_at, self.tables, self._streams,
            self.stances, self.masks, moved, outcome,
        )  # fmt: skip
        invalid, failed = outcome == 1, outcome == 2
        self.steps += ~restart
        self.base_translation += np.where(invalid, 0.0, moved)
        success = self._success()
        reward = np.where(restart, 0.0, -1.0 if env.reward == "steps" else -moved)
        reward += env.success_bonus * (success & ~restart)
        if before is not None:
            reward += np.where(restart, 0.0, env.discount * self._potential() - before)
        terminated = success & ~restart
        truncated = (self.steps >= self.max_episode_steps) & ~restart
        self._ended = terminated | truncated
        return self._observation(), reward, terminated, truncated, self._info(invalid, failed)

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are possible, shape (k, N m)."""
        out = np.zeros((self.num_envs, 2 * len(self._stance_at)), dtype=np.bool_)
        legal_actions(self.stances, self.masks, self.tables, out.view(np.int8))
        return out

    def _draw(self, which: NDArray[np.bool_]) -> None:
        grasp_map = self.env.graph.grasp_map
        done = draw_tasks(
            which, grasp_map.positions, grasp_map.cabin, self.env.goal_tolerance, self.tables, self._streams,
            self.stances, self.masks, self.goals,
        )  # fmt: skip
        if not done:
            raise StanceError(f"no start and goal that a walk joins were found on map {grasp_map.name!r}")

    def _begin(self, which: NDArray[np.bool_]) -> None:
        self.steps[which], self.base_translation[which], self._ended[which] = 0, 0.0, False

    def _distance(self) -> Array:
        away = self.tables.position[self.stances] - self.goals
        return np.sqrt(np.einsum("ij,ij->i", away, away))

    def _success(self) -> NDArray[np.bool_]:
        reached: NDArray[np.bool_] = self._distance() <= self.env.goal_tolerance
        return reached

    def _potential(self) -> Array:
        distance = self._distance()
        return np.where(distance <= self.env.goal_tolerance, 0.0, -distance)

    def _observation(self) -> dict[str, NDArray[Any]]:
        bits = self.masks[:, :, None] >> np.arange(16) & 1
        return {
            **{name: rows[self.stances] for name, rows in self._looks.items()},
            "goal": self.goals.astype(np.float32),
            "branches": bits.reshape(self.num_envs, 32).astype(np.int8),
        }

    def _info(self, invalid: NDArray[np.bool_], failed: NDArray[np.bool_]) -> dict[str, Any]:
        info: dict[str, Any] = {
            "base_position": self.tables.position[self.stances],
            "base_translation": self.base_translation.copy(),
            "steps": self.steps.copy(),
            "limb_manipulability": self._w_m[self.stances],
            "base_manipulability": self._w_b[self.stances],
            "action_mask": self.action_masks().view(np.int8),
            "is_success": self._success(),
            "invalid_action": invalid,
            "grasp_failed": failed,
        }
        return info | {f"_{name}": self._all.copy() for name in info}
