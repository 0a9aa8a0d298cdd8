"""What a run of a study does, and the row of results that it gives."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property, partial
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym import stance_graph
from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError, SettingError, StanceError
from mlivr_gym.extensions.studies.design import (
    FACTORS,
    KIND,
    TABLE_FACTORS,
    RunBlock,
    StudyDesign,
    is_function,
)
from mlivr_gym.planners import Planner, PlanningResult
from mlivr_gym.settings import Settings
from mlivr_gym.stances import (
    TRIES,
    ImplicitGraph,
    StanceGraph,
    State,
    TwoLimbGraph,
    build_table,
    random_state,
)

if TYPE_CHECKING:  # loads GL
    from mlivr_gym.envs import MlivrEnv

Row = dict[str, Any]
"""Results of one run by column."""

MIN_DISTANCE = 1.0
"""Minimum distance of the goal of a task from its start [m]."""

TASK_COLUMNS = {
    "start": "string", "goal_x": "double", "goal_y": "double", "goal_z": "double",
}  # fmt: skip
PLAN_COLUMNS = TASK_COLUMNS | {
    "reason": "string", "steps": "int64", "base_translation": "double", "bound": "double",
    "expanded": "int64", "seconds": "double",
}  # fmt: skip

COLUMNS: dict[str, dict[str, str]] = {
    "plan": PLAN_COLUMNS,
    "simulate": PLAN_COLUMNS
    | {
        "failure": "string", "done": "int64", "duration": "double",
        "grasp_force": "double", "base_error": "double",
    },
    "evaluate": {
        "success": "bool", "steps": "int64", "base_translation": "double", "seconds": "double",
    },
    "build": {"file": "string", "bytes": "int64", "seconds": "double"},
}  # fmt: skip
"""Columns of the results of each kind of study, with their Arrow types. Lengths are in metres,
times in seconds, forces in newtons; `seconds` is the time that the run took to plan, to choose its
first action or to build, which no two runs share to the last digit."""


@checked({"kind": KIND})
def columns_of(kind: str) -> dict[str, str]:
    """Return all columns of a kind of study with their Arrow types, the factors included.

    Those of a function are not known beforehand.
    """
    if is_function(kind):
        return {}
    types = {str: "string", bool: "bool", float: "double", type(None): "double"}
    levels = {name: types[type(level)] for name, (_, level) in FACTORS[kind].items()}
    return {"run": "int64", "task": "int64"} | levels | COLUMNS[kind] | {"error": "string"}


def rows_of(design: StudyDesign, block: RunBlock) -> list[Row]:
    """Compute the runs of a block; an input that cannot be used is the `error` of its rows.

    Among plans of equal cost a planner may find another one where it knows more steps from earlier
    queries. So each block has a graph of its own: its rows do not depend on who computes it.
    """
    if is_function(design.kind):
        run = function_run(design.kind, block.levels)
    else:
        run = partial(RUNS[design.kind], _World(design, block.levels))
    blank: Row = dict.fromkeys(columns_of(design.kind))
    rows: list[Row] = [
        blank | block.levels | {"run": block.first_run + k, "task": task, "error": ""}
        for k, task in enumerate(block.tasks)
    ]
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


class _World:
    """A combination of levels, with the stance graph or environment that runs of a block share."""

    def __init__(self, design: StudyDesign, levels: dict[str, Any]) -> None:
        self.design, self.levels = design, levels
        chosen = {name: levels[name] for name in TABLE_FACTORS}
        self._chosen = {name: level for name, level in chosen.items() if level is not None}

    @cached_property
    def graph(self) -> TwoLimbGraph | ImplicitGraph:
        """The stance graph."""
        settings = dict(self._chosen)
        return stance_graph(settings.pop("map"), settings.pop("robot"), Settings(**settings))

    @cached_property
    def env(self) -> MlivrEnv:
        """The environment, with a graph of its own."""
        from mlivr_gym.envs import MlivrEnv  # loads GL

        return MlivrEnv(**self._chosen)


def _task(graph: StanceGraph, world: _World, task: int) -> tuple[State, Array]:
    """Occupy the points of a task on a graph; return its start and its goal.

    The goal is the base position of another random state, to which a path need not lead.
    """
    rng, count = np.random.default_rng([world.design.seed, task]), len(graph.grasp_map)
    graph.vacate()
    graph.occupy(rng.permutation(count)[: round(world.levels["occupied"] * count)].tolist())
    start = random_state(graph, rng)
    origin = graph.posture_of(start).base_position[0]
    for _ in range(TRIES):
        goal = graph.posture_of(random_state(graph, rng)).base_position[0]
        if np.linalg.norm(goal - origin) >= MIN_DISTANCE:
            return start, goal
    raise StanceError(f"no goal {MIN_DISTANCE:g} m from the start was found in {TRIES} draws")


def _planned(world: _World, task: int) -> tuple[StanceGraph, PlanningResult, Row]:
    """Plan a task; return graph, result and the columns of plans."""
    graph, levels = world.graph, world.levels
    start, goal = _task(graph, world, task)
    limit = None if graph.limbs == 2 else levels["time_limit"]
    began = time.perf_counter()
    found = Planner(graph).plan(start, goal, levels["cost"], time_limit=limit)
    row = {
        "start": " ".join(graph.ids(start.stance)),
        **dict(zip(("goal_x", "goal_y", "goal_z"), map(float, goal), strict=True)),
        "reason": found.reason, "expanded": found.expanded,
        "seconds": time.perf_counter() - began,
    }  # fmt: skip
    if found.plan is not None:
        row |= {
            "steps": len(found.plan.steps), "base_translation": found.plan.base_translation,
            "bound": found.plan.statistics.bound,
        }  # fmt: skip
    return graph, found, row


def _simulate_row(world: _World, task: int) -> Row:
    """Plan a task, and execute the plan in MuJoCo."""
    from mlivr_gym.simulation import Setup, execute_many

    graph, found, row = _planned(world, task)
    if found.plan is None or not found.plan.steps:
        return row
    setup = Setup.of(world.levels["pace"], disturbances=world.levels["disturbances"])
    seed = world.design.seed * 10**6 + task + 1
    (outcome,) = execute_many(graph, [found.plan], setup, seed=seed, workers=1)
    return row | {
        "failure": outcome.failure or "", "done": outcome.done, "duration": outcome.time,
        "grasp_force": outcome.grasp_force, "base_error": outcome.base_error,
    }  # fmt: skip


def _evaluate_row(world: _World, task: int) -> Row:
    """Evaluate a policy on the episode of a task."""
    from mlivr_gym.agents import EvaluationTask, evaluate, policy_by_name  # these load GL

    env, seed = world.env, world.design.seed + task
    start, goal = _task(env.graph, world, task)
    points = tuple(env.graph.ids(sorted(env.graph.occupied)))
    given = EvaluationTask(env.graph.ids(start.stance), tuple(map(float, goal)), points)
    policy = policy_by_name(world.levels["policy"], env, seed)
    found = evaluate(env, policy, [given], seed)
    return {
        "success": bool(found.success[0]), "steps": int(found.steps[0]),
        "base_translation": float(found.base_translation[0]),
        "seconds": float(found.first_decision[0]),
    }  # fmt: skip


def _build_row(world: _World, task: int) -> Row:
    """Build the table of a robot on a map."""
    began = time.perf_counter()
    path = build_table(world.graph)
    if path is None:
        return {"seconds": time.perf_counter() - began}
    return {
        "file": path.name, "bytes": path.stat().st_size, "seconds": time.perf_counter() - began
    }  # fmt: skip


RUNS: dict[str, Callable[[_World, int], Row]] = {
    "plan": lambda world, task: _planned(world, task)[2],
    "simulate": _simulate_row,
    "evaluate": _evaluate_row,
    "build": _build_row,
}
"""What a run of each kind of study does."""


def succeeded(kind: str, row: Row) -> bool:
    """Return whether a run gave a plan, a walk without failure, a reached goal, or no error."""
    column, wanted = {
        "plan": ("reason", ""), "simulate": ("failure", ""), "evaluate": ("success", True),
    }.get(kind, ("error", ""))  # fmt: skip
    return bool(row[column] == wanted)
