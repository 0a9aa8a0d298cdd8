"""Ways out of the lanes of crew members: a search over stances and time.

The motion of crew members is known, so each resting posture has intervals of time in which it keeps
a distance from all of them. The search is safe-interval path planning (Phillips and Likhachev
2011): a node is a posture in one of its intervals, with the earliest arrival in it. Steps are lazy
edges: each first counts with the least time that any step takes, and its trajectory is made, and
compared with the crew, when its turn has come.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from itertools import count
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.closed_loop.crew import KEPT, LEAST_DISTANCE, CrewMember, distance_from_crew
from mlivr_gym.closed_loop.path_check import PathCheck, robot_axes, robot_radii
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.simulation.recording import Failure, Recording
from mlivr_gym.simulation.step_executor import PreparedStep, StepExecutor
from mlivr_gym.transitions.state import State

PERIOD = 0.2
"""Time between two compared resting postures [s]."""

WAIT = 1.0
"""Difference of the times for which the robot may wait before a step [s]."""

LEAST_STEP_TIME = 2.5
"""Time that no step at the default pace stays below [s]."""

MOST_TRIED = 150
"""Maximum number of steps with a trajectory in one search."""

EACH = slice(None, None, 2)
"""Samples of a recording at which the distance from crew members is measured."""

DELAY = 2.0
"""Time by which steps rarely last longer than their trajectories [s]."""

TRIED_IN_TURN = (KEPT, DELAY), (KEPT, 0.0), (LEAST_DISTANCE, 0.0), (0.0, 0.0)
"""Distance that a way out keeps by prediction [m], and the delay of its steps [s]."""

PROOF = LEAST_DISTANCE, 0.0
"""If no such way out is left at the start, crew members count as unavoidable."""


class Rest(NamedTuple):
    """A robot at rest in a stance."""

    state: State
    """The state, with one branch for each limb."""
    joints: Array
    """Joint angles, shape (N, 6) [rad]."""


class EvasiveStep(NamedTuple):
    """A step of a way out."""

    prepared: PreparedStep
    """The step."""
    wait: float
    """Time to wait before it [s]."""


class EscapePath(NamedTuple):
    """A way to a stance in which the robot can stay for ever."""

    steps: tuple[EvasiveStep, ...] | None
    """The steps; None if no way was found."""
    is_exhausted: bool = False
    """Whether the search tried every sequence of steps that the graph has."""


class _Arrival(NamedTuple):
    """A node: the robot at rest from its arrival until a crew member comes."""

    rest: Rest
    begin: float
    """Time of the arrival [s]."""
    until: float
    """Time until which it can stay [s]."""
    steps: tuple[EvasiveStep, ...]
    """The steps that lead here."""


class _Edge(NamedTuple):
    """A step from a node whose trajectory was not made yet."""

    arrival: _Arrival
    after: State
    limb: int
    point: int


_Item = tuple[bool, float, int, _Arrival | _Edge]
"""Element of the queue: priority, number in the order of insertion, and node or edge."""


class Evasion:
    """Ways out of the lanes of crew members."""

    def __init__(
        self, executor: StepExecutor, shapes: LimbShapes, crew: Sequence[CrewMember]
    ) -> None:
        """Prepare the search among crew members for the robot that an executor moves."""
        self._executor, self._graph, self._shapes = executor, executor.graph, shapes
        self._crew, self._radii = crew, robot_radii(shapes)
        self.end = max((member.arrival for member in crew), default=0.0)
        self._distances = dict[tuple[State, bytes], Array]()
        self._checks = dict[tuple[object, ...], tuple[PreparedStep, PathCheck] | None]()
        self._version = self._graph.version

    def distance_during(self, recording: Recording) -> float:
        """Return the smallest distance from crew members in a recording [m]."""
        kept, robot = recording.part(EACH), self._graph.robot
        each = zip(kept.base_positions, kept.base_quaternions, kept.joint_positions, strict=True)
        axes = np.array([robot_axes(robot, self._shapes, configuration) for configuration in each])
        return float(distance_from_crew(axes, self._radii, self._crew, kept.times).min())

    def waiting_time(self, rest: Rest, prepared: PreparedStep, now: float) -> float | None:
        """Return the shortest time to wait before a step after which there is a way out [s].

        All the time the robot is to keep the distance `KEPT`; None is returned if it cannot.
        """
        path = PathCheck(self._graph, self._shapes, prepared.trajectory)
        here = _Arrival(rest, now, self._safe_until(rest, now, KEPT), ())
        for arrival in self._arrivals(here, prepared, path, (KEPT, DELAY)):
            if self.escape(arrival.rest, arrival.begin, (KEPT, DELAY)).steps is not None:
                return arrival.steps[0].wait
        return None

    def departure(self, rest: Rest, now: float) -> PreparedStep | None:
        """Return a step from where the robot is, if crew members come nearer to it than `KEPT`.

        It is any step. None is returned if the robot can stay, or has no step.
        """
        if now >= self.end or self._safe_until(rest, now, KEPT) == np.inf:
            return None
        moves = self._graph.successors(rest.state)
        for k in range(len(moves.limb)):
            limb, point = int(moves.limb[k]), int(moves.point[k])
            branch_sets = moves.after(rest.state, k).branch_sets
            step = self._executor.prepared(limb, point, branch_sets, rest)
            if not isinstance(step, Failure):
                return step
        return None

    def escape(
        self, rest: Rest, now: float, margins: tuple[float, float], most: int | None = None
    ) -> EscapePath:
        """Search for a way to a stance in which the robot can stay, from where it is at a time [s].

        The margins are the distance to be kept [m], and the time by which each step may last longer
        than its trajectory [s]; `most` is the maximum number of steps with a trajectory, by default
        `MOST_TRIED`.
        """
        (kept, _), most = margins, MOST_TRIED if most is None else most
        until, number, tried = self._safe_until(rest, now, kept), count(), 0
        if until <= now:
            return EscapePath(None, is_exhausted=True)
        queue: list[_Item] = [(False, now, next(number), _Arrival(rest, now, until, ()))]
        earliest = {(_key(rest), until): now}
        while queue:
            *_, node = heapq.heappop(queue)
            if isinstance(node, _Edge):
                if tried == most:
                    return EscapePath(None)
                tried += 1
                for found in self._tried(node, margins):
                    key = _key(found.rest), found.until
                    if found.begin < earliest.get(key, np.inf):
                        earliest[key] = found.begin
                        is_passing = found.until < np.inf
                        heapq.heappush(queue, (is_passing, found.begin, next(number), found))
            elif node.until == np.inf:
                return EscapePath(node.steps)
            else:
                for is_passing, edge in self._edges(node, kept):
                    time = node.begin + LEAST_STEP_TIME
                    heapq.heappush(queue, (is_passing, time, next(number), edge))
        return EscapePath(None, is_exhausted=True)

    def _edges(self, node: _Arrival, kept: float) -> list[tuple[bool, _Edge]]:
        """Return the steps from a node, the farthest from the crew first.

        With each is told whether crew members seem to come where it leads.
        """
        state = node.rest.state
        moves, earliest = self._graph.successors(state), node.begin + LEAST_STEP_TIME
        afterwards = np.arange(earliest, max(self.end, earliest) + 2.0 * PERIOD, PERIOD)
        middles = np.concatenate([member.middles(afterwards) for member in self._crew])
        away = np.linalg.norm(moves.base_position[:, None] - middles, axis=2).min(axis=1)
        edges = []
        for k in np.argsort(-away, kind="stable").tolist():
            after = moves.after(state, k)
            there = Rest(after, self._graph.configuration(after)[2])
            is_passing = self._safe_until(there, earliest, kept) < np.inf
            edges.append((is_passing, _Edge(node, after, int(moves.limb[k]), int(moves.point[k]))))
        return edges

    def _tried(self, edge: _Edge, margins: tuple[float, float]) -> Iterator[_Arrival]:
        """Make the trajectory of a step; yield the nodes to which it leads."""
        if self._version != self._graph.version:
            self._checks.clear()
            self._version = self._graph.version
        rest, key = edge.arrival.rest, (*_key(edge.arrival.rest), edge.after)
        if key not in self._checks:
            prepared = self._executor.prepared(edge.limb, edge.point, edge.after.branch_sets, rest)
            self._checks[key] = None if isinstance(prepared, Failure) else (
                prepared, PathCheck(self._graph, self._shapes, prepared.trajectory)
            )  # fmt: skip
        if (checked := self._checks[key]) is not None:
            yield from self._arrivals(edge.arrival, *checked, margins)

    def _arrivals(
        self, here: _Arrival, prepared: PreparedStep, path: PathCheck, margins: tuple[float, float]
    ) -> Iterator[_Arrival]:
        """Yield the nodes to which a step leads from another one, after different waits.

        The step keeps a distance [m], and may be delayed [s].
        """
        (kept, delay), duration, found = margins, float(path.times[-1]), set[float]()
        latest = min(here.until, max(self.end, here.begin + WAIT))
        after = Rest(prepared.after, prepared.trajectory.joint_positions[-1])
        for wait in np.arange(0.0, latest - here.begin, WAIT).tolist():
            if self._is_clear(path, here.begin + wait, kept):
                end = here.begin + wait + duration
                until = self._safe_until(after, end, kept)
                if until > end + delay and until not in found:
                    found.add(until)
                    steps = (*here.steps, EvasiveStep(prepared, wait))
                    yield _Arrival(after, end + delay, until, steps)

    def _is_clear(self, path: PathCheck, begin: float, kept: float) -> bool:
        """Return whether the robot keeps a distance on a path that begins at some time."""
        gaps = distance_from_crew(path.axes, self._radii, self._crew, begin + path.times)
        return bool(gaps.min() >= kept)

    def _safe_until(self, rest: Rest, begin: float, kept: float) -> float:
        """Return the first time at which a resting posture is not safe; infinite if it stays so.

        It is `begin` if it is not safe then.
        """
        key = _key(rest)
        if key not in self._distances:
            position, quaternion, _ = self._graph.configuration(rest.state)
            axes = robot_axes(self._graph.robot, self._shapes, (position, quaternion, rest.joints))
            times = PERIOD * np.arange(int(np.ceil(self.end / PERIOD)) + 2, dtype=np.float64)
            still = np.broadcast_to(axes, (len(times), *axes.shape))
            self._distances[key] = distance_from_crew(still, self._radii, self._crew, times)
        distances = self._distances[key]
        first = min(int(begin / PERIOD), len(distances) - 1)
        unsafe: BoolArray = distances[first:] < kept
        return max(begin, PERIOD * (first + int(np.argmax(unsafe)))) if unsafe.any() else np.inf


def _key(rest: Rest) -> tuple[State, bytes]:
    """Return what tells a resting posture from others."""
    return rest.state, np.round(rest.joints, 6).tobytes()
