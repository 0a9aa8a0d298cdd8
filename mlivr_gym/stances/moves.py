"""What the environment asks of its world: which actions a state allows, where each leads, what a stance looks like.

`GraphMoves` asks the stance graph, for any number of limbs; `TableMoves` looks into exact tables,
for two.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.kinematics.holding import quaternion
from mlivr_gym.postures.solver import Postures
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph, State, Successors
from mlivr_gym.stances.step_tables import StepTables

REMEMBERED = 4096
"""States and stances that `GraphMoves` remembers."""

BITS = (np.arange(1 << 16)[:, None] >> np.arange(16) & 1).astype(np.int8)
"""The bits of each 16-bit mask, the lowest first, shape (65536, 16)."""


class Place(NamedTuple):
    """What a stance looks like: point ids, base position [m], manipulability, and its share of the observation."""

    ids: tuple[str, ...]
    position: tuple[float, ...]
    w_m: NDArray[np.float64]
    w_b: float
    observation: dict[str, NDArray[Any]]


def _place(graph: StanceGraph, stance: tuple[int, ...], posture: Postures) -> Place:
    observation = {
        "stance": np.array(stance, dtype=np.int64),
        "grasps": graph.grasp_map.positions[list(stance)].ravel().astype(np.float32),
        "base_position": posture.position[0].astype(np.float32),
        "base_quaternion": quaternion(posture.rotation[0]).astype(np.float32),
    }
    position = tuple(posture.position[0].tolist())
    return Place(graph.ids(stance), position, posture.w_m[0], float(posture.w_b[0]), observation)


class GraphMoves:
    """Moves worked out by a stance graph when they are asked for, and remembered for a while."""

    def __init__(self, graph: PairGraph | LazyGraph) -> None:
        """Start with nothing known."""
        self.graph = graph
        self._steps: OrderedDict[State, Successors] = OrderedDict()
        self._places: OrderedDict[tuple[int, ...], Place] = OrderedDict()

    def successors(self, state: State) -> Successors:
        """All steps that leave a state."""
        if state not in self._steps:
            self._steps[state] = self.graph.successors(state)
            if len(self._steps) > REMEMBERED:
                self._steps.popitem(last=False)
        return self._steps[state]

    def mask(self, state: State) -> NDArray[np.bool_]:
        """Which actions a state allows, shape (N m,)."""
        steps, m = self.successors(state), len(self.graph.grasp_map)
        out = np.zeros(self.graph.limbs * m, dtype=np.bool_)
        out[steps.limb * m + steps.point] = True
        return out

    def take(self, state: State, action: int) -> State:
        """Where an action that a state allows leads."""
        steps, (limb, point) = self.successors(state), divmod(action, len(self.graph.grasp_map))
        k = int(np.flatnonzero((steps.limb == limb) & (steps.point == point))[0])
        return State(
            (*state.stance[:limb], point, *state.stance[limb + 1 :]), tuple(steps.masks[k].tolist())
        )

    def releasable_after(self, state: State, steps: Successors) -> NDArray[np.bool_]:
        """Whether a limb that holds could let go after each step, shape (k,); taken for granted with more than two limbs."""
        out = np.ones(len(steps.limb), dtype=np.bool_)
        if isinstance(self.graph, PairGraph):
            for k, (limb, point) in enumerate(
                zip(steps.limb.tolist(), steps.point.tolist(), strict=True)
            ):
                stance = (*state.stance[:limb], point, *state.stance[limb + 1 :])
                landed = self.graph.landed(State(stance, ()), 1 - limb)
                out[k] = landed & steps.masks[k, 1 - limb] != 0
        return out

    def place_of(self, state: State) -> Place:
        """What a robot looks like that stands in a state."""
        if state.pose is None:
            return self.place(state.stance)
        return _place(self.graph, state.stance, self.graph.posture_of(state))

    def place(self, stance: tuple[int, ...]) -> Place:
        """What a stance looks like."""
        if stance not in self._places:
            self._places[stance] = _place(self.graph, stance, self.graph.posture(stance))
            if len(self._places) > REMEMBERED:
                self._places.popitem(last=False)
        return self._places[stance]


class TableMoves:
    """Moves looked up in exact tables."""

    def __init__(self, graph: PairGraph, tables: StepTables) -> None:
        """Put what observations need into arrays."""
        self.graph, self.tables = graph, tables
        self._from_given_pose = GraphMoves(graph)
        m = len(graph.grasp_map)
        self.stance_at = np.full((m, m), -1, dtype=np.int32)
        self.stance_at[tables.points[:, 0], tables.points[:, 1]] = np.arange(len(tables.points))
        moving = np.repeat(np.tile([0, 1], len(tables.points)), np.diff(tables.start))
        self._action = moving * m + tables.points[tables.after, moving]
        self._start = tables.start.tolist()
        self._places: dict[tuple[int, ...], Place] = {}
        self.observations: dict[str, NDArray[Any]] = {
            "stance": tables.points.astype(np.int64),
            "grasps": graph.grasp_map.positions[tables.points].reshape(-1, 6).astype(np.float32),
            "base_position": tables.position.astype(np.float32),
            "base_quaternion": np.array([quaternion(r) for r in graph.rotation], dtype=np.float32),
        }

    def successors(self, state: State) -> Successors:
        """All steps that leave a state."""
        if state.pose is not None:
            return self._from_given_pose.successors(state)
        return self.tables.successors(int(self.stance_at[state.stance]), state.masks)

    def mask(self, state: State) -> NDArray[np.bool_]:
        """Which actions a state allows, shape (2 m,)."""
        if state.pose is not None:
            return self._from_given_pose.mask(state)
        s = 2 * int(self.stance_at[state.stance])
        begin, middle, end = self._start[s], self._start[s + 1], self._start[s + 2]
        kept, actions = self.tables.kept, self._action
        out = np.zeros(2 * len(self.stance_at), dtype=np.bool_)
        leave = self.tables.releasable[s >> 1]
        if leave[0] & state.masks[0]:
            out[actions[begin:middle]] = kept[begin:middle] & state.masks[1]
        if leave[1] & state.masks[1]:
            out[actions[middle:end]] = kept[middle:end] & state.masks[0]
        return out

    def take(self, state: State, action: int) -> State:
        """Where an action that a state allows leads."""
        if state.pose is not None:
            return self._from_given_pose.take(state, action)
        s = int(self.stance_at[state.stance])
        begin, end = self._start[2 * s], self._start[2 * s + 2]
        step = begin + int(self._action[begin:end].searchsorted(action))
        after = int(self.tables.after[step])
        kept, landed = int(self.tables.kept[step]), self.tables.releasable[after].tolist()
        a, b = self.tables.points[after].tolist()
        if action < len(self.stance_at):
            return State((a, b), (landed[0], state.masks[1] & kept))
        return State((a, b), (state.masks[0] & kept, landed[1]))

    def releasable_after(self, state: State, steps: Successors) -> NDArray[np.bool_]:
        """Whether the limb that holds could let go after each step, shape (k,)."""
        a, b = np.array(state.stance, dtype=np.int64)[:, None].repeat(len(steps.limb), axis=1)
        first = steps.limb == 0
        after = self.stance_at[np.where(first, steps.point, a), np.where(first, b, steps.point)]
        held, k = 1 - steps.limb, np.arange(len(after))
        free: NDArray[np.bool_] = (self.tables.releasable[after, held] & steps.masks[k, held]) != 0
        return free

    def place_of(self, state: State) -> Place:
        """What a robot looks like that stands in a state."""
        return (
            self.place(state.stance)
            if state.pose is None
            else self._from_given_pose.place_of(state)
        )

    def place(self, stance: tuple[int, ...]) -> Place:
        """What a stance looks like, put together once."""
        found = self._places.get(stance)
        if found is None:
            s, graph = int(self.stance_at[stance]), self.graph
            observation = {name: rows[s] for name, rows in self.observations.items()}
            position = tuple(self.tables.position[s].tolist())
            found = Place(
                graph.ids(stance), position, graph.w_m[s], float(graph.w_b[s]), observation
            )
            self._places[stance] = found
        return found


def branch_bits(masks: tuple[int, ...]) -> NDArray[np.int8]:
    """The bits of 16-bit masks one after the other, shape (16 N,)."""
    return np.concatenate([BITS[mask] for mask in masks])
