"""Policies for the environments of the closed loop."""

from __future__ import annotations

from typing import Any

from mlivr_gym.agents import Policy
from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs import MlivrEnv, Observation
from mlivr_gym.extensions.closed_loop.env import ClosedLoopEnv
from mlivr_gym.extensions.closed_loop.unknown_map import UnknownMapEnv
from mlivr_gym.planners import Planner
from mlivr_gym.planners.costs import COST_KINDS, Cost
from mlivr_gym.sharing import Independent


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


class ReplanningPolicy(Independent):
    """Policy for `ClosedLoopEnv` that plans before each action in the world that is believed.

    It takes the first step of the plan, and relaxes if there is no plan, or none of its steps left.
    """

    @checked(COST_KINDS)
    def __init__(self, cost: str | Cost = "steps", **options: Any) -> None:
        """Plan with a cost, and further arguments of `Planner.plan`."""
        self._cost, self._options = cost, options
        self._planner: Planner | None = None

    @checked({"env": InstanceOf(ClosedLoopEnv)})
    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return the action to take; see `Policy.act`.

        Raises a `SettingError` if the environment is not a `ClosedLoopEnv`.
        """
        assert isinstance(env, ClosedLoopEnv)
        if self._planner is None or self._planner.graph is not env.graph:
            self._planner = Planner(env.graph)
        goal, tolerance = env.goal.tolist(), env.goal_tolerance
        plan = self._planner.plan(
            env.state, goal, self._cost, goal_tolerance=tolerance, **self._options
        ).plan
        if plan is None or not plan.steps:
            return len(mask) - 1
        env.follow(plan)
        limb, point = plan.actions[0]
        return limb * len(env.graph.grasp_map) + env.graph.grasp_map.index(point)
