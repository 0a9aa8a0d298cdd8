"""Tasks: objects that draw starts and goals which the stance graph joins.

A generator is anything with the method `draw` of `TaskGenerator`; `"walk"` is short for
`WalkTasks()`, `"far"` for `WalkTasks(far=True)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from mlivr_gym.arguments import Via
from mlivr_gym.arrays import Array
from mlivr_gym.envs.streams import Stream
from mlivr_gym.errors import SettingError, StanceError, shortened
from mlivr_gym.schema import Choice, FieldPath, Whole
from mlivr_gym.stances.random_states import TRIES, Randomness, random_state
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import GraspMap

MAX_WALK_STEPS = 12
"""Most steps of the walk that leads from the start to the goal."""


class Task(NamedTuple):
    """Where to start and where to go."""

    start: State
    """The start."""
    goal: Array
    """Goal position of the base [m], shape (3,)."""


class TaskGenerator(Protocol):
    """What draws tasks."""

    def draw(
        self,
        graph: StanceGraph,
        rng: np.random.Generator,
        tolerance: float,
        start: State | None = None,
    ) -> Task:
        """A task whose goal can be reached from its start.

        Parameters
        ----------
        graph
            The stance graph.
        rng
            Source of randomness.
        tolerance
            Radius of the goal region [m].
        start
            The start, if it is given.

        Raises
        ------
        StanceError
            If none is found.
        """


@dataclass(frozen=True)
class WalkTasks:
    """A random start, and the goal where a walk towards a random graspable point ends.

    For two limbs the start is a stance of the graph, drawn by its index until a step leaves it;
    then a point is drawn by its index. Each of at most `MAX_WALK_STEPS` steps goes to the stance whose
    base is nearest to that point, the first of them in the order of the graph, as long as that is
    nearer than before. If the walk ends outside the cabin, or not farther from the start than the
    goal tolerance, both are drawn again, or the point alone if the start is given.

    Attributes
    ----------
    far
        Whether start and point, and start and goal, must lie in opposite halves of the map
        along its longest axis, see `longest_axis`; what does not is drawn again too.
    """

    far: bool = False

    def draw(
        self,
        graph: StanceGraph,
        rng: Randomness,
        tolerance: float,
        start: State | None = None,
    ) -> Task:
        """See `TaskGenerator.draw`."""
        return sample_task(graph, rng, tolerance, start, far=self.far)

    def to_dict(self) -> dict[str, Any]:
        """Plain data that `TASKS` takes."""
        return {"kind": "far" if self.far else "walk"}


TASK_GENERATORS = {"walk": WalkTasks(), "far": WalkTasks(far=True)}
"""The task generators by name."""


def _read_generator(given: Any, place: FieldPath) -> TaskGenerator:
    """A task generator by name, from plain data, or as it is; a class of them is none."""
    name = given.get("kind") if isinstance(given, dict) else given
    if isinstance(name, str):
        return TASK_GENERATORS[Choice(tuple(TASK_GENERATORS)).read(name, place)]
    if isinstance(given, dict | type) or not callable(getattr(given, "draw", None)):
        valid = ", ".join(map(repr, TASK_GENERATORS))
        raise place.refused(given, f"one of {valid} or a TaskGenerator")
    generator: TaskGenerator = given
    return generator


TASKS = Via(_read_generator)
"""A task generator by name, from plain data (`to_dict`), or as it is."""


FIRST_FIXED_SEED = 1 << 62
"""Seed of the first fixed task; those of training are to be smaller."""

MAX_FIXED_TASKS = 1_000_000
"""Fixed tasks that there are."""


FIXED_NUMBER = Whole(0, MAX_FIXED_TASKS - 1)
"""Number of a fixed task."""


def fixed_task(generator: TaskGenerator, graph: StanceGraph, number: int, tolerance: float) -> Task:
    """The fixed task of a number: the same in every process, and drawn in no training.

    Parameters
    ----------
    generator
        What draws it.
    graph
        The stance graph.
    number
        A `FIXED_NUMBER`.
    tolerance
        Radius of the goal region [m].

    Raises
    ------
    MlivrError
        If no task is found.
    """
    return draw_task(generator, graph, Stream.of_seed(FIRST_FIXED_SEED + number), tolerance)


def longest_axis(grasp_map: GraspMap) -> tuple[int, float]:
    """The axis along which a map's points spread farthest, and their middle on it [m]."""
    low, high = grasp_map.positions.min(axis=0), grasp_map.positions.max(axis=0)
    axis = int(np.argmax(high - low))
    return axis, float(0.5 * (low[axis] + high[axis]))


def draw_task(
    generator: TaskGenerator,
    graph: StanceGraph,
    stream: Stream,
    tolerance: float,
    start: State | None = None,
) -> Task:
    """Draw a task, and check it where the generator is a user's; arguments as in `TaskGenerator`.

    A user's generator draws from `numpy.random.default_rng(stream.state)`, with a whole number of
    which below 2^63 the stream then goes on.

    Raises
    ------
    MlivrError
        If none is found, or the start cannot be held or the goal lies outside the
        cabin.
    """
    if isinstance(generator, WalkTasks):
        return generator.draw(graph, stream, tolerance, start)
    rng = np.random.default_rng(stream.state)
    task = generator.draw(graph, rng, tolerance, start)
    stream.state = int(rng.integers(2**63))
    if not isinstance(task.start, State):
        raise SettingError(f"tasks draw the start {shortened(task.start)}; it must be a State")
    graph.state(task.start.stance, task.start.pose)
    graph.check(task.start)
    return Task(task.start, graph.grasp_map.check_goal(task.goal))


def sample_task(
    graph: StanceGraph,
    rng: Randomness,
    tolerance: float,
    start: State | None = None,
    *,
    far: bool = False,
) -> Task:
    """A start and a goal that a walk over edges joins; see `WalkTasks`.

    Parameters
    ----------
    graph
        The stance graph.
    rng
        Source of randomness.
    tolerance
        Goals closer to the start than this are drawn again [m].
    start
        The start, if it is given.
    far
        See `WalkTasks`.

    Raises
    ------
    StanceError
        If no pair is found.
    """
    grasp_map = graph.grasp_map
    axis, middle = longest_axis(grasp_map)
    for _ in range(TRIES):
        state = random_state(graph, rng) if start is None else start
        target = grasp_map.positions[int(rng.integers(len(grasp_map)))]
        origin = graph.posture_of(state).base_position[0]
        if far and (origin[axis] - middle) * (target[axis] - middle) >= 0.0:
            continue
        position = _walk_end(graph, state, origin, target)
        if far and (origin[axis] - middle) * (position[axis] - middle) >= 0.0:
            continue
        inside = (position >= grasp_map.cabin[0]).all() and (position <= grasp_map.cabin[1]).all()
        if inside and _squared_lengths(position - origin) > tolerance * tolerance:
            return Task(state, position)
    raise StanceError(
        f"no goal that can be reached was found on map {grasp_map.name!r} in {TRIES} draws"
    )


def _walk_end(graph: StanceGraph, state: State, origin: Array, target: Array) -> Array:
    """Base position at the end of a walk from `origin` towards `target` [m]."""
    best, position = float(_squared_lengths(origin - target)), origin
    for _ in range(MAX_WALK_STEPS):
        steps = graph.successors(state)
        if not steps:
            break
        square = _squared_lengths(steps.base_in_world - target)
        k = int(np.argmin(square))
        if square[k] >= best:
            break
        best, position, state = float(square[k]), steps.base_in_world[k], steps.after(state, k)
    return position


def _squared_lengths(vectors: Array) -> Array:
    """Squared lengths of vectors, shape (..., 3), summed in the order of `envs.batch`."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    square: Array = x * x + y * y + z * z
    return square
