"""A task, and the interface of what draws tasks; `tasks` has the generators."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State


class Task(NamedTuple):
    """Start and goal of an episode."""

    start: State
    """State at the start."""
    goal: Array
    """Goal position of the base [m], shape (3,); unlike a planner's query it has no goal face."""


class TaskGenerator(Protocol):
    """Interface of a task generator.

    With a method `to_dict`, which returns plain data, the `spec` of its environment can be written
    as JSON.

    Examples
    --------
    Tasks whose goal lies at least 2 m from the start:

    >>> from mlivr_gym.envs import MlivrEnv, sample_task
    >>> class LongTasks:
    ...     def draw(self, graph, rng, tolerance, start=None):
    ...         return sample_task(graph, rng, 2.0, start)
    >>> env = MlivrEnv(tasks=LongTasks())
    >>> observation, info = env.reset(seed=0)
    >>> bool(np.linalg.norm(observation["goal"] - info["base_position"]) > 2.0)
    True
    """

    def draw(
        self,
        graph: StanceGraph,
        rng: np.random.Generator,
        tolerance: float,
        start: State | None = None,
    ) -> Task:
        """Return a task whose goal can be reached from its start.

        The start is drawn if it is None, otherwise that of the task; `tolerance` is the radius of
        the goal region [m]. Obstacles and occupied points of the graph may be changed: the next
        task is drawn in the world that this one leaves, a start that is given must stay free, and
        a draw that fails puts the world back. A goal that is given replaces that of the task.
        Raises a `StanceError` if no task is found.
        """
