"""What a run of a study does, and the row of results that it gives."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property, partial
from pkgutil import resolve_name
from typing import Any

import numpy as np

from mlivr_gym import stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError, SettingError, StanceError
from mlivr_gym.extensions.studies.design import GRAPH_FACTORS, RunBlock, StudyDesign, is_function
from mlivr_gym.planners import Planner
from mlivr_gym.settings import Settings
from mlivr_gym.stances import TRIES, StanceGraph, State, random_state

Row = dict[str, Any]
"""Results of one run by column."""

MIN_DISTANCE = 1.0
"""Minimum distance of the goal of a task from its start [m]."""

PLAN_COLUMNS = (
    "start", "goal_x", "goal_y", "goal_z", "reason", "steps", "base_translation", "bound",
    "expanded", "seconds",
)  # fmt: skip
"""Columns of a plan. Lengths are in metres; `seconds` is the time of the query, which no two runs
share to the last digit."""


def rows_of(design: StudyDesign, block: RunBlock) -> list[Row]:
    """Compute the runs of a block; an input that cannot be used is the `error` of its rows.

    Among plans of equal cost a planner may find another one where it knows more steps from earlier
    queries. So each block has a graph of its own: its rows do not depend on who computes it.
    """
    columns: tuple[str, ...] = ()
    if is_function(design.kind):
        run = function_run(design.kind, block.levels)
    else:
        columns, run = PLAN_COLUMNS, _Plans(design.seed, block.levels)
    numbers = ({"run": block.first_run + k, "task": task} for k, task in enumerate(block.tasks))
    rows = [one | block.levels | dict.fromkeys(columns) | {"error": ""} for one in numbers]
    for row in rows:
        try:
            row |= run(row["task"])
        except MlivrError as error:
            row["error"] = str(error)
    return rows


def function_run(kind: str, levels: dict[str, Any]) -> Callable[[int], Row]:
    """Return the function of a user with the levels as its arguments.

    Raises a `SettingError` if the module or the function cannot be found.
    """
    try:
        function = resolve_name(kind)
    except (ImportError, AttributeError, ValueError) as error:
        raise SettingError(
            f"kind is {kind!r}, but there is no such function: {error}; Python must find its module"
        ) from None
    return partial(function, **levels)


class _Plans:
    """Plans of the tasks of a block, which share a stance graph."""

    def __init__(self, seed: int, levels: dict[str, Any]) -> None:
        self._seed, self._levels = seed, levels

    def __call__(self, task: int) -> Row:
        """Plan a task; return its columns."""
        levels, graph = self._levels, self._graph
        start, goal = drawn_task(graph, self._seed, task, levels["occupied"])
        limit = None if graph.lists_all else levels["time_limit"]
        began = time.perf_counter()
        result = Planner(graph).plan(start, goal, levels["cost"], time_limit=limit)
        row = {
            "start": " ".join(graph.ids(start.stance)),
            **dict(zip(("goal_x", "goal_y", "goal_z"), map(float, goal), strict=True)),
            "reason": result.reason, "expanded": result.expanded,
            "seconds": time.perf_counter() - began,
        }  # fmt: skip
        if result.plan is None:
            return row
        return row | {
            "steps": len(result.plan.steps), "base_translation": result.plan.base_translation,
            "bound": result.plan.statistics.bound,
        }  # fmt: skip

    @cached_property
    def _graph(self) -> StanceGraph:
        """The stance graph; if it cannot be built, that is the error of every row."""
        given = {name: self._levels[name] for name in GRAPH_FACTORS}
        given = {name: level for name, level in given.items() if level is not None}
        return stance_graph(given.pop("map"), given.pop("robot"), Settings(**given))


def drawn_task(graph: StanceGraph, seed: int, task: int, occupied: float) -> tuple[State, Array]:
    """Occupy a share of the points for a task on a graph; return its start and its goal.

    The goal is the base position of another random state, to which a path need not lead.
    """
    rng, count = np.random.default_rng([seed, task]), len(graph.grasp_map)
    graph.vacate()
    graph.occupy(rng.permutation(count)[: round(occupied * count)].tolist())
    start = random_state(graph, rng)
    origin = graph.posture_of(start).base_position[0]
    for _ in range(TRIES):
        goal = graph.posture_of(random_state(graph, rng)).base_position[0]
        if np.linalg.norm(goal - origin) >= MIN_DISTANCE:
            return start, goal
    raise StanceError(f"no goal {MIN_DISTANCE:g} m from the start was found in {TRIES} draws")


def succeeded(row: Row) -> bool:
    """Return whether a run gave a plan, or what a function did no error."""
    return not (row["error"] or row.get("reason"))
