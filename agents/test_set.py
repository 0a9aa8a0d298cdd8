"""The frozen test set: starts and goals in four splits, whose goals imitation leaves out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.agents.evaluation import EvaluationTask
from mlivr_gym.arguments import SEED, checked
from mlivr_gym.arrays import Array
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError
from mlivr_gym.files import load, write_whole
from mlivr_gym.planners import Planner
from mlivr_gym.robot.sizes import MOST_LIMBS
from mlivr_gym.schema import (
    NAME,
    Anything,
    Choice,
    FieldPath,
    Fields,
    Integer,
    ListOf,
    OrNone,
    Tuples,
)
from mlivr_gym.settings import GRAPH_RULES, check_rules
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.values import MAX_LENGTH, MAX_POINTS
from mlivr_gym.world.grasp_map import GraspMap, jem_map
from mlivr_gym.world.map_entries import SPACING

SPLITS = ("same", "half", "dense", "occupied")
"""Names of the splits, which are parts of the test set; none of them is for training.

They are the map of the JEM, on which the shipped policy was trained, half of its points, points
every 0.1 m, and the same map with a fifth of the points occupied.
"""

MIN_START_GOAL_DISTANCE = 2.0
"""Minimum distance between the bases at start and goal [m], since short ways are easy."""

OCCUPIED_SHARE = 0.2
"""Share of the points that are occupied in the last split."""


TASK = Fields(
    {
        "start": ListOf(NAME, 2, MOST_LIMBS),
        "goal": Tuples((3,), most=MAX_LENGTH, unit="m"),
        "occupied": ListOf(NAME, most=MAX_POINTS),
    }
)
"""Validator of a task of a test set."""

WORLD = Fields(
    {
        "split": Choice(SPLITS),
        "spacing": SPACING,
        "sparse_seed": OrNone(Integer(0, 1 << 63)),
        "tasks": ListOf(TASK),
    }
)
"""Validator of the tasks on one map."""

TEST_SET = Fields(
    {
        "seed": Integer(0, 1 << 63),
        "rules": Anything(),
        "worlds": ListOf(WORLD),
    }
)
"""Validator of a file with a test set."""


SIZES = Fields(dict.fromkeys(SPLITS, Integer(0, 10**6)))
"""Validator of the numbers of tasks in the splits."""


class HeldOutWorld(NamedTuple):
    """A map of the test set, with its tasks; their goals are held out, not always the map."""

    split: str
    """One of `SPLITS`; `"half"` has several maps, the others one each."""
    spacing: float
    """Spacing of the points [m]."""
    sparse_seed: int | None
    """Seed of `GraspMap.sparse` if half of the points are removed, otherwise None."""
    tasks: tuple[EvaluationTask, ...]
    """Starts and goals, with the points that are occupied."""

    def map(self) -> GraspMap:
        """Return the map."""
        whole = jem_map(self.spacing)
        return whole if self.sparse_seed is None else whole.sparse(self.sparse_seed)


@checked()
def load_test_set(path: str | Path | None = None) -> list[HeldOutWorld]:
    """Return the maps and tasks of the test set that ships with the package, or of another file.

    Raises a `MlivrError` if the file cannot be read, or its tasks were drawn by other rules of the
    stance graph.

    Examples
    --------
    >>> [(world.split, len(world.tasks)) for world in load_test_set()][:2]
    [('same', 60), ('half', 13)]
    """
    file = asset_path("test_set.json") if path is None else Path(path)

    def build(data: dict[str, Any]) -> list[HeldOutWorld]:
        check_rules("it", data.get("rules"), "draw it again with freeze_test_set")
        return [
            HeldOutWorld(
                **{**world, "tasks": tuple(EvaluationTask(**task) for task in world["tasks"])}
            )
            for world in TEST_SET.read(data, FieldPath("", MlivrError))["worlds"]
        ]

    return load(file, "test set", MlivrError, build)


def held_out_goals() -> Array:
    """Return goals of the test set [m], shape (g, 3); imitation uses none within 1 cm of them."""
    return np.array([task.goal for world in load_test_set() for task in world.tasks])


@checked({"seed": SEED, "sizes": SIZES})
def freeze_test_set(path: str | Path, seed: int, sizes: dict[str, int]) -> list[HeldOutWorld]:
    """Draw a test set from a seed, write it to a file, and return it.

    `sizes` are the numbers of tasks in the splits; that of `"half"` is divided among four maps.
    """
    rng = np.random.default_rng(seed)
    worlds = [_draw_tasks(HeldOutWorld("same", 0.2, None, ()), sizes["same"], rng)]
    for k in range(4):
        worlds.append(_draw_tasks(HeldOutWorld("half", 0.2, seed + k, ()), sizes["half"] // 4, rng))
    worlds.append(_draw_tasks(HeldOutWorld("dense", 0.1, None, ()), sizes["dense"], rng))
    worlds.append(
        _draw_tasks(HeldOutWorld("occupied", 0.2, None, ()), sizes["occupied"], rng, groups=10)
    )
    data: dict[str, Any] = {"seed": seed, "rules": GRAPH_RULES, "worlds": []}
    for world in worlds:
        tasks = [task._asdict() for task in world.tasks]
        data["worlds"].append(world._asdict() | {"tasks": tasks})
    write_whole(path, json.dumps(data) + "\n")
    return worlds


def _draw_tasks(
    world: HeldOutWorld, count: int, rng: np.random.Generator, groups: int = 0
) -> HeldOutWorld:
    """Return a world with tasks; with `groups`, each group of tasks has its own occupied points."""
    env = MlivrEnv(map=world.map())
    tasks: list[EvaluationTask] = []
    for group in range(max(groups, 1)):
        occupied: tuple[str, ...] = ()
        if groups:
            m = len(env.graph.grasp_map)
            chosen = rng.permutation(m)[: int(OCCUPIED_SHARE * m)]
            occupied = env.graph.ids(sorted(chosen.tolist()))
            env.graph.vacate()
            env.graph.occupy(occupied)
        share = count * (group + 1) // max(groups, 1)
        planner = Planner(env.graph)
        while len(tasks) < share:
            first, last = random_state(env.graph, rng), random_state(env.graph, rng)
            origin, goal = (
                env.graph.posture(state.stance).base_position[0] for state in (first, last)
            )
            low, high = env.graph.grasp_map.cabin
            if (
                np.linalg.norm(goal - origin) < MIN_START_GOAL_DISTANCE
                or (goal < low).any()
                or (goal > high).any()
            ):
                continue
            query = first.stance, goal.tolist(), "steps"
            if planner.plan(*query, goal_tolerance=env.goal_tolerance):
                tasks.append(
                    EvaluationTask(env.graph.ids(first.stance), tuple(goal.tolist()), occupied)
                )
    return world._replace(tasks=tuple(tasks))
