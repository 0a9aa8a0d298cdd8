"""The robot of an environment: its present state in a stance graph, and pictures of it.

`env` adds the task: starts and goals, steps, and rewards.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mlivr_gym.arguments import NOT_NEGATIVE, checked
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.envs.observations import Observation, observation_of, observation_space
from mlivr_gym.envs.plain_spec import PlainSpec
from mlivr_gym.envs.snapshots import Motion, Snapshot
from mlivr_gym.envs.viewer import RENDER_FPS, EnvViewer
from mlivr_gym.kinematics.batches import distance
from mlivr_gym.schema import Choice, OrNone
from mlivr_gym.sharing import Independent, OnGraph, locked
from mlivr_gym.stances.moves import Moves, TableMoves
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import step_tables
from mlivr_gym.stances.table_build import find_table
from mlivr_gym.transitions.state import State, Successors


class StanceGraphEnv(OnGraph, Independent, PlainSpec, gymnasium.Env[Any, Any]):
    """Base class of `MlivrEnv`: the present state, what an agent sees of it, and pictures."""

    metadata = {"render_modes": list(RENDER_FPS), "render_fps": 2}  # noqa: RUF012
    further_actions = 0
    """Number of actions beside the steps, which are valid in every state."""
    goal: Array
    steps: int
    base_translation: float
    _state: State | None
    _last_event: tuple[str, Motion | None]

    @checked({"goal_tolerance": NOT_NEGATIVE, "render_mode": OrNone(Choice(tuple(RENDER_FPS)))})
    def __init__(
        self,
        graph: StanceGraph,
        goal_tolerance: float,
        render_mode: str | None,
        size: tuple[int, int],
        layouts: bool = False,
    ) -> None:
        """Build the spaces, and load the node table of a graph of three or more limbs.

        Pictures have width and height `size` [px]. With `layouts`, observations say which points
        are occupied.
        """
        self.graph, self.goal_tolerance, self.render_mode = graph, goal_tolerance, render_mode
        if render_mode is not None:
            self.metadata = self.metadata | {"render_fps": RENDER_FPS[render_mode]}
        actions = graph.limbs * len(graph.grasp_map) + self.further_actions
        self.action_space = spaces.Discrete(actions)
        self.observation_space = observation_space(graph, layouts)
        if not graph.lists_all:
            find_table(graph)
        self._moves: Moves | None = None
        self._moves_version, self._uses_tables, self._layouts = graph.version, False, layouts
        self._state, self._graph_version = None, graph.version
        self._simulation_info: dict[str, Any] = {}
        self._task_info: dict[str, Any] = {}
        self.viewer = EnvViewer(graph, size, goal_tolerance)

    @property
    @locked
    def moves(self) -> Moves:
        """The steps in the present world, from exact tables if all are known."""
        return self._present_moves()

    def _present_moves(self) -> Moves:
        graph = self.graph
        if self._moves is None or self._moves_version != graph.version:
            known = graph.lists_all and graph.is_complete
            self._moves = self._exact_moves() if self._uses_tables or known else Moves(graph)
            self._moves_version = graph.version
        return self._moves

    def table_moves(self) -> TableMoves:
        """Return the steps from exact tables, which are used from now on.

        Raises a `SettingError` if the robot has more than two limbs.
        """
        moves = self.moves
        if not isinstance(moves, TableMoves):
            self._moves = moves = self._exact_moves()
        self._uses_tables = True
        return moves

    def _exact_moves(self) -> TableMoves:
        """Return the steps from the exact tables of the present world."""
        tables = step_tables(self.graph)
        return TableMoves(self.graph, tables)

    @property
    def state(self) -> State:
        """The present state: the stance and the branch set of each limb.

        Raises a `gymnasium.error.ResetNeeded` before the first reset.
        """
        if self._state is None:
            raise gymnasium.error.ResetNeeded(
                "the environment has no state yet; call reset() first"
            )
        return self._state

    def action_masks(self) -> BoolArray:
        """Return which actions are valid, shape (N m,); `MaskablePPO` of sb3-contrib calls this.

        Raises a `gymnasium.error.ResetNeeded` before the first reset.
        """
        self._refresh()
        return self._mask.copy()

    def successors(self) -> Successors:
        """Return the steps that leave the present state, with the state after each."""
        return self.moves.successors(self.state)

    def _refresh(self) -> None:
        """Evaluate the present state again if the world has changed since."""
        if self._graph_version != self.graph.version or self._state is None:
            self._enter_state(self.state)

    def _enter_state(self, state: State) -> None:
        """Set the present state, and evaluate its posture, goal distance and mask."""
        self._graph_version, moves = self.graph.version, self._present_moves()
        self._state, self._properties = state, moves.stance_properties(state)
        self._distance = distance(self._properties.base_position, self.goal.tolist())
        self._mask = moves.action_mask(state)
        if self.further_actions:
            self._mask = np.append(self._mask, [True] * self.further_actions)

    def _planned_step(self, action: int) -> tuple[State, float]:
        """Return the state after a valid action, and the base displacement of its step [m]."""
        moves = self._present_moves()
        after = moves.take(self.state, action)
        reached = moves.stance_properties(after).base_position
        return after, distance(reached, self._properties.base_position)

    def _observation(self) -> Observation:
        """Return the observation of the present state."""
        return observation_of(self.graph, self.state, self._properties, self.goal, self._layouts)

    def _info(self, invalid: bool, failed: bool = False) -> dict[str, Any]:
        """Return the information on the present state and the last action."""
        properties = self._properties
        return {
            "stance": properties.ids,
            "base_position": np.array(properties.base_position),
            "base_translation": self.base_translation,
            "steps": self.steps,
            "limb_manipulability": properties.w_m.copy(),
            "base_manipulability": properties.w_b,
            "action_mask": self._mask.view(np.int8).copy(),
            "is_success": self._distance <= self.goal_tolerance,
            "invalid_action": invalid,
            **self._simulation_info,
            **self._task_info,
            "grasp_failed": failed,
        }

    @property
    def snapshot(self) -> Snapshot:
        """What a picture of the environment shows now."""
        return Snapshot(self.state, self.goal, self.steps, *self._last_event)

    def _record_event(self, caption: str, simulated: Motion | None) -> None:
        """Store what happened last, and show it if the render mode does."""
        self._last_event = caption, simulated
        if self.render_mode is not None:
            self.viewer.follow(self.snapshot, self.render_mode)

    def render(self) -> Any:
        """Return a picture, a list of pictures, or None, by the render mode.

        Raises a `RenderError` if no GL library works, or there is no screen for a window.
        """
        return self.viewer.render(self.snapshot, self.render_mode)

    def close(self) -> None:
        """Release the window or GL context."""
        self.viewer.close()
