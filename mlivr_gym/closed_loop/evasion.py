"""Ways out of the lanes of crew members: a search over stances and time.

The motion of crew members is known, so each stance has intervals of time in which its resting
posture keeps a distance from all of them. The search is safe-interval path planning (Phillips and
Likhachev 2011): a node is a stance in one of its intervals, with the earliest arrival in it. A step
takes `STEP_TIME`, in which the posture after it keeps the distance; the posture before it keeps it
until the step begins. This estimate chooses steps; the trajectory of a step is compared with the
crew before it is taken.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from itertools import count
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.closed_loop.crew import KEPT, LEAST_DISTANCE, CrewMember, distance_from_crew
from mlivr_gym.closed_loop.path_check import robot_axes, robot_radii
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.simulation.recording import Recording
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

PERIOD = 0.2
"""Time between two compared postures [s]."""

STEP_TIME = 8.0
"""Time of a step in the search, which steps at the default pace rarely exceed [s]."""

LEAST_STEP_TIME = 2.5
"""Time that no step at the default pace stays below [s]."""

MOST_EXPANDED = 300
"""Maximum number of stances that a search expands."""

EACH = slice(None, None, 2)
"""Samples of a recording at which the distance from crew members is measured."""

MOST_TRIED = 60
"""Number of first steps of ways out whose trajectories are compared with the crew."""

TRIED_IN_TURN = (KEPT, False), (KEPT, True), (LEAST_DISTANCE, True), (0.0, True)
"""Distance that a way out keeps [m], and whether its search is optimistic."""

PROOF = LEAST_DISTANCE, True
"""If none of these ways out is left at the start, crew members count as unavoidable."""


class EscapePath(NamedTuple):
    """The result of a search."""

    states: tuple[State, ...]
    """The present state and those after each step; in the last one the robot can stay for ever.
    Empty if no way was found."""
    is_exhausted: bool
    """Whether the search tried every sequence of steps that the graph has."""


class Evasion:
    """Ways out of the lanes of crew members."""

    def __init__(self, graph: StanceGraph, shapes: LimbShapes, crew: Sequence[CrewMember]) -> None:
        """Prepare the search among crew members for the robot of a graph."""
        self._graph, self._shapes, self._crew = graph, shapes, crew
        end = max((member.arrival for member in crew), default=0.0)
        self._times = np.arange(int(np.ceil(end / PERIOD)) + 2).astype(np.float64) * PERIOD
        self._distances = dict[State, Array]()

    def distances(self, state: State) -> Array:
        """Return the distance from the crew at rest at each time of the search, shape (k,) [m].

        The last one holds for all later times, when the crew has arrived.
        """
        if state not in self._distances:
            axes = robot_axes(self._graph.robot, self._shapes, self._graph.configuration(state))
            still = np.broadcast_to(axes, (len(self._times), *axes.shape))
            radii = robot_radii(self._shapes)
            self._distances[state] = distance_from_crew(still, radii, self._crew, self._times)
        return self._distances[state]

    def distance_during(self, recording: Recording) -> float:
        """Return the smallest distance from crew members in a recording [m]."""
        kept, robot = recording.part(EACH), self._graph.robot
        each = zip(kept.base_positions, kept.base_quaternions, kept.joint_positions, strict=True)
        axes = np.array([robot_axes(robot, self._shapes, configuration) for configuration in each])
        gaps = distance_from_crew(axes, robot_radii(self._shapes), self._crew, kept.times)
        return float(gaps.min())

    def escape(
        self,
        state: State,
        now: float,
        kept: float,
        refused: frozenset[tuple[int, ...]] = frozenset(),
        is_optimistic: bool = False,
    ) -> EscapePath:
        """Search for a way to a stance in which the robot can stay.

        Parameters
        ----------
        state
            The present state.
        now
            The present time [s].
        kept
            Distance to be kept [m].
        refused
            Stances to which the first step must not lead.
        is_optimistic
            Whether steps take only `LEAST_STEP_TIME`, and the posture after a step need not keep
            the distance before its end. If no such way is found, longer steps have none either.
        """
        last, number = len(self._times) - 1, count()
        begin = min(int(now / PERIOD), last)
        until = self._safe_until(state, begin, kept)
        if until <= begin:
            return EscapePath((), True)
        if until > last:
            return EscapePath((state,), False)
        queue: list[tuple[int, int, int, tuple[State, ...]]] = [
            (begin, next(number), until, (state,))
        ]
        seen = {(state, until)}
        for _ in range(MOST_EXPANDED):
            if not queue:
                return EscapePath((), True)
            arrival, _, until, path = heapq.heappop(queue)
            moves = self._graph.successors(path[-1])
            for row in self._farthest_first(moves.base_position, arrival):
                after = moves.after(path[-1], row)
                if len(path) == 1 and after.stance in refused:
                    continue
                for reached in self._arrivals(after, (arrival, until), kept, is_optimistic):
                    free = self._safe_until(after, reached, kept)
                    if free > last:
                        return EscapePath((*path, after), False)
                    if (after, free) not in seen:
                        seen.add((after, free))
                        heapq.heappush(queue, (reached, next(number), free, (*path, after)))
        return EscapePath((), not queue)

    def _farthest_first(self, positions: Array, begin: int) -> list[int]:
        """Return the rows of base positions in the order in which they are tried."""
        middles = np.concatenate([m.middles(self._times[begin:]) for m in self._crew])
        away = np.linalg.norm(positions[:, None] - middles, axis=2).min(axis=1)
        order: IntArray = np.argsort(-away, kind="stable")
        return list(order.tolist())

    def _safe_until(self, state: State, begin: int, kept: float) -> int:
        """Return the first time at which a stance is not safe, beyond the last one if none."""
        unsafe = self.distances(state)[begin:] < kept
        return begin + int(np.argmax(unsafe)) if unsafe.any() else len(self._times)

    def _arrivals(
        self, after: State, interval: tuple[int, int], kept: float, is_optimistic: bool
    ) -> list[int]:
        """Return the earliest end, in each interval of `after`, of steps that begin in another."""
        first, until = interval
        steps = round((LEAST_STEP_TIME if is_optimistic else STEP_TIME) / PERIOD)
        last = len(self._times) - 1
        ends = np.arange(first, until + (steps if until > last else 0)) + steps
        safe = self.distances(after)[np.minimum(np.arange(first, ends[-1] + 1), last)] >= kept
        if is_optimistic:
            able = safe[steps:]
        else:  # it keeps the distance during the whole step
            until_now = np.cumsum(np.append(0, safe))
            able = until_now[steps + 1 :] - until_now[: -steps - 1] == steps + 1
        is_first = able & ~np.append(False, able[:-1])
        return list(np.minimum(ends[is_first], last).tolist())
