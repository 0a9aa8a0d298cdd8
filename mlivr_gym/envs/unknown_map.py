"""The environment in which the robot does not know which points are occupied until it sees them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from mlivr_gym.arguments import NOT_NEGATIVE, checked
from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.envs.actions import action_number
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.layout_tasks import OCCUPIED_SHARES, LayoutTasks
from mlivr_gym.envs.observations import Observation
from mlivr_gym.envs.rewards import StepOutcome
from mlivr_gym.envs.task import TaskGenerator
from mlivr_gym.envs.tasks import TASKS
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.kinematics.batches import distances
from mlivr_gym.schema import FieldPath
from mlivr_gym.transitions.state import State

PRIOR = sum(OCCUPIED_SHARES) / 2.0
"""Probability that a point is occupied before anything is seen."""


class UnknownMapEnv(MlivrEnv):
    """Climbing through a module whose occupied points the robot discovers on its way.

    Each episode has a layout of its own, see `LayoutTasks`, in which points are occupied in
    clusters. The robot knows the map, and of the layout what it has seen: at the start the points
    within `look_range` of its base, later those within that range of the base whenever it looks,
    and each point that it attempted to grasp. What was seen lasts for the episode.

    * Actions `limb * m + point` are as in `MlivrEnv`, and valid as if unseen points were free. The
      attempt to grasp an occupied point fails: it costs a step, and the base moves there and back.
      The limbs are then on the branches of the attempt; if these allow no other step, only looks
      are left.
    * The last action, `N m`, looks. It is valid in every state, and costs `look_cost`.

    The observation has `occupied`, the points seen to be occupied, and `unknown`, those not seen.
    Both together are what the robot remembers, so no history of observations is needed.
    `failure_probability` is `PRIOR` for unknown points and 0 for others, and `graph` has the points
    seen to be occupied, so that what expects failures (`ExpertPolicy`, the features of the pointer
    policy) can be used as it is, see `agents.LookingPolicy`. `info` has `looks`, the number of
    looks, which `steps` includes, and `fewest_steps`, those of an optimal plan with the layout
    known: no policy takes fewer attempts.

    `seen` says whether each point was seen, shape (m,); `layout` are the points that are occupied,
    seen or not, which policies must not use.
    """

    @checked({"look_range": NOT_NEGATIVE, "look_cost": NOT_NEGATIVE, "tasks": TASKS})
    def __init__(
        self,
        look_range: float = 2.0,
        look_cost: float = 0.5,
        tasks: str | TaskGenerator | dict[str, Any] = "clutter",
        **options: Any,
    ) -> None:
        """Build the environment; `tasks` and `options` are arguments of `MlivrEnv`.

        A look sees the points within `look_range` of the base [m] and costs `look_cost`, in the
        unit of the reward. Raises a `MlivrError` if an argument cannot be used: tasks must have
        layouts, and grasps fail by the layout alone.
        """
        drawn = TASKS.read(tasks, FieldPath("tasks", SettingError))
        if not isinstance(drawn, LayoutTasks):
            raise SettingError(f"tasks is {tasks!r}; it must be 'clutter', 'random' or LayoutTasks")
        super().__init__(tasks=drawn, **options)
        if self._executor is not None or (self.failure_probability > 0.0).any():
            raise SettingError(
                "this environment needs dynamics='kinematic' and grasp_failure=0: whether a grasp "
                "fails is decided by what occupies the point"
            )
        self.look_range, self.look_cost, self.looks = look_range, look_cost, 0
        points = len(self.graph.grasp_map)
        self.seen: BoolArray = np.zeros(points, dtype=np.bool_)
        self.layout = self._known = self.graph.occupied
        self.action_space = spaces.Discrete(self.graph.limbs * points + 1)
        known: Any = self.observation_space
        self.observation_space = spaces.Dict(known.spaces | {"unknown": spaces.MultiBinary(points)})

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode, see `MlivrEnv.reset`; the robot sees what is around its start.

        If start and goal are both given, the layout is that of the episode before, or the points
        that have been made occupied in `graph` since then.
        """
        if self.graph.occupied == self._known:
            self._occupy(self.layout)
        try:
            super().reset(seed=seed, options=options)
        except MlivrError:
            self._occupy(self._known)
            raise
        self.layout, self.looks = self.graph.occupied, 0
        self.seen[:] = False
        self._see(self.in_sight())
        return self._observation(), self._info(False)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Look, or attempt a step; see `MlivrEnv.step`."""
        self._refresh()
        points, limbs = len(self.graph.grasp_map), self.graph.limbs
        action = action_number(action, limbs * points + 1)
        if action < limbs * points:
            _, reward, ended, _, info = super().step(action)
            invalid, failed = info["invalid_action"], info["grasp_failed"]
            if not invalid:
                self._see(np.array([action % points]))
            return self._observation(), reward, ended, False, self._info(invalid, failed)
        self.steps, self.looks = self.steps + 1, self.looks + 1
        self._see(self.in_sight())
        here, success = self._distance, self._distance <= self.goal_tolerance
        outcome = StepOutcome(0.0, here, here, success, True, self.graph.max_displacement)
        reward = float(self.reward._replace(step_reward=lambda _: -self.look_cost)(outcome))
        self._record_event("looks around", None)
        return self._observation(), reward, success, False, self._info(False)

    def _grasp_fails(self, point: int) -> bool:
        """Return whether a point is occupied in the layout."""
        return point in self.layout

    def in_sight(self) -> IntArray:
        """Return the points that a look from the present base sees."""
        away = distances(self.graph.grasp_map.positions, np.array(self._properties.base_position))
        return np.flatnonzero(away <= self.look_range)

    def _see(self, points: IntArray) -> None:
        """Learn which of some points are occupied, and evaluate the present state again."""
        self.seen[points] = True
        self.failure_probability = np.where(self.seen, 0.0, PRIOR)
        self._occupy(frozenset(p for p in self.layout if self.seen[p]))
        self._known = self.graph.occupied
        self._refresh()

    def _occupy(self, points: frozenset[int]) -> None:
        """Make exactly these points occupied in the graph."""
        if self.graph.occupied != points:
            self.graph.vacate(sorted(self.graph.occupied - points))
            self.graph.occupy(sorted(points))

    def _enter_state(self, state: State) -> None:
        """Set the present state; looking is valid in every state."""
        super()._enter_state(state)
        self._mask = np.append(self._mask, True)

    def _observation(self) -> Observation:
        """Return the observation of the present state, with what is unknown."""
        seen = super()._observation()
        seen["unknown"] = (~self.seen).astype(np.int8)
        return seen

    def _info(self, invalid: bool, failed: bool = False) -> dict[str, Any]:
        """Return the information on the present state, with the number of looks."""
        return {**super()._info(invalid, failed), "looks": self.looks}
