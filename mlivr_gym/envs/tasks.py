"""Tasks: generators that draw starts and goals which a walk of valid steps connects.

Any object with the method `draw` of `TaskGenerator` is a generator. The names `"walk"`, `"far"`,
`"anywhere"`, `"random"` and `"clutter"` stand for `WalkTasks()`, `WalkTasks(far=True)`,
`AnywhereTasks()`, `LayoutTasks()` and `LayoutTasks(clustered=True)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mlivr_gym.arguments import NOT_NEGATIVE, Reader, checked
from mlivr_gym.arrays import Array
from mlivr_gym.envs.layout_tasks import LayoutTasks
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.task import Task, TaskGenerator
from mlivr_gym.errors import SettingError, StanceError, shortened
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.outcome import GOAL_REACHED
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.planners.searches import GraphSearcher
from mlivr_gym.schema import NAME, Choice, FieldPath, Fields, Flag, Integer
from mlivr_gym.stances.random_states import TRIES, Randomness, random_state
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import GraspMap

MAX_WALK_STEPS = 12
"""Maximum number of steps of the walk by which `WalkTasks` finds a goal from its start."""


@dataclass(frozen=True)
class WalkTasks:
    """Task generator whose goal is the end of a walk from the start towards a random point.

    The start is a random stance, drawn again until a step leaves it. With two limbs it is drawn
    from all stances of the graph, with more from those around a random point, see
    `stances.random_states`. Then a point of the map is drawn. Each of at most `MAX_WALK_STEPS`
    steps goes to the stance whose base is closest to that point, the first one in the order of the
    graph if several are, while the distance decreases. If the walk ends outside the cabin or within
    the goal tolerance of the start, both are drawn again, or only the point if the start is given.

    Attributes
    ----------
    far
        Whether start and point, and start and goal, must lie in opposite halves of the map along
        its longest axis, see `longest_axis`; if they do not, they are drawn again too. Both may be
        near the middle.
    """

    far: bool = False

    def __post_init__(self) -> None:
        """Check the field."""
        Flag().read(self.far, FieldPath("far", SettingError))

    @checked({"tolerance": NOT_NEGATIVE})
    def draw(
        self,
        graph: StanceGraph,
        rng: Randomness,
        tolerance: float,
        start: State | None = None,
    ) -> Task:
        """Return a task; see `TaskGenerator.draw`."""
        return sample_task(graph, rng, tolerance, start, far=self.far)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data from which `TASKS` builds this generator."""
        return {"kind": "far" if self.far else "walk"}


@dataclass(frozen=True)
class AnywhereTasks:
    """Task generator whose start and goal lie anywhere on the map and are joined by a plan.

    The start is a random stance that a step leaves, see `stances.random_states`, and the goal the
    base position of another. Both are drawn again until the goal lies in the cabin, outside the
    goal region around the start, and a search finds a plan. With three and four limbs such plans
    are far longer than the walks of `WalkTasks`, and the search takes about half a second.
    """

    @checked({"tolerance": NOT_NEGATIVE})
    def draw(
        self,
        graph: StanceGraph,
        rng: np.random.Generator,
        tolerance: float,
        start: State | None = None,
    ) -> Task:
        """Return a task; see `TaskGenerator.draw`."""
        searcher, (low, high) = GraphSearcher(graph), graph.grasp_map.cabin
        for _ in range(TRIES):
            state = random_state(graph, rng) if start is None else start
            position = graph.posture_of(random_state(graph, rng)).base_position[0]
            if (position < low).any() or (position > high).any():
                continue
            goal = Goal(position, tolerance, Cost.named("steps"))
            if not goal.reached(graph.posture_of(state).base_position, state.stance).any():
                found = searcher.find(SearchQuery.from_options(graph, goal), state)
                if found is not None and found.status == GOAL_REACHED:
                    return Task(state, position)
        raise StanceError(
            f"no goal that a plan reaches was found on map {graph.grasp_map.name!r} in {TRIES} "
            "draws"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data from which `TASKS` builds this generator."""
        return {"kind": "anywhere"}


TASK_GENERATORS: dict[str, TaskGenerator] = {
    "walk": WalkTasks(), "far": WalkTasks(far=True), "anywhere": AnywhereTasks(),
    "random": LayoutTasks(), "clutter": LayoutTasks(clustered=True),
}  # fmt: skip
"""The task generators by name."""


def _read_generator(given: Any, path: FieldPath) -> TaskGenerator:
    """Return a task generator that is given as itself, by name or as plain data; refuse a class."""
    name = Fields({"kind": NAME}).read(given, path)["kind"] if isinstance(given, dict) else given
    if isinstance(name, str):
        return TASK_GENERATORS[Choice(tuple(TASK_GENERATORS)).read(name, path)]
    if isinstance(given, type) or not callable(getattr(given, "draw", None)):
        valid = ", ".join(map(repr, TASK_GENERATORS))
        raise path.refused(given, f"one of {valid} or a TaskGenerator")
    generator: TaskGenerator = given
    return generator


TASKS = Reader(_read_generator)
"""Validator of a task generator, given as itself, by name, or as plain data (`to_dict`)."""


def refuse_layouts(tasks: TaskGenerator) -> None:
    """Refuse tasks with layouts of their own where all sub-environments have one layout.

    Raises a `SettingError` if they are `LayoutTasks`.
    """
    if isinstance(tasks, LayoutTasks):
        raise SettingError(
            "the vector environment has one layout of points for all, and tasks='random' draws one "
            "for each; use gymnasium.make_vec(..., vectorization_mode='sync')"
        )


FIRST_FIXED_SEED = 1 << 62
"""Seed of the first fixed task; training must use smaller seeds."""

MAX_FIXED_TASKS = 1_000_000
"""Number of fixed tasks."""


FIXED_NUMBER = Integer(0, MAX_FIXED_TASKS - 1)
"""Validator of the number of a fixed task."""


def fixed_task(generator: TaskGenerator, graph: StanceGraph, number: int, tolerance: float) -> Task:
    """Return the fixed task of a number, the same in every process, from seeds kept for evaluation.

    The number is a `FIXED_NUMBER`, and the tolerance the radius of the goal region [m]. Raises an
    `MlivrError` if no task is found.
    """
    return draw_task(generator, graph, Stream.of_seed(FIRST_FIXED_SEED + number), tolerance)


def longest_axis(grasp_map: GraspMap) -> tuple[int, float]:
    """Return the axis along which a map's points extend farthest, and their middle on it [m]."""
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
    """Draw a task, and check it if the generator is the user's; arguments as in `TaskGenerator`.

    A user's generator draws from `numpy.random.default_rng(stream.state)`. The next state of the
    stream is then an integer below 2^63 from the same source.

    Raises an `MlivrError` if no task is found, the start cannot be held, or the goal lies outside
    the cabin.
    """
    if isinstance(generator, WalkTasks):
        return generator.draw(graph, stream, tolerance, start)
    rng = np.random.default_rng(stream.state)
    task = generator.draw(graph, rng, tolerance, start)
    stream.state = int(rng.integers(2**63))
    if not isinstance(task, Task):
        raise SettingError(f"the task generator drew {shortened(task)}; it must be a Task")
    if not isinstance(task.start, State):
        raise SettingError(
            f"the task generator drew the start {shortened(task.start)}; it must be a State"
        )
    graph.state(task.start.stance, task.start.pose)
    graph.check(task.start)
    return Task(task.start, graph.grasp_map.check_goal(task.goal))


@checked({"min_distance": NOT_NEGATIVE})
def sample_task(
    graph: StanceGraph,
    rng: Randomness,
    min_distance: float,
    start: State | None = None,
    *,
    far: bool = False,
) -> Task:
    """Return a random start, and a goal to which a walk of valid steps leads; see `WalkTasks`.

    Within `min_distance` [m] from the start a goal is drawn again; the start is drawn if it is
    None. Raises a `StanceError` if no task is found.
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
        if inside and _squared_lengths(position - origin) > min_distance * min_distance:
            return Task(state, position)
    raise StanceError(
        f"no goal that can be reached was found on map {grasp_map.name!r} in {TRIES} draws"
    )


def _walk_end(graph: StanceGraph, state: State, origin: Array, target: Array) -> Array:
    """Return the base position at the end of a walk from `origin` towards `target` [m]."""
    best, position = float(_squared_lengths(origin - target)), origin
    for _ in range(MAX_WALK_STEPS):
        steps = graph.successors(state)
        if not steps:
            break
        square = _squared_lengths(steps.base_position - target)
        k = int(np.argmin(square))
        if square[k] >= best:
            break
        best, position, state = float(square[k]), steps.base_position[k], steps.after(state, k)
    return position


def _squared_lengths(vectors: Array) -> Array:
    """Return the squared lengths of vectors, shape (..., 3), summed as in `envs.batch`."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    square: Array = x * x + y * y + z * z
    return square
