"""The environment whose occupied points the robot does not know before it sees them; a policy."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from mlivr_gym.agents import Policy
from mlivr_gym.arguments import NOT_NEGATIVE, InstanceOf, checked
from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.envs import TASKS, Attempt, LayoutTasks, MlivrEnv, Observation, TaskGenerator
from mlivr_gym.envs.layout_tasks import OCCUPIED_SHARES
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.kinematics import distances
from mlivr_gym.schema import FieldPath
from mlivr_gym.sharing import Independent

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
    policy) can be used as it is, see `LookingPolicy`. `info` has `looks`, the number of
    looks, which `steps` includes, and `fewest_steps`, those of an optimal plan with the layout
    known: no policy takes fewer attempts.

    `seen` says whether each point was seen, shape (m,); `layout` are the points that are occupied,
    seen or not, which policies must not use.
    """

    further_actions = 1

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
        if self.is_simulated or (self.failure_probability > 0.0).any():
            raise SettingError(
                "this environment needs dynamics='kinematic' and grasp_failure=0: whether a grasp "
                "fails is decided by what occupies the point"
            )
        self.look_range, self.look_cost, self.looks = look_range, look_cost, 0
        points = len(self.graph.grasp_map)
        self.seen: BoolArray = np.zeros(points, dtype=np.bool_)
        self.layout = self._known = self.graph.occupied
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
        self._refresh()
        return self._observation(), self._info(False)

    def _attempt(self, action: int) -> Attempt:
        """Look, or attempt the step of a valid action; a point that was attempted is seen."""
        points = len(self.graph.grasp_map)
        if action == self.graph.limbs * points:
            self.looks += 1
            self._see(self.in_sight())
            return Attempt(self.state, caption="looks around", reward=lambda _: -self.look_cost)
        made = super()._attempt(action)
        self._see(np.array([action % points]))
        return made

    def _grasp_fails(self, point: int) -> bool:
        """Return whether a point is occupied in the layout."""
        return point in self.layout

    def in_sight(self) -> IntArray:
        """Return the points that a look from the present base sees."""
        away = distances(self.graph.grasp_map.positions, np.array(self._properties.base_position))
        return np.flatnonzero(away <= self.look_range)

    def _see(self, points: IntArray) -> None:
        """Learn which of some points are occupied."""
        self.seen[points] = True
        self.failure_probability = np.where(self.seen, 0.0, PRIOR)
        self._occupy(frozenset(p for p in self.layout if self.seen[p]))
        self._known = self.graph.occupied

    def _occupy(self, points: frozenset[int]) -> None:
        """Make exactly these points occupied in the graph."""
        if self.graph.occupied != points:
            self.graph.vacate(sorted(self.graph.occupied - points))
            self.graph.occupy(sorted(points))

    def _observation(self) -> Observation:
        """Return the observation of the present state, with what is unknown."""
        seen = super()._observation()
        seen["unknown"] = (~self.seen).astype(np.int8)
        return seen

    def _info(self, invalid: bool, failed: bool = False) -> dict[str, Any]:
        """Return the information on the present state, with the number of looks."""
        return {**super()._info(invalid, failed), "looks": self.looks}


class LookingPolicy(Independent):
    """Policy for `UnknownMapEnv` that looks before it grasps an unknown point, or never looks.

    `policy` chooses the steps; for it the environment is a `MlivrEnv`, whose `graph` and
    `failure_probability` are what the robot knows.
    """

    @checked()
    def __init__(self, policy: Policy, looks: bool = True) -> None:
        """Take the policy that chooses the steps."""
        self.policy, self.looks = policy, looks

    @checked({"env": InstanceOf(UnknownMapEnv)})
    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return the action to take; see `Policy.act`.

        Raises a `SettingError` if the environment is not an `UnknownMapEnv`.
        """
        assert isinstance(env, UnknownMapEnv)
        if not mask[:-1].any():
            return len(mask) - 1
        action = self.policy.act(env, observation, mask[:-1])
        point = action % len(env.graph.grasp_map)
        look = self.looks and not env.seen[point] and point in env.in_sight()
        return len(mask) - 1 if look else action
