"""Kernels of the vector environment: taking actions, and drawing starts and goals."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import NONE
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.envs.tasks import (
    MAX_WALK_STEPS,
    Task,
    TaskGenerator,
    WalkTasks,
    draw_task,
    longest_axis,
)
from mlivr_gym.errors import MlivrError, StanceError
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
"""Draws after which drawing a start and goal gives up."""


class CopyStates(NamedTuple):
    """States of k copies, one a copy of the environment."""

    stances: IntArray
    """Stance indices, shape (k,)."""
    masks: IntArray
    """Branches each limb may be on, shape (k, 2)."""
    streams: NDArray[np.uint64]
    """States of the random numbers, shape (k,)."""


class StepParameters(NamedTuple):
    """What an action may come to."""

    failure_probability: Array
    """Probability that an attempt at each point fails, shape (m,)."""
    max_step: float
    """Displacement charged for an action that is masked out [m]."""


class TaskDistribution(NamedTuple):
    """What starts and goals are drawn from."""

    targets: Array
    """Positions of the points [m], shape (m, 3)."""
    cabin: Array
    """Lower and upper corner of where goals may lie [m], shape (2, 3)."""
    tolerance: float
    """Goals nearer to the start than this are drawn again [m]."""
    axis: int
    """Axis along which start and goal must lie in opposite halves, -1 for none."""
    middle: float
    """Where the halves meet on it [m]."""

    @classmethod
    def of(cls, grasp_map: GraspMap, tolerance: float, tasks: WalkTasks) -> TaskDistribution:
        """What tasks on a map are drawn from."""
        axis, middle = longest_axis(grasp_map) if tasks.far else (-1, 0.0)
        return cls(grasp_map.positions, grasp_map.cabin, tolerance, axis, middle)


@entry
def random_below(streams: NDArray[np.uint64], k: int, bound: int) -> int:
    """Draw a whole number from 0 to `bound` - 1 by splitmix64 (Steele, Lea and Flood, 2014).

    Parameters
    ----------
    streams
        States of the random numbers, one of them changed.
    k
        Index of the stream to draw from.
    bound
        The bound.
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
    parameters: StepParameters,
    tables: StepTables,
    copies: CopyStates,
    moved: Array,
    outcome: IntArray,
) -> None:
    """Take one action in each of k states.

    Parameters
    ----------
    actions
        Limb times m plus point, shape (k,).
    skip
        States that take none, shape (k,).
    parameters
        What an action may come to.
    tables
        `StepTables`.
    copies
        The states, changed.
    moved
        Base displacement of each step [m], shape (k,), written.
    outcome
        0 done, 1 masked out, 2 the grasp failed and the limb went back; shape (k,),
        written.
    """
    stances, masks = copies.stances, copies.masks
    failure = parameters.failure_probability
    streams, max_step = copies.streams, parameters.max_step
    m = len(failure)
    for k in range(len(actions)):
        if skip[k]:
            continue
        moving, point = actions[k] // m, actions[k] % m
        held, s = 1 - moving, stances[k]
        e = find_step(s, moving, point, tables)
        kept = kept_on_edge(masks[k, held], tables.kept[e] if e >= 0 else 0)
        if not kept or not can_release(masks[k, moving], tables.releasable[s, moving]):
            moved[k], outcome[k] = max_step, 1
            continue
        s2, square = tables.after[e], 0.0
        for axis in range(3):
            square += (tables.base_in_world[s, axis] - tables.base_in_world[s2, axis]) ** 2
        moved[k], outcome[k] = np.sqrt(square), 0
        masks[k, held] = kept
        if failure[point] > 0.0 and random_below(streams, k, 1 << 53) < failure[point] * (1 << 53):
            masks[k, moving] = tables.releasable[s, moving]
            moved[k], outcome[k] = 2.0 * moved[k], 2
            continue
        masks[k, moving] = tables.releasable[s2, moving]
        stances[k] = s2


@kernel
def _walk_towards(
    s: int, masks: tuple[int, int], target: Array, position: Array, tables: StepTables
) -> int:
    """Stance at which a walk ends that goes nearer to a target with every step.

    Parameters
    ----------
    s
        Stance at which it begins.
    masks
        Branches that each limb may be on.
    target
        Where it goes [m], shape (3,).
    position
        Base positions of the stances [m], shape (n, 3).
    tables
        `StepTables`.
    """
    start, after, kept, here, nearest = tables.start, tables.after, tables.kept, s, 0.0
    for axis in range(3):
        nearest += (position[s, axis] - target[axis]) ** 2
    for _ in range(MAX_WALK_STEPS):
        best = NONE
        for moving in range(2):
            if not can_release(masks[moving], tables.releasable[here, moving]):
                continue
            for e in range(start[2 * here + moving], start[2 * here + moving + 1]):
                if kept_on_edge(masks[1 - moving], kept[e]):
                    square = 0.0
                    for axis in range(3):
                        square += (position[after[e], axis] - target[axis]) ** 2
                    if square < nearest:
                        nearest, best = square, e
        if best < 0:
            break
        second = best >= start[2 * here + 1]
        here = after[best]
        if second:
            masks = kept_on_edge(masks[0], kept[best]), int(tables.releasable[here, 1])
        else:
            masks = int(tables.releasable[here, 0]), kept_on_edge(masks[1], kept[best])
    return here


def draw_task_with_tables(
    moves: Moves, tasks: TaskGenerator, stream: Stream, tolerance: float, start: State | None
) -> Task:
    """A task as `tasks.draw_task` distribution it, from tables of steps where there are any.

    Arguments and errors are those; the graph is that of the moves. Where none is found no number of
    the stream is taken.
    """
    at_posture = start is None or start.pose is None
    if isinstance(moves, TableMoves) and isinstance(tasks, WalkTasks) and at_posture:
        return _draw_walk_task(moves, tasks, stream, tolerance, start)
    before = stream.state
    try:
        return draw_task(tasks, moves.graph, stream, tolerance, start)
    except MlivrError:
        stream.state = before
        raise


def _draw_walk_task(
    moves: TableMoves, tasks: WalkTasks, stream: Stream, tolerance: float, start: State | None
) -> Task:
    """A task as `tasks` distribution it, number for number of the same stream, over tables of steps.

    Parameters
    ----------
    moves
        Moves of the tables.
    tasks
        What distribution it.
    stream
        Where its numbers come from.
    tolerance
        Radius of the goal region [m].
    start
        The start, in the posture of its stance, if it is given.

    Raises
    ------
    StanceError
        If none is found.
    """
    tables, grasp_map = moves.tables, moves.graph.grasp_map
    stances, masks, goals = np.zeros(1, np.int64), np.zeros((1, 2), np.int64), np.empty((1, 3))
    which, given = np.ones(1, np.bool_), np.full(1, start is not None)
    if start is not None:
        stances[0], masks[0] = moves.stance_at[start.stance], start.masks
    copies = CopyStates(stances, masks, np.array([stream.state], dtype=np.uint64))
    distribution = TaskDistribution.of(grasp_map, tolerance, tasks)
    if draw_tasks(which, given, distribution, tables, copies, goals) >= 0:
        raise StanceError(
            f"no goal that can be reached was found on map {grasp_map.name!r} in {MAX_DRAWS} distribution"
        )
    stream.state = int(copies.streams[0])
    return Task(state_of(tables, int(stances[0]), masks[0]) if start is None else start, goals[0])


@entry
def draw_tasks(
    which: BoolArray,
    given: BoolArray,
    distribution: TaskDistribution,
    tables: StepTables,
    copies: CopyStates,
    goals: Array,
) -> int:
    """Draw starts and goals as `tasks.sample_task` does, number for number of the same stream.

    Returns the index of the first state for which none was found, or -1.

    Parameters
    ----------
    which
        States to draw, shape (k,).
    given
        Those of them whose start is given by `copies`, shape (k,).
    distribution
        What they are drawn from.
    tables
        `StepTables`.
    copies
        Stances and masks are written where not given.
    goals
        Shape (k, 3) [m], written.
    """
    targets, cabin, tolerance = distribution.targets, distribution.cabin, distribution.tolerance
    axis, middle = distribution.axis, distribution.middle
    stances, masks, streams = copies.stances, copies.masks, copies.streams
    position = tables.base_in_world
    n = len(position)
    for k in range(len(which)):
        if not which[k]:
            continue
        found = False
        for _ in range(MAX_DRAWS):
            if not given[k]:
                s = random_below(streams, k, n)
                mask0, mask1 = tables.masks[s]
                if mask0 == 0 or mask1 == 0 or not any_step(s, (mask0, mask1), tables):
                    continue
                stances[k], masks[k, 0], masks[k, 1] = s, mask0, mask1
            s, mask0, mask1 = stances[k], masks[k, 0], masks[k, 1]
            target = targets[random_below(streams, k, len(targets))]
            side = position[s, axis] - middle
            if axis >= 0 and side * (target[axis] - middle) >= 0.0:
                continue
            here = _walk_towards(s, (mask0, mask1), target, position, tables)
            away, inside = 0.0, True
            for i in range(3):
                away += (position[here, i] - position[s, i]) ** 2
                goals[k, i] = position[here, i]
                inside = inside and cabin[0, i] <= position[here, i] <= cabin[1, i]
            if axis >= 0 and side * (position[here, axis] - middle) >= 0.0:
                continue
            if inside and away > tolerance * tolerance:
                found = True
                break
        if not found:
            return k
    return -1
