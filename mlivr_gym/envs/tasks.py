"""Tasks: generators that draw starts and goals which a walk of valid steps connects.

Any object with the method `draw` of `TaskGenerator` is a generator. The names `"walk"`, `"far"` and
`"random"` stand for `WalkTasks()`, `WalkTasks(far=True)` and `LayoutTasks()`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from mlivr_gym.arguments import Reader
from mlivr_gym.arrays import Array
from mlivr_gym.envs.streams import Stream
from mlivr_gym.errors import SettingError, StanceError, shortened
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.table_values import TableValues, in_goal_region
from mlivr_gym.schema import Choice, FieldPath, Integer
from mlivr_gym.stances.moves import TableMoves
from mlivr_gym.stances.random_states import TRIES, Randomness, random_state
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import StepTables, state_of, step_tables
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import GraspMap

MAX_WALK_STEPS = 12
"""Maximum number of steps of the walk by which `WalkTasks` finds a goal from its start."""

OCCUPIED_SHARES = 0.3, 0.5
"""Least and largest share of the points that `LayoutTasks` makes occupied."""


class Task(NamedTuple):
    """Start and goal of an episode."""

    start: State
    """State at the start."""
    goal: Array
    """Goal position of the base [m], shape (3,)."""


class TaskGenerator(Protocol):
    """Interface of a task generator.

    Examples
    --------
    Tasks whose goal lies at least 2 m from the start:

    >>> from mlivr_gym.envs.env import MlivrEnv
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

        Parameters
        ----------
        graph
            The stance graph.
        rng
            Source of randomness.
        tolerance
            Radius of the goal region [m].
        start
            The start, or None to draw it.

        Returns
        -------
        Task
            The start, which is the given one if there is one, and the goal.

        Raises
        ------
        StanceError
            If no task is found.
        """


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
class LayoutTasks:
    """Task generator that draws which points are occupied, and a start and goal joined by a plan.

    The share of occupied points is uniform in `OCCUPIED_SHARES`, and each set of points of that
    size is as likely as another; points of a start that is given stay free. They become the
    occupied points of the graph. The goal is the base position of a random stance that is left, if
    it lies in the cabin. The start is a random one of the stances outside the goal region from
    which an exact search finds the goal. If there is none, all three are drawn again.
    """

    def draw(
        self,
        graph: StanceGraph,
        rng: np.random.Generator,
        tolerance: float,
        start: State | None = None,
    ) -> Task:
        """Return a task, and occupy the points of its layout; see `TaskGenerator.draw`.

        Raises
        ------
        SettingError
            If the robot has more than two limbs, or the start has a pose of its own.
        StanceError
            If no task is found; the graph then has the occupied points that it had before.
        """
        if start is not None and start.pose is not None:
            raise SettingError("tasks='random' starts in the posture of a stance; give no pose")
        before, points = graph.occupied, np.arange(len(graph.grasp_map))
        low, high = graph.grasp_map.cabin
        free = points if start is None else np.setdiff1d(points, start.stance)
        for _ in range(TRIES):
            count = round(rng.uniform(*OCCUPIED_SHARES) * len(points))
            graph.vacate()
            graph.occupy(rng.choice(free, min(count, len(free)), replace=False).tolist())
            tables = step_tables(graph)
            feasible = np.flatnonzero((tables.branch_sets != 0).all(axis=1))
            if not len(feasible):
                continue
            goal = tables.base_position[rng.choice(feasible)]
            if (goal < low).any() or (goal > high).any():
                continue
            fewest = _step_values(tables, goal, tolerance).of_stances(0)
            starts = np.flatnonzero(np.isfinite(fewest) & (fewest > 0.0))
            if start is not None:
                starts = starts[(tables.points[starts] == start.stance).all(axis=1)]
            if len(starts):
                s = int(rng.choice(starts))
                return Task(start or state_of(tables, s, tables.branch_sets[s]), goal)
        graph.vacate()
        graph.occupy(sorted(before))
        raise StanceError(
            f"no layout with a goal that can be reached was found on map {graph.grasp_map.name!r} "
            f"in {TRIES} draws"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data from which `TASKS` builds this generator."""
        return {"kind": "random"}


def _step_values(tables: StepTables, goal: Array, tolerance: float) -> TableValues:
    """Return the fewest steps to a goal [m]."""
    return TableValues(tables, in_goal_region(tables, goal[None], tolerance), Cost.named("steps"))


def fewest_steps(moves: TableMoves, state: State, goal: Array, tolerance: float) -> int:
    """Return the number of steps of an optimal plan, -1 if there is none.

    Parameters
    ----------
    moves
        The steps.
    state
        The start.
    goal
        Goal position [m], shape (3,).
    tolerance
        Radius of the goal region [m].
    """
    if _squared_lengths(moves.stance_properties(state).base_position - goal) <= tolerance**2:
        return 0
    values, steps = _step_values(moves.tables, goal, tolerance), moves.successors(state)
    after = [steps.after(state, k) for k in range(len(steps.limb))]
    s = np.array([moves.stance_at[one.stance] for one in after])
    branch_sets = np.array([one.branch_sets for one in after])
    actions = moves.action_mask(state).size
    rest = values.of_actions(s, branch_sets, np.zeros(len(s), np.int64), actions).min(axis=1)
    fewest = 1 + np.where(values.is_goal[0, s], 0.0, rest).min()
    return int(fewest) if np.isfinite(fewest) else -1


TASK_GENERATORS: dict[str, TaskGenerator] = {
    "walk": WalkTasks(), "far": WalkTasks(far=True), "random": LayoutTasks(),
}  # fmt: skip
"""The task generators by name."""


def _read_generator(given: Any, path: FieldPath) -> TaskGenerator:
    """Return a task generator that is given as itself, by name or as plain data; refuse a class."""
    name = given.get("kind") if isinstance(given, dict) else given
    if isinstance(name, str):
        return TASK_GENERATORS[Choice(tuple(TASK_GENERATORS)).read(name, path)]
    if isinstance(given, dict | type) or not callable(getattr(given, "draw", None)):
        valid = ", ".join(map(repr, TASK_GENERATORS))
        raise path.refused(given, f"one of {valid} or a TaskGenerator")
    generator: TaskGenerator = given
    return generator


TASKS = Reader(_read_generator)
"""Validator of a task generator, given as itself, by name, or as plain data (`to_dict`)."""


def refuse_layouts(tasks: TaskGenerator) -> None:
    """Refuse tasks with layouts of their own where all sub-environments have one layout.

    Raises
    ------
    SettingError
        If they are `LayoutTasks`.
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

    Parameters
    ----------
    generator
        The generator that draws it.
    graph
        The stance graph.
    number
        Number of the task, a `FIXED_NUMBER`.
    tolerance
        Radius of the goal region [m].

    Raises
    ------
    MlivrError
        If no task is found.
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

    Raises
    ------
    MlivrError
        If no task is found, the start cannot be held, or the goal lies outside the cabin.
    """
    if isinstance(generator, WalkTasks):
        return generator.draw(graph, stream, tolerance, start)
    rng = np.random.default_rng(stream.state)
    task = generator.draw(graph, rng, tolerance, start)
    stream.state = int(rng.integers(2**63))
    if not isinstance(task.start, State):
        raise SettingError(
            f"the task generator drew the start {shortened(task.start)}; it must be a State"
        )
    graph.state(task.start.stance, task.start.pose)
    graph.check(task.start)
    return Task(task.start, graph.grasp_map.check_goal(task.goal))


def sample_task(
    graph: StanceGraph,
    rng: Randomness,
    min_distance: float,
    start: State | None = None,
    *,
    far: bool = False,
) -> Task:
    """Return a random start, and a goal to which a walk of valid steps leads; see `WalkTasks`.

    Parameters
    ----------
    graph
        The stance graph.
    rng
        Source of randomness.
    min_distance
        Distance from the start within which a goal is drawn again [m].
    start
        The start, or None to draw it.
    far
        See `WalkTasks`.

    Raises
    ------
    StanceError
        If no task is found.
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
