"""Many two-limb environments that step in one batch.

`gymnasium.make_vec("MLIVR-JEM-v0", num_envs=...)` makes it. All sub-environments read the same
tables of exact steps, and one call of compiled code steps them all.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from mlivr_gym.arguments import SEED, InstanceOf, Reader, Validators, checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.envs.actions import action_numbers
from mlivr_gym.envs.arguments import AUTORESET_MODE, EPISODE_STEPS
from mlivr_gym.envs.batch import ActionResults, SubEnvStates, TaskDistribution, advance, draw_tasks
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation, ObservationArrays, ObservationTable
from mlivr_gym.envs.plain_spec import PlainSpec
from mlivr_gym.envs.regret import OptimalCosts, Regret
from mlivr_gym.envs.rewards import StepOutcome
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.tasks import FIXED_NUMBER, WalkTasks, draw_task, fixed_task, refuse_layouts
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.schema import FieldPath, Fields, Flag, Integer, ListOf, OrNone
from mlivr_gym.sharing import Independent, OnGraph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import StepTables, state_of
from mlivr_gym.stances.table_steps import valid_actions
from mlivr_gym.world.given_points import GOAL, STANCE

MAX_SUB_ENVS = 1 << 20
"""Maximum number of sub-environments, whose observations of the JEM take some gigabytes."""

VECTOR_ARGUMENTS: Validators = {
    "num_envs": Integer(1, MAX_SUB_ENVS),
    "max_episode_steps": OrNone(EPISODE_STEPS),
    "autoreset_mode": AUTORESET_MODE,
    "env": OrNone(InstanceOf(MlivrEnv)),
}
"""Validators of the arguments that `MlivrEnv` does not have."""


class MlivrVectorEnv(OnGraph, Independent, PlainSpec, VectorEnv[Any, Any, Any]):
    """Vector environment of k `MlivrEnv`s with two limbs and kinematic steps.

    Spaces, rewards and arguments are those of `MlivrEnv`, batched. `info` contains arrays: `stance`
    (k, N) point ids, `action_mask` (k, N m) int8, `base_position` (k, 3) [m], `base_translation`
    [m], `steps`, `limb_manipulability` (k, N), `base_manipulability`, `is_success`,
    `invalid_action` and `grasp_failed`, of shape (k,) unless stated; and Gymnasium's flags `_key`
    of each key, all True.

    The same objects serve as rewards and task generators. A reward is called with arrays that have
    an entry for each sub-environment that took an action, a generator once for each one that is
    reset. Each sub-environment draws its tasks and grasp failures from a stream of its own. With
    seed s, sub-environment i does exactly what a `MlivrEnv` with seed s + i does under the same
    actions, over any number of episodes. The tasks `"random"` and `"clutter"` are refused.

    By default a sub-environment whose episode has ended is reset on the next step, which ignores
    its action and returns reward 0. If `autoreset_mode` is `"Disabled"`, `reset_mask` resets it.
    When points or obstacles of `env.graph` change, the tables are made again, and masks and steps
    are those of the new world, as in `MlivrEnv`.

    The states are in `stances`, their indices in `tables` of all steps, shape (k,), and
    `branch_sets` of both limbs, (k, 2); `goals` are goal positions, shape (k, 3) [m].
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
        """Compute all steps, or read them from the tables that ship or are cached.

        An episode is truncated after `max_episode_steps`, None for no limit; `autoreset_mode` is
        `"NextStep"` or `"Disabled"`. With `env`, the world, rewards, tasks and failure
        probabilities of that environment are used; otherwise `kwargs` are arguments of `MlivrEnv`.

        Raises a `MlivrError` if an argument cannot be used; the message names it.
        """
        self.metadata = {"autoreset_mode": autoreset_mode}
        if kwargs.pop("render_mode", None) is not None:
            raise SettingError(
                "the vector environment takes no render_mode; use MlivrEnv to render"
            )
        if env is not None and kwargs:
            raise SettingError(f"env and {', '.join(kwargs)} are both given; give one of them")
        self.env = MlivrEnv(**kwargs) if env is None else env
        if self.env.is_simulated:
            raise SettingError(
                "the vector environment needs dynamics='kinematic'; gymnasium.make_vec makes one "
                "of simulated robots"
            )
        refuse_layouts(self.env.tasks)
        moves = self.env.table_moves()
        self.tables: StepTables = moves.tables
        self._version = self.env.graph.version
        self.num_envs = num_envs
        self.max_episode_steps = max_episode_steps or np.iinfo(np.int64).max
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
        self.branch_sets: IntArray = np.zeros((num_envs, 2), dtype=np.int64)
        self.steps: IntArray = np.zeros(num_envs, dtype=np.int64)
        self.base_translation: Array = np.zeros(num_envs)
        self._ended = np.ones(num_envs, dtype=np.bool_)
        self._regret = Regret(num_envs) if self.env.regret else None
        self._optimal_costs = OptimalCosts(self.env, num_envs) if self.env.regret else None

    @property
    def graph(self) -> StanceGraph:
        """The stance graph."""
        return self.env.graph

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Reset all sub-environments, or those of `options["reset_mask"]`.

        `seed` is that of sub-environment 0, where number i has seed + i, or a list of k seeds; one
        whose seed is None continues its random stream. Options are `reset_mask`, k flags; `start`,
        point ids or indices of each stance, (k, N); `goal`, shape (k, 3) [m]; or `task`, the
        numbers of fixed tasks, shape (k,). What is not given is drawn by `tasks`. Returned are the
        observations and the information of all sub-environments.

        Raises a `MlivrError` if seed or options cannot be used, or no goal that can be reached was
        drawn (a goal that is given is not checked); states and random streams stay as they were.
        """
        self._refresh_tables()
        given, seeds = self._read_reset_arguments(options, seed)
        is_reset = given.get("reset_mask", np.ones(self.num_envs, np.bool_))
        starts, goals, numbers = (given.get(name) for name in ("start", "goal", "task"))
        if numbers is not None:
            if not (starts is None and goals is None):
                raise SettingError("reset option 'task' includes start and goal; give it alone")
            env, tolerance = self.env, self.env.goal_tolerance
            fixed = [fixed_task(env.tasks, env.graph, number, tolerance) for number in numbers]
            starts, goals = [task.start.stance for task in fixed], [task.goal for task in fixed]
        new, new_goals = self._copied_states(), self.goals.copy()
        self._seed_streams(seeds, is_reset, new.streams)
        graph = self.env.graph
        if starts is not None:
            for k in np.flatnonzero(is_reset):
                at = graph.state(starts[k])
                new.stances[k], new.branch_sets[k] = self._stance_at[at.stance], at.branch_sets
            self._check_starts(is_reset, new)
        if starts is None or goals is None:
            self._draw(is_reset, starts is not None, new, new_goals)
        if goals is not None:
            for k in np.flatnonzero(is_reset):
                new_goals[k] = graph.grasp_map.check_goal(goals[k])
        self._start_episodes(is_reset, new, new_goals)
        self._ended[is_reset] = False
        self._observe()
        return self._seen.observation(), self._info(*np.zeros((2, self.num_envs), np.bool_))

    def _read_reset_arguments(
        self, options: object, seed: object
    ) -> tuple[dict[str, Any], list[int | None]]:
        """Return the options after checking them, and a seed or None for each sub-environment."""
        k = self.num_envs
        validators: Validators = {
            "reset_mask": Reader(self._read_reset_mask),
            "start": OrNone(ListOf(STANCE, k, k)),
            "goal": OrNone(ListOf(GOAL, k, k)),
            "task": OrNone(ListOf(FIXED_NUMBER, k, k)),
        }
        path = FieldPath("options", SettingError)
        given = Fields({}, validators).read({} if options is None else options, path)
        if isinstance(seed, (list, tuple, np.ndarray)):
            each = ListOf(OrNone(SEED), k, k).read(seed, FieldPath("seed", SettingError))
            return given, list(each)
        first = OrNone(SEED).read(seed, FieldPath("seed", SettingError))
        return given, [None if first is None else first + i for i in range(k)]

    def _read_reset_mask(self, mask: object, path: FieldPath) -> BoolArray:
        """Return which sub-environments are reset."""
        k = self.num_envs
        if isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (k,):
            return mask.copy()
        return np.array(ListOf(Flag(), k, k).read(mask, path))

    def _seed_streams(
        self, seeds: list[int | None], is_reset: BoolArray, streams: NDArray[np.uint64]
    ) -> None:
        """Write the random streams of those that are reset with a seed, or for the first time.

        A stream that starts without a seed is stored at once; a reset that fails does not change
        which numbers the next one draws.
        """
        for k in np.flatnonzero(is_reset):
            if (seed := seeds[k]) is not None:
                streams[k] = Stream.of_seed(seed).state
            elif not self._seeded[k]:
                number = int(self.np_random.integers(2**63))
                self._streams[k] = streams[k] = Stream.of_seed(number).state
                self._seeded[k] = True

    def step(self, actions: Any) -> tuple[Observation, Array, BoolArray, BoolArray, dict[str, Any]]:
        """Take one action, an integer, in each of the k sub-environments.

        Returned are observations, rewards, terminated, truncated, each for k, and the information.
        Raises a `gymnasium.error.ResetNeeded` if a sub-environment was never reset, and a
        `SettingError` if the actions are not in the action space, or the episode of a
        sub-environment has ended and none is reset automatically.
        """
        self._check_reset()
        self._refresh_tables()
        actions = action_numbers(actions, self.num_envs, 2 * len(self._stance_at))
        env, restart, before = self.env, self._ended, self._seen.goal_distance
        if restart.any():
            if self.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
                first = int(np.flatnonzero(restart)[0])
                raise SettingError(
                    f"the episode of sub-environment {first} has ended; reset it with option "
                    "'reset_mask'"
                )
            new, new_goals = self._copied_states(), self.goals.copy()
            self._draw(restart, False, new, new_goals)
            self._start_episodes(restart, new, new_goals)
        states = SubEnvStates(self.stances, self.branch_sets, self._streams)
        results = ActionResults.of(self.num_envs)
        advance(actions, restart, env.failure_probability, self.tables, states, results)
        active = ~restart
        self.steps += active
        self.base_translation += results.displacement
        self._observe()
        success = (after := self._seen.goal_distance) <= env.goal_tolerance
        reward = np.zeros(self.num_envs)
        if active.any():
            valid, longest = ~results.invalid[active], env.graph.max_displacement
            distances = (results.displacement[active], before[active], after[active])
            tried = self.tables.points[results.after[active]], actions[active] % len(self._ids)
            outcome = StepOutcome(*distances, success[active], valid, longest, *tried)
            reward[active] = env.reward(outcome)
            if self._regret is not None:
                self._regret.charge(active, -np.asarray(env.reward.step_reward(outcome)))
        terminated, truncated = success & active, active & (self.steps >= self.max_episode_steps)
        self._ended = terminated | truncated
        info = self._info(results.invalid, results.grasp_failed)
        return self._seen.observation(), reward, terminated, truncated, info

    def action_masks(self) -> BoolArray:
        """Return which actions are valid, shape (k, N m).

        Raises a `gymnasium.error.ResetNeeded` if a sub-environment was never reset.
        """
        self._check_reset()
        self._refresh_tables()
        return self._valid(self.stances, self.branch_sets)

    def _refresh_tables(self) -> None:
        """Make the tables again if the world has changed; the indices of stances stay."""
        if self._version != self.env.graph.version:
            self.tables = self.env.table_moves().tables
            self._version = self.env.graph.version

    def _check_reset(self) -> None:
        """Check that every sub-environment was reset at least once."""
        if not self._started.all():
            first = int(np.argmin(self._started))
            raise gymnasium.error.ResetNeeded(
                f"sub-environment {first} was never reset; call reset() first"
            )

    def _check_starts(self, is_reset: BoolArray, states: SubEnvStates) -> None:
        """Check that at least one step leaves each start."""
        stuck = is_reset & ~self._valid(states.stances, states.branch_sets).any(axis=1)
        if stuck.any():
            stance = self.env.graph.ids(self.tables.points[states.stances[stuck.argmax()]])
            raise StanceError(f"no step leaves the start stance {stance}; choose another start")

    def _valid(self, stances: IntArray, branch_sets: IntArray) -> BoolArray:
        """Return which actions are valid in k states, shape (k, 2 m)."""
        k, m = self.num_envs, len(self._stance_at)
        out = np.zeros((k, 2, m), dtype=np.int8)
        valid_actions(stances, branch_sets, self.tables, out)
        return out.reshape(k, 2 * m).view(np.bool_)

    def _copied_states(self) -> SubEnvStates:
        """Return copies of states and streams, in which tasks are drawn before they are taken."""
        return SubEnvStates(self.stances.copy(), self.branch_sets.copy(), self._streams.copy())

    def _draw(self, is_reset: BoolArray, given: bool, states: SubEnvStates, goals: Array) -> None:
        """Draw goals, and starts unless they are given, and write them into the arrays."""
        graph, grasp_map = self.env.graph, self.env.graph.grasp_map
        if not isinstance(self.env.tasks, WalkTasks):
            self._draw_one_by_one(is_reset, given, states, goals)
            return
        distribution = TaskDistribution.of(grasp_map, self.env.goal_tolerance, self.env.tasks)
        missing = draw_tasks(is_reset, is_reset & given, distribution, self.tables, states, goals)
        if missing >= 0:
            start = graph.ids(self.tables.points[states.stances[missing]])
            task = f"goal that can be reached from start {start} was"
            task = task if given else "start with a goal that can be reached was"
            raise StanceError(f"no {task} found on map {grasp_map.name!r}")

    def _draw_one_by_one(
        self, is_reset: BoolArray, given: bool, states: SubEnvStates, goals: Array
    ) -> None:
        """Draw the tasks of a user's generator, each from the stream of its sub-environment."""
        env, (stances, branch_sets, streams) = self.env, states
        for k in np.flatnonzero(is_reset):
            stream = Stream(int(streams[k]))
            start = state_of(self.tables, int(stances[k]), branch_sets[k]) if given else None
            task = draw_task(env.tasks, env.graph, stream, env.goal_tolerance, start)
            if task.start.pose is not None:
                raise SettingError(
                    "the task generator drew a start pose, which only MlivrEnv supports"
                )
            stances[k], branch_sets[k] = self._stance_at[task.start.stance], task.start.branch_sets
            goals[k] = task.goal
            streams[k] = stream.state
        self._check_starts(is_reset, states)

    def _start_episodes(self, is_reset: BoolArray, states: SubEnvStates, goals: Array) -> None:
        """Take the states and goals that were drawn; start the counters of those that are reset."""
        self.stances[:], self.branch_sets[:], self._streams[:] = states
        self.goals[:] = goals
        self.steps[is_reset], self.base_translation[is_reset] = 0, 0.0
        self._seeded[is_reset] = self._started[is_reset] = True
        if self._regret is not None:
            self._regret.start(is_reset, self._costs_to_go())

    def _costs_to_go(self) -> Array:
        """Return the costs-to-go of the present states, shape (k,)."""
        assert self._optimal_costs is not None
        return self._optimal_costs.of(self.tables, self.goals, self.stances, self.branch_sets)

    def _observe(self) -> None:
        """Compute the observations of all sub-environments."""
        self._seen = ObservationArrays.of(
            self._observation_table, self.stances, self.branch_sets, self.goals
        )

    def _info(self, invalid: BoolArray, failed: BoolArray) -> dict[str, Any]:
        """Return the information, in Gymnasium's format of vector environments."""
        seen = self._seen
        info: dict[str, Any] = {
            "stance": self._ids.take(seen.stance),
            "base_position": seen.precise_base_position,
            "base_translation": self.base_translation.copy(),
            "steps": self.steps.copy(),
            "limb_manipulability": seen.w_m,
            "base_manipulability": seen.w_b,
            "action_mask": self._valid(self.stances, self.branch_sets).view(np.int8),
            "is_success": seen.goal_distance <= self.env.goal_tolerance,
            "invalid_action": invalid,
            "grasp_failed": failed,
        }
        if self._regret is not None:
            info |= self._regret.info(self._costs_to_go())
        known = np.ones((len(info), self.num_envs), dtype=np.bool_)
        return info | {f"_{name}": row for name, row in zip(info, known, strict=True)}
