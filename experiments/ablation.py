"""Switch off each part of the search for three and four limbs in turn, and measure its worth.

    python experiments/ablation.py [--out results] [--tasks 50] [--seconds 2]

Random tasks on the JEM with collisions checked and the step cost: without obstacles, with a box on
the straight line to the goal, and with such a box and ten occupied points. All variants get the
same tasks. Writes `ablation.json` and `ablation.md`; takes at most 90 minutes.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cache
from typing import Any
from unittest.mock import patch

import numpy as np
from many_limbs import random_task
from reports import experiment, study_rows, table

from mlivr_gym import stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.errors import StanceError
from mlivr_gym.planners import Planner, implicit_search, searches, table_search
from mlivr_gym.planners.planning_result import PROVED_IMPOSSIBLE
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.boxes import Box

ROBOTS = ("mlivr3", "mlivr4")
WORLDS = ("free", "box", "box and ten points")


Patch = tuple[Any, str, Any]
"""An object, the name of one of its attributes, and the value that switches a part off."""

STAGES, AMONG = table_search.STAGES, table_search.OBSTACLE_STAGES
EXACT = table_search.EXACT_STAGES
NO_TABLE: list[Patch] = [(searches, "find_table", lambda graph: None)]


def stages(free: Sequence[Any], among: Sequence[Any]) -> list[Patch]:
    """Return the patches that set the stages of a search, without and among obstacles."""
    patches = {"STAGES": tuple(free), "OBSTACLE_STAGES": tuple(among)}
    return [(table_search, name, value) for name, value in patches.items()]


VARIANTS: dict[str, list[Patch]] = {
    "all": [],
    "only the stages of the cheapest path": stages(EXACT, EXACT),
    "no probe for an enclosed start": stages(STAGES, AMONG[2:]),
    "no stage of weight 1 / 3 among obstacles": stages(STAGES, (*AMONG[:2], *AMONG[3:])),
    "no stage of weight 1 / 1.1": stages(
        (*STAGES[:-4], *EXACT), (*AMONG[:-4], *EXACT)
    ),
    "no stage that checks every edge": stages(STAGES[:-1], AMONG[:-1]),
    "no node table": NO_TABLE,
    "neither node table nor stance sets": [
        *NO_TABLE, (ImplicitGraph, "sets", lambda self, *args, **kinds: None),
    ],
    "no node table, queues by estimate and lower bound alone": [
        *NO_TABLE, (implicit_search, "COST_TO_GO_INFLATION", 1.0),
    ],
    "no node table, queue by lower bound alone": [
        *NO_TABLE,
        (implicit_search.ImplicitSearch, "_next_queue", lambda self: self._by_lower_bound),
    ],
}  # fmt: skip
"""Variants, and what switches their parts of the search off."""

Task = tuple[State, Array, list[Box], list[int]]
"""Start, goal, boxes and occupied points."""


@cache
def drawn(robot: str, world: str, count: int) -> list[Task]:
    """Return random tasks whose start can be held."""
    graph, found = stance_graph(robot=robot), []
    seed = 0
    while len(found) < count:
        rng = np.random.default_rng([seed, graph.limbs, 7])
        seed += 1
        start, goal = random_task(graph, rng)
        here = graph.posture_of(start).base_position[0]
        centre = here + rng.uniform(0.3, 0.7) * (goal - here) + rng.uniform(-0.3, 0.3, 3)
        half = rng.uniform(0.05, 0.15, 3)
        points = rng.permutation(len(graph.grasp_map))
        points = points[~np.isin(points, start.stance)][:10]
        if world == "free":
            found.append((start, goal, [], []))
            continue
        box = Box("box", "obstacle", tuple(centre.tolist()), tuple(half.tolist()))
        taken = points.tolist() if world == WORLDS[2] else []
        graph.add_obstacles([box])
        try:
            graph.state(start.stance)
        except StanceError:
            continue
        finally:
            graph.remove_obstacles()
        found.append((start, goal, [box], taken))
    return found


def plan_once(robot: str, task: Task, variant: str, seconds: float) -> dict[str, Any]:
    """Plan a task with a variant; return time, cost and bound."""
    start, goal, boxes, taken = task
    graph = stance_graph(robot=robot)
    graph.add_obstacles(boxes)
    graph.occupy(taken)
    with ExitStack() as stack:
        for patched in VARIANTS[variant]:
            stack.enter_context(patch.object(*patched))
        began = time.perf_counter()
        found = Planner(graph).plan(start.stance, goal.tolist(), "steps", time_limit=seconds)
    return {
        "seconds": time.perf_counter() - began,
        "reason": found.reason,
        "first": found.improvements[0].time if found.improvements else None,
        "steps": len(found.plan.steps) if found.plan else None,
        "bound": found.plan.statistics.bound if found.plan else None,
    }


@cache
def warm_up(robot: str, variant: str) -> None:
    """Compile, and unpack the table."""
    plan_once(robot, drawn(robot, WORLDS[0], 1)[0], variant, 2.0)


def planned(
    task: int, robot: str, world: str, variant: str, count: int, limit: float
) -> dict[str, Any]:
    """Plan one of `count` tasks with a variant, with a time limit [s]."""
    warm_up(robot, variant)
    return {"found": plan_once(robot, drawn(robot, world, count)[task], variant, limit)}


def measured(tasks: int, seconds: float, workers: int) -> dict[str, Any]:
    """Plan all tasks with all variants, each in processes of its own, which share no table."""
    data: dict[str, Any] = {"seconds": seconds}
    given = {"robot": ROBOTS, "world": WORLDS, "count": [tasks], "limit": [seconds]}
    for variant in VARIANTS:
        for row in study_rows("ablation:planned", tasks, workers, variant=[variant], **given):
            by_variant = data.setdefault(f"{row['robot']}, {row['world']}", {})
            by_variant.setdefault(variant, []).append(row["found"])
    return data


def markdown(rows: dict[str, Any]) -> str:
    """Return the page: the number of solved tasks of each kind, by variant."""
    kinds = [
        f"{robot}, {world}" for robot in ROBOTS for world in WORLDS if f"{robot}, {world}" in rows
    ]
    cells = []
    for name in dict.fromkeys(name for kind in kinds for name in rows[kind]):
        by_kind = [rows[kind].get(name, []) for kind in kinds]
        every = [one for found in by_kind for one in found]
        firsts = [one["first"] for one in every if one["first"] is not None]
        proved = [sum(one["bound"] == 1.0 for one in found) for found in by_kind]
        cells.append([
            name,
            *(f"{decided(found)} ({best})" if found else "none"
              for found, best in zip(by_kind, proved, strict=True)),
            f"{decided(every)} of {len(every)}",
            f"{statistics.median(firsts):.2f}" if firsts else "none",
        ])  # fmt: skip
    head = " | ".join(["variant", *kinds, "all", "first plan, median [s]"])
    text = f"""# Ablation

Made by `experiments/ablation.py`. Each part of the search for three and four limbs is \
switched off in turn: random tasks, {len(next(iter(rows[kinds[0]].values())))} of each kind, \
collisions checked, step cost, {rows["seconds"]:g} s each. A task is solved if the search finds a \
plan or proves that none exists; in brackets the plans that are proved to have the fewest steps.

{table(head, cells)}"""
    return "\n".join([text, *rows.get("remarks", [])]).strip() + "\n"


def decided(found: list[dict[str, Any]]) -> int:
    """Return how many tasks have a plan or the proof that none exists."""
    return sum(one["steps"] is not None or one["reason"] in PROVED_IMPOSSIBLE for one in found)


if __name__ == "__main__":
    experiment(
        "ablation", __doc__, measured, markdown, indent=None, tasks=50, seconds=2.0, workers=1
    )
