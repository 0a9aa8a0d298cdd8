"""Policies that need no training: random legal actions, and the optimal expert."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.env import MlivrEnv
from mlivr_gym.errors import SettingError
from mlivr_gym.pair_graph import PairGraph
from mlivr_gym.planners import CostToGo, Planner


class Policy(Protocol):
    """Chooses actions in a `MlivrEnv`."""

    def act(self, env: MlivrEnv, observation: dict[str, NDArray[Any]], mask: NDArray[np.bool_]) -> int:
        """The action to take; `mask` tells which are possible, shape (N m,)."""
        ...


class RandomPolicy:
    """Draws from the possible actions."""

    def __init__(self, seed: int = 0) -> None:
        """Seed the draws."""
        self._rng = np.random.default_rng(seed)

    def act(self, env: MlivrEnv, observation: dict[str, NDArray[Any]], mask: NDArray[np.bool_]) -> int:
        """A possible action, each as likely as the others."""
        return int(self._rng.choice(np.flatnonzero(mask)))


class ExpertPolicy:
    """Takes the first step of an optimal plan, by the exact cost-to-go table of the goal. Two limbs only."""

    def __init__(self) -> None:
        """Start without tables; each is worked out when its goal first comes up."""
        self._planner: Planner | None = None

    def act(self, env: MlivrEnv, observation: dict[str, NDArray[Any]], mask: NDArray[np.bool_]) -> int:
        """An optimal action for the environment's reward."""
        graph = env.graph
        if not isinstance(graph, PairGraph):
            raise SettingError(f"the expert policy needs two limbs; robot {graph.robot.name!r} has more")
        if self._planner is None or self._planner.graph is not graph:
            self._planner = Planner(graph)
        table: CostToGo = self._planner.cost_to_go(env.goal.tolist(), env.reward, goal_tolerance=env.goal_tolerance)
        steps = graph.successors(env.state)
        k = table.best(env.state, steps)
        return int(steps.limb[k]) * len(graph.grasp_map) + int(steps.point[k])
