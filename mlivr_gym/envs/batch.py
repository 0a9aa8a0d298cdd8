"""Kernels that step many two-limb sub-environments, and draw their starts and goals.

They read the tables of all steps; the kinematic `MlivrEnv` draws its tasks by them too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import NONE
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.envs.task import Task, TaskGenerator
from mlivr_gym.envs.tasks import MAX_WALK_STEPS, WalkTasks, draw_task, longest_axis
from mlivr_gym.errors import StanceError
from mlivr_gym.stances.moves import Moves, TableMoves
from mlivr_gym.stances.step_tables import state_of
from mlivr_gym.stances.table_steps import any_step, find_step
from mlivr_gym.transitions.rule import can_release, kept_on_edge

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mlivr_gym.envs.streams import Stream
    from mlivr_gym.stances.step_tables import StepTables
    from mlivr_gym.transitions.state import State
    from mlivr_gym.world.grasp_map import GraspMap

MAX_DRAWS = 1000
"""Number of draws after which no start and goal are considered to exist."""


class SubEnvStates(NamedTuple):
    """States of k sub-environments, which the kernels change."""

    stances: IntArray
    """Stance indices, shape (k,)."""
    branch_sets: IntArray
    """Branch sets of both limbs, shape (k, 2)."""
    streams: NDArray[np.uint64]
    """States of the random streams, shape (k,)."""


class ActionResults(NamedTuple):
    """What one action does in each of k states; `advance` writes it."""

    displacement: Array
    """Base displacement [m], shape (k,): there and back if the grasp fails, 0 without a step."""
    invalid: BoolArray
    """Whether the action is invalid, shape (k,)."""
    grasp_failed: BoolArray
    """Whether the attempt to grasp fails, shape (k,)."""
    edge: IntArray
    """Index of the step in the tables, or -1, shape (k,)."""
    after: IntArray
    """Index of the stance to which the step leads, shape (k,)."""

    @classmethod
    def of(cls, k: int) -> ActionResults:
        """Return arrays for k actions."""
        flags, indices = np.zeros((2, k), dtype=np.bool_), np.empty((2, k), dtype=np.int64)
        return cls(np.empty(k), flags[0], flags[1], indices[0], indices[1])


class TaskDistribution(NamedTuple):
    """Parameters of the distribution of starts and goals."""

    targets: Array
    """Positions of the graspable points [m], shape (m, 3)."""
    cabin: Array
    """Lower and upper corner of the box in which goals may lie [m], shape (2, 3)."""
    tolerance: float
    """Distance from the start within which a goal is drawn again [m]."""
    axis: int
    """Axis along which start and goal must lie in opposite halves of the map, or -1 for none."""
    middle: float
    """Coordinate on this axis at which the halves meet [m]."""

    @classmethod
    def of(cls, grasp_map: GraspMap, tolerance: float, tasks: WalkTasks) -> TaskDistribution:
        """Return the distribution of the tasks of a generator on a map."""
        axis, middle = longest_axis(grasp_map) if tasks.far else (-1, 0.0)
        return cls(grasp_map.positions, grasp_map.cabin, tolerance, axis, middle)


@entry
def random_below(streams: NDArray[np.uint64], k: int, bound: int) -> int:
    """Draw an integer from 0 to `bound` - 1 by splitmix64 (Steele, Lea and Flood, 2014).

    Of the states of random streams the one with index `k` is advanced.
    """
    streams[k] += np.uint64(0x9E3779B97F4A7C15)
    z = streams[k]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return int(np.float64(z >> np.uint64(11)) * (1.0 / 9007199254740992.0) * bound)


@entry
def advance(
    actions: IntArray,
    skip: BoolArray,
    failure_probability: Array,
    tables: StepTables,
    states: SubEnvStates,
    results: ActionResults,
) -> None:
    """Take one action, `limb * m + point`, in each of k states but those to skip.

    The states are changed. `failure_probability`, shape (m,), is the probability that an attempt to
    grasp each point fails. The flags of the results, which are written, are False before.
    """
    stances, branch_sets, displacement = states.stances, states.branch_sets, results.displacement
    streams, m = states.streams, len(failure_probability)
    # Distant memory is read for all sub-environments before it is used, so that the reads overlap.
    for k in range(len(actions)):
        results.edge[k] = find_step(stances[k], actions[k] // m, actions[k] % m, tables)
    for k in range(len(actions)):
        edge = results.edge[k]
        results.after[k] = tables.after[edge] if edge >= 0 else stances[k]
    for k in range(len(actions)):
        square = 0.0
        for axis in range(3):
            before, after = stances[k], results.after[k]
            square += (tables.base_position[before, axis] - tables.base_position[after, axis]) ** 2
        displacement[k] = 0.0 if skip[k] else np.sqrt(square)
    for k in range(len(actions)):
        if skip[k]:
            continue
        moving, point, edge = actions[k] // m, actions[k] % m, results.edge[k]
        held, s = 1 - moving, stances[k]
        kept = kept_on_edge(branch_sets[k, held], tables.kept[edge] if edge >= 0 else 0)
        if not kept or not can_release(branch_sets[k, moving], tables.releasable[s, moving]):
            displacement[k], results.invalid[k] = 0.0, True
            continue
        branch_sets[k, held] = kept
        risk = failure_probability[point]
        if risk > 0.0 and random_below(streams, k, 1 << 53) < risk * (1 << 53):
            branch_sets[k, moving] = tables.releasable[s, moving]
            displacement[k], results.grasp_failed[k] = 2.0 * displacement[k], True
            continue
        stances[k] = results.after[k]
        branch_sets[k, moving] = tables.releasable[stances[k], moving]


@kernel
def _walk_towards(
    s: int, branch_sets: tuple[int, int], target: Array, position: Array, tables: StepTables
) -> int:
    """Return the last stance of a walk whose base comes closer to a target [m] with every step.

    It begins at the stance `s` with branch sets of both limbs; base positions of the stances have
    shape (n, 3) [m].
    """
    start, after, kept, current, nearest = tables.start, tables.after, tables.kept, s, 0.0
    for axis in range(3):
        nearest += (position[s, axis] - target[axis]) ** 2
    for _ in range(MAX_WALK_STEPS):
        best = NONE
        for moving in range(2):
            if not can_release(branch_sets[moving], tables.releasable[current, moving]):
                continue
            for e in range(start[2 * current + moving], start[2 * current + moving + 1]):
                if kept_on_edge(branch_sets[1 - moving], kept[e]):
                    square = 0.0
                    for axis in range(3):
                        square += (position[after[e], axis] - target[axis]) ** 2
                    if square < nearest:
                        nearest, best = square, e
        if best < 0:
            break
        second = best >= start[2 * current + 1]
        current = after[best]
        if second:
            branch_sets = (
                kept_on_edge(branch_sets[0], kept[best]),
                int(tables.releasable[current, 1]),
            )
        else:
            branch_sets = (
                int(tables.releasable[current, 0]),
                kept_on_edge(branch_sets[1], kept[best]),
            )
    return current


def draw_task_with_tables(
    moves: Moves, tasks: TaskGenerator, stream: Stream, tolerance: float, start: State | None
) -> Task:
    """Draw a task as `tasks.draw_task` does, with tables of steps if the moves have them.

    Arguments and errors are the same, but the graph is that of the moves.
    """
    at_posture = start is None or start.pose is None
    if isinstance(moves, TableMoves) and isinstance(tasks, WalkTasks) and at_posture:
        return _draw_walk_task(moves, tasks, stream, tolerance, start)
    return draw_task(tasks, moves.graph, stream, tolerance, start)


def _draw_walk_task(
    moves: TableMoves, tasks: WalkTasks, stream: Stream, tolerance: float, start: State | None
) -> Task:
    """Draw the task of a `WalkTasks` with tables of steps, from the same numbers of the stream.

    A start that is given is in the posture of its stance. Raises a `StanceError` if no task is
    found.
    """
    tables, grasp_map = moves.tables, moves.graph.grasp_map
    stances, branch_sets, goals = (
        np.zeros(1, np.int64),
        np.zeros((1, 2), np.int64),
        np.empty((1, 3)),
    )
    is_drawn, has_start = np.ones(1, np.bool_), np.full(1, start is not None)
    if start is not None:
        stances[0], branch_sets[0] = moves.stance_at[start.stance], start.branch_sets
    states = SubEnvStates(stances, branch_sets, np.array([stream.state], dtype=np.uint64))
    distribution = TaskDistribution.of(grasp_map, tolerance, tasks)
    if draw_tasks(is_drawn, has_start, distribution, tables, states, goals) >= 0:
        raise StanceError(
            f"no goal that can be reached was found on map {grasp_map.name!r} in {MAX_DRAWS} draws"
        )
    stream.state = int(states.streams[0])
    return Task(
        state_of(tables, int(stances[0]), branch_sets[0]) if start is None else start, goals[0]
    )


@entry
def draw_tasks(
    is_drawn: BoolArray,
    has_start: BoolArray,
    distribution: TaskDistribution,
    tables: StepTables,
    states: SubEnvStates,
    goals: Array,
) -> int:
    """Draw starts and goals as `tasks.sample_task` does, from the same numbers of the streams.

    They are drawn for the sub-environments of `is_drawn`, whose starts are in `states` if
    `has_start`, and are written there otherwise, shape (k,) each; goals (k, 3) [m] are written.
    Returned is the index of the first one for which no task was found, or -1.
    """
    targets, cabin, tolerance = distribution.targets, distribution.cabin, distribution.tolerance
    axis, middle = distribution.axis, distribution.middle
    stances, branch_sets, streams = states.stances, states.branch_sets, states.streams
    position = tables.base_position
    n = len(position)
    for k in range(len(is_drawn)):
        if not is_drawn[k]:
            continue
        found = False
        for _ in range(MAX_DRAWS):
            if not has_start[k]:
                s = random_below(streams, k, n)
                set0, set1 = tables.branch_sets[s]
                if set0 == 0 or set1 == 0 or not any_step(s, (set0, set1), tables):
                    continue
                stances[k], branch_sets[k, 0], branch_sets[k, 1] = s, set0, set1
            s, set0, set1 = stances[k], branch_sets[k, 0], branch_sets[k, 1]
            target = targets[random_below(streams, k, len(targets))]
            side = position[s, axis] - middle
            if axis >= 0 and side * (target[axis] - middle) >= 0.0:
                continue
            end = _walk_towards(s, (set0, set1), target, position, tables)
            away, inside = 0.0, True
            for i in range(3):
                away += (position[end, i] - position[s, i]) ** 2
                goals[k, i] = position[end, i]
                inside = inside and cabin[0, i] <= position[end, i] <= cabin[1, i]
            if axis >= 0 and side * (position[end, axis] - middle) >= 0.0:
                continue
            if inside and away > tolerance * tolerance:
                found = True
                break
        if not found:
            return k
    return -1
