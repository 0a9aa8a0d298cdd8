"""The actions that a state allows, the states that they lead to, and the base poses there.

Environments, baselines and policies read a stance graph by `Moves`, for any number of limbs, or by
`TableMoves`, which reads step tables, for two. An action is `limb * m + point` on a map of m
points.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import StepTables
from mlivr_gym.stances.table_steps import valid_actions
from mlivr_gym.transitions.rule import can_release
from mlivr_gym.transitions.state import State, Successors

CACHED_RESULTS = 4096
"""Number of states and of stances whose results `Moves` stores."""


class StanceProperties(NamedTuple):
    """Base pose and manipulability of a robot in a state."""

    ids: tuple[str, ...]
    """Point id of each limb."""
    base_position: tuple[float, ...]
    """Base position x, y, z in the world [m]."""
    seen: tuple[NDArray[Any], ...]
    """What an observation has: points held, their positions, limb by limb [m], base position [m]
    and orientation w, x, y, z in the world, shapes (N,), (3 N,), (3,), (4,)."""
    w_m: Array
    """Limb manipulability, shape (N,)."""
    w_b: float
    """Base manipulability."""


def _properties(graph: StanceGraph, stance: tuple[int, ...], posture: Postures) -> StanceProperties:
    """Return the properties of a stance, of which `posture` is the posture."""
    position = tuple(posture.base_position[0].tolist())
    seen = _seen(graph, stance, position, quaternion(posture.base_rotation[0]))
    return StanceProperties(
        graph.ids(stance), position, seen, posture.w_m[0], float(posture.w_b[0])
    )


def _seen(
    graph: StanceGraph, stance: tuple[int, ...], position: tuple[float, ...], turn: Array
) -> tuple[NDArray[Any], ...]:
    """Return what an observation has of a stance, see `StanceProperties`."""
    points = np.array(stance, dtype=np.int64)
    grasps = graph.grasp_map.positions[points].ravel()
    return points, *(np.array(one, dtype=np.float32) for one in (grasps, position, turn))


class Moves:
    """Moves that a stance graph computes on demand, the latest of which are stored."""

    def __init__(self, graph: StanceGraph) -> None:
        """Start with no results."""
        self.graph = graph
        self._steps: dict[State, Successors] = {}
        self._properties: dict[tuple[int, ...], StanceProperties] = {}

    def successors(self, state: State) -> Successors:
        """Return all steps that leave a state."""
        found = self._steps.get(state)
        if found is None:
            found = self._steps[state] = self.graph.successors(state)
            if len(self._steps) > CACHED_RESULTS:
                del self._steps[next(iter(self._steps))]
        return found

    def action_mask(self, state: State) -> BoolArray:
        """Return which actions are valid in a state, shape (N m,)."""
        steps, m = self.successors(state), len(self.graph.grasp_map)
        out = np.zeros(self.graph.limbs * m, dtype=np.bool_)
        out[steps.limb * m + steps.point] = True
        return out

    def take(self, state: State, action: int) -> State:
        """Return the state that a valid action leads to."""
        steps = self.successors(state)
        return steps.after(state, steps.find(*divmod(action, len(self.graph.grasp_map))))

    def releasable_after(self, state: State, steps: Successors) -> BoolArray:
        """Return whether a support limb could be released after each step, shape (k,)."""
        return self.graph.releasable_after(state, steps)

    def stance_properties(self, state: State) -> StanceProperties:
        """Return base pose and manipulability in a state."""
        if state.pose is not None:
            return _properties(self.graph, state.stance, self.graph.posture_of(state))
        found = self._properties.get(state.stance)
        if found is None:
            found = _properties(self.graph, state.stance, self.graph.posture(state.stance))
            self._properties[state.stance] = found
            if len(self._properties) > CACHED_RESULTS:
                del self._properties[next(iter(self._properties))]
        return found


class TableMoves(Moves):
    """Moves from step tables."""

    def __init__(self, graph: StanceGraph, tables: StepTables) -> None:
        """Index the stances of the tables by their points."""
        super().__init__(graph)
        self.tables = tables
        m = len(graph.grasp_map)
        self.stance_at = np.full((m, m), -1, dtype=np.int32)
        """Stance index by the points of both limbs, -1 if there is none, shape (m, m)."""
        self.stance_at[tables.points[:, 0], tables.points[:, 1]] = np.arange(len(tables.points))
        self._start = tables.start.tolist()
        self._quaternions = quaternion(graph.base_rotation)
        self._w_m, self._w_b = graph.w_m, graph.w_b.tolist()

    def successors(self, state: State) -> Successors:
        """Return all steps that leave a state."""
        if state.pose is not None:
            return super().successors(state)
        return self.tables.successors(int(self.stance_at[state.stance]), state.branch_sets)

    def action_mask(self, state: State) -> BoolArray:
        """Return which actions are valid in a state, shape (2 m,)."""
        if state.pose is not None:
            return super().action_mask(state)
        out = np.zeros((1, 2, len(self.stance_at)), dtype=np.int8)
        stance = np.array([self.stance_at[state.stance]], dtype=np.int64)
        valid_actions(stance, np.array([state.branch_sets], dtype=np.int64), self.tables, out)
        return out.ravel().view(np.bool_)

    def take(self, state: State, action: int) -> State:
        """Return the state that a valid action leads to."""
        if state.pose is not None:
            return super().take(state, action)
        limb, point = divmod(action, len(self.stance_at))
        of_limb = 2 * int(self.stance_at[state.stance]) + limb
        begin, end = self._start[of_limb], self._start[of_limb + 1]
        step = begin + int(self.tables.to_point[begin:end].searchsorted(np.uint16(point)))
        branch_sets = self.tables.branch_sets_after(step, limb, state.branch_sets)
        return State(state.stance_after(limb, point), branch_sets)

    def releasable_after(self, state: State, steps: Successors) -> BoolArray:
        """Return whether the support limb could be released after each step, shape (k,)."""
        a, b = np.array(state.stance, dtype=np.int64)[:, None].repeat(len(steps.limb), axis=1)
        first = steps.limb == 0
        after = self.stance_at[np.where(first, steps.point, a), np.where(first, b, steps.point)]
        support = 1 - steps.limb
        kept = np.take_along_axis(steps.branch_sets, support[:, None], axis=1)[:, 0]
        free = map(can_release, kept.tolist(), self.tables.releasable[after, support].tolist())
        return np.fromiter(free, dtype=np.bool_, count=len(after))

    def stance_properties(self, state: State) -> StanceProperties:
        """Return base pose and manipulability in a state."""
        if state.pose is not None:
            return super().stance_properties(state)
        found = self._properties.get(state.stance)
        if found is None:
            graph, stance = self.graph, state.stance
            s = int(self.stance_at[stance])
            base = tuple(self.tables.base_position[s].tolist())
            seen = _seen(graph, stance, base, self._quaternions[s])
            found = StanceProperties(graph.ids(stance), base, seen, self._w_m[s], self._w_b[s])
            self._properties[state.stance] = found
        return found
