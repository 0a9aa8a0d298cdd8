"""Many copies of the two-limb environment in one.

`gymnasium.make_vec("MLIVR-JEM-v0", num_envs=...)` makes it. Every copy steps through the same
read-only tables of exact steps, so that a step costs well under a microsecond a copy beside the
mask and the observation that it returns.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from mlivr_gym.arguments import SEED, Kinds, Of, Via, checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.envs.actions import action_numbers
from mlivr_gym.envs.arguments import AUTORESET_MODE, EPISODE_STEPS
from mlivr_gym.envs.batch import CopyStates, StepParameters, TaskDistribution, advance, draw_tasks
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation, ObservationArrays, ObservationTable
from mlivr_gym.envs.plain_spec import PlainSpec
from mlivr_gym.envs.rewards import StepOutcome
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.tasks import FIXED_NUMBER, WalkTasks, draw_task, fixed_task
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.schema import FieldPath, Fields, Flag, Listed, Maybe, Whole
from mlivr_gym.stances.step_tables import StepTables, state_of
from mlivr_gym.stances.table_steps import legal_actions
from mlivr_gym.world.grasp_map import GOAL, STANCE

MAX_COPIES = 1 << 20
"""Most copies: their observations of the JEM take some gigabytes."""

VECTOR_ARGUMENTS: Kinds = {
    "num_envs": Whole(1, MAX_COPIES),
    "max_episode_steps": Maybe(EPISODE_STEPS),
    "autoreset_mode": AUTORESET_MODE,
    "env": Maybe(Of(MlivrEnv)),
}
"""Kinds of the arguments, besides those of `MlivrEnv`."""


class MlivrVectorEnv(PlainSpec, VectorEnv[Any, Any, Any]):
    """A batch of `MlivrEnv`s with two limbs and kinematic steps.

    Spaces, rewards and arguments are those of `MlivrEnv`, batched. `info` holds arrays: `stance`
    (k, N) point ids, `action_mask` (k, N m) int8, `base_position` (k, 3), `base_translation`,
    `steps`, `limb_manipulability` (k, N), `base_manipulability`, `is_success`, `invalid_action` and
    `grasp_failed`, each (k,) if not said otherwise.

    Rewards and task generators are the same objects: a reward is called with arrays of shape (k,),
    a generator once for each copy that starts anew. Each copy distribution its tasks and failed grasps
    from its own stream: with seed s copy i goes as a `MlivrEnv` with seed s + i goes under the same
    actions, over any number of episodes.

    By default a copy whose episode has ended starts anew on the next step, whose action it ignores,
    with reward 0; with `autoreset_mode="Disabled"` call `reset(options={"reset_mask": ...})`.

    When points or obstacles of `env.graph` change, the tables are read or worked out anew, and
    masks and steps are those of the new world, as in `MlivrEnv`.

    Attributes
    ----------
    tables
        The steps.
    goals
        Goal positions [m], shape (k, 3).
    stances
        Stance index of each copy in `tables`, shape (k,).
    masks
        Branches each limb may still be on, shape (k, 2).
    steps
        Steps since reset, shape (k,).
    base_translation
        Sum of base displacements since reset [m], shape (k,).
    """

    @checked(VECTOR_ARGUMENTS)
    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = 100,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        env: MlivrEnv | None = None,
        **kwargs: Any,
    ) -> None:
        """Work every step out, or read it from the cache.

        Parameters
        ----------
        num_envs
            Number of copies k.
        max_episode_steps
            Steps after which an episode is truncated.
        autoreset_mode
            `"NextStep"` or `"Disabled"`.
        env
            An environment whose world and rewards to take, in place of `kwargs`.
        **kwargs
            Arguments of `MlivrEnv`.

        Raises
        ------
        MlivrError
            If an argument cannot be used; the message names it.
        """
        self.metadata = {"autoreset_mode": autoreset_mode}
        if kwargs.pop("render_mode", None) is not None:
            raise SettingError("the vector environment does not render; use MlivrEnv")
        self.env = MlivrEnv(**({"precompute": True} | kwargs)) if env is None else env
        moves = self.env.table_moves()
        self.tables: StepTables = moves.tables
        self._version = self.env.graph.version
        self.num_envs, self.max_episode_steps = (
            num_envs,
            max_episode_steps or np.iinfo(np.int64).max,
        )
        self.single_action_space: spaces.Space[Any] = self.env.action_space
        self.single_observation_space: spaces.Space[Any] = self.env.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._stance_at, self._observation_table = moves.stance_at, ObservationTable.of(moves.graph)
        self._ids = np.array(self.env.graph.grasp_map.ids, dtype=np.object_)
        self._streams = np.zeros(num_envs, dtype=np.uint64)
        self._seeded = np.zeros(num_envs, dtype=np.bool_)
        self._started = np.zeros(num_envs, dtype=np.bool_)
        self.goals: Array = np.zeros((num_envs, 3))
        self.stances: IntArray = np.zeros(num_envs, dtype=np.int64)
        self.masks: IntArray = np.zeros((num_envs, 2), dtype=np.int64)
        self.steps: IntArray = np.zeros(num_envs, dtype=np.int64)
        self.base_translation: Array = np.zeros(num_envs)
        self._ended = np.ones(num_envs, dtype=np.bool_)
        self._all = np.ones(num_envs, dtype=np.bool_)

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Start every copy anew, or those of `options["reset_mask"]`, bool of shape (k,).

        Parameters
        ----------
        seed
            Copy i distribution from seed + i, or from entry i of a list of k seeds; where that is
            None it goes on with its stream.
        options
            `reset_mask`; `start`, point ids or indices of each copy's stance, (k, N);
            `goal`, shape (k, 3) [m]; or `task`, the numbers of fixed tasks, shape (k,). What is
            not given is drawn by `tasks`.

        Raises
        ------
        MlivrError
            If seed or options cannot be used, or no goal can be reached from a start;
            no copy has moved then.
        """
        self._refresh_tables()
        given, seeds = self._read_reset_arguments(options, seed)
        which = given.get("reset_mask", self._all)
        starts, goals, numbers = (given.get(name) for name in ("start", "goal", "task"))
        if numbers is not None:
            if not (starts is None and goals is None):
                raise SettingError("reset option 'task' includes start and goal; give it alone")
            env = self.env
            fixed = [
                fixed_task(env.tasks, env.graph, number, env.goal_tolerance) for number in numbers
            ]
            starts, goals = [task.start.stance for task in fixed], [task.goal for task in fixed]
        self._seed_streams(seeds, which)
        new = (self.stances.copy(), self.masks.copy(), self.goals.copy())
        graph = self.env.graph
        if starts is not None:
            for k in np.flatnonzero(which):
                state = graph.state(starts[k])
                new[0][k], new[1][k] = self._stance_at[state.stance], state.masks
            self._check_starts(which, *new[:2])
        if starts is None or goals is None:
            self._draw(which, starts is not None, *new)
        if goals is not None:
            for k in np.flatnonzero(which):
                new[2][k] = graph.grasp_map.check_goal(goals[k])
        self.stances[:], self.masks[:], self.goals[:] = new
        self._start_episodes(which)
        self._ended[which] = False
        self._observe()
        nothing = np.zeros(self.num_envs, np.bool_)
        return self._seen.observation(), self._info(nothing, nothing.copy())

    def _read_reset_arguments(
        self, options: object, seed: object
    ) -> tuple[dict[str, Any], list[int | None]]:
        """The options, and a seed or None for each copy."""
        k = self.num_envs
        kinds: Kinds = {
            "reset_mask": Via(self._read_reset_mask),
            "start": Maybe(Listed(STANCE, k, k)),
            "goal": Maybe(Listed(GOAL, k, k)),
            "task": Maybe(Listed(FIXED_NUMBER, k, k)),
        }
        place = FieldPath("options", SettingError)
        given = Fields({}, kinds).read({} if options is None else options, place)
        if isinstance(seed, (list, tuple, np.ndarray)):
            each = Listed(Maybe(SEED), k, k).read(seed, FieldPath("seed", SettingError))
            return given, list(each)
        first = Maybe(SEED).read(seed, FieldPath("seed", SettingError))
        return given, [None if first is None else first + i for i in range(k)]

    def _read_reset_mask(self, mask: object, place: FieldPath) -> BoolArray:
        """Which copies start anew."""
        k = self.num_envs
        if isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (k,):
            return mask.copy()
        return np.array(Listed(Flag(), k, k).read(mask, place))

    def _seed_streams(self, seeds: list[int | None], which: BoolArray) -> None:
        """Give the chosen copies their streams."""
        for k in np.flatnonzero(which):
            if (number := seeds[k]) is None:
                if self._seeded[k]:
                    continue
                number = int(self.np_random.integers(2**63))
            self._streams[k] = Stream.of_seed(number).state
            self._seeded[k] = True

    def step(self, actions: Any) -> tuple[Observation, Array, BoolArray, BoolArray, dict[str, Any]]:
        """Take one action in each copy.

        Parameters
        ----------
        actions
            Integers, shape (k,).

        Raises
        ------
        gymnasium.error.ResetNeeded
            If a copy was never reset.
        SettingError
            If the actions are not in the action space, or a copy's episode has ended
            and copies do not start anew by themselves.
        """
        self._check_reset()
        self._refresh_tables()
        actions = action_numbers(actions, self.num_envs, 2 * len(self._stance_at))
        env, restart, before = self.env, self._ended, self._seen.goal_distance
        if restart.any():
            if self.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
                raise SettingError(
                    f"episode {int(np.flatnonzero(restart)[0])} has ended; reset it first"
                )
            self._draw(restart, False, self.stances, self.masks, self.goals)
            self._start_episodes(restart)
        moved, outcome = np.zeros(self.num_envs), np.zeros(self.num_envs, dtype=np.int64)
        parameters = StepParameters(env.failure_probability, env.graph.max_step)
        copies = CopyStates(self.stances, self.masks, self._streams)
        advance(actions, restart, parameters, self.tables, copies, moved, outcome)
        invalid, failed, going = outcome == 1, outcome == 2, ~restart
        self.steps += going
        self.base_translation += np.where(invalid, 0.0, moved)
        self._observe()
        after = self._seen.goal_distance
        success = after <= env.goal_tolerance
        before = np.where(restart, after, before)
        worth = env.reward(StepOutcome(moved, before, after, success, ~invalid))
        reward = np.where(restart, 0.0, worth)
        terminated, truncated = success & going, (self.steps >= self.max_episode_steps) & going
        self._ended = terminated | truncated
        info = self._info(invalid, failed)
        return self._seen.observation(), reward, terminated, truncated, info

    def action_masks(self) -> BoolArray:
        """Which actions are allowed, shape (k, N m).

        Raises
        ------
        gymnasium.error.ResetNeeded
            If a copy was never reset.
        """
        self._check_reset()
        self._refresh_tables()
        return self._legal(self.stances, self.masks)

    def _refresh_tables(self) -> None:
        """Read the tables anew if the world has changed; stances keep their indices."""
        if self._version != self.env.graph.version:
            self.tables = self.env.table_moves().tables
            self._version = self.env.graph.version

    def _check_reset(self) -> None:
        if not self._started.all():
            first = int(np.argmin(self._started))
            raise gymnasium.error.ResetNeeded(f"copy {first} was never reset: call reset()")

    def _check_starts(self, which: BoolArray, stances: IntArray, masks: IntArray) -> None:
        """Refuse starts that no step leaves."""
        stuck = which & ~self._legal(stances, masks).any(axis=1)
        if stuck.any():
            stance = self.env.graph.ids(self.tables.points[stances[stuck.argmax()]])
            raise StanceError(f"no step leaves the start stance {stance}")

    def _legal(self, stances: IntArray, masks: IntArray) -> BoolArray:
        k, m = self.num_envs, len(self._stance_at)
        out = np.zeros((k, 2, m), dtype=np.int8)
        legal_actions(stances, masks, self.tables, out)
        return out.reshape(k, 2 * m).view(np.bool_)

    def _draw(
        self,
        which: BoolArray,
        given: bool,
        stances: IntArray,
        masks: IntArray,
        goals: Array,
    ) -> None:
        """Draw goals, and starts if they are not given, into the arrays."""
        graph, grasp_map = self.env.graph, self.env.graph.grasp_map
        if not isinstance(self.env.tasks, WalkTasks):
            self._draw_one_by_one(which, given, stances, masks, goals)
            return
        distribution = TaskDistribution.of(grasp_map, self.env.goal_tolerance, self.env.tasks)
        copies = CopyStates(stances, masks, self._streams)
        missing = draw_tasks(which, which & given, distribution, self.tables, copies, goals)
        if missing >= 0:
            start = graph.ids(self.tables.points[stances[missing]])
            what = f"goal that a walk joins with start {start} was"
            what = what if given else "start and goal that a walk joins were"
            raise StanceError(f"no {what} found on map {grasp_map.name!r}")

    def _draw_one_by_one(
        self, which: BoolArray, given: bool, stances: IntArray, masks: IntArray, goals: Array
    ) -> None:
        """The same with another generator, each copy from its stream."""
        env = self.env
        for k in np.flatnonzero(which):
            stream = Stream(int(self._streams[k]))
            start = state_of(self.tables, int(stances[k]), masks[k]) if given else None
            task = draw_task(env.tasks, env.graph, stream, env.goal_tolerance, start)
            if task.start.pose is not None:
                raise SettingError("tasks draw a start pose, which the vector environment lacks")
            stances[k], masks[k] = self._stance_at[task.start.stance], task.start.masks
            goals[k] = task.goal
            self._streams[k] = stream.state
        self._check_starts(which, stances, masks)

    def _start_episodes(self, which: BoolArray) -> None:
        self.steps[which], self.base_translation[which], self._started[which] = 0, 0.0, True

    def _observe(self) -> None:
        self._seen = ObservationArrays.of(
            self._observation_table, self.stances, self.masks, self.goals
        )

    def _info(self, invalid: BoolArray, failed: BoolArray) -> dict[str, Any]:
        seen = self._seen
        info: dict[str, Any] = {
            "stance": self._ids.take(seen.stance),
            "base_position": seen.base_in_world,
            "base_translation": self.base_translation.copy(),
            "steps": self.steps.copy(),
            "limb_manipulability": seen.w_m,
            "base_manipulability": seen.w_b,
            "action_mask": self._legal(self.stances, self.masks).view(np.int8),
            "is_success": seen.goal_distance <= self.env.goal_tolerance,
            "invalid_action": invalid,
            "grasp_failed": failed,
        }
        told = np.ones((len(info), self.num_envs), dtype=np.bool_)
        return info | {f"_{name}": row for name, row in zip(info, told, strict=True)}
