"""Switch off each part of the search in turn, and measure what it is worth.

    python experiments/ablation.py [--out results] [--tasks 20] [--seconds 2]

Random tasks with collisions checked: two limbs among three boxes, or with a wall across the cabin,
with both costs; three and four limbs free, with a box on the straight line to the goal, and with
ten occupied points more; three limbs in the laboratory of which no table is known. All variants get
the same tasks and the same processor time. Writes `ablation.json` and `ablation.md` in an hour.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from many_limbs import random_task
from reports import experiment, table
from tqdm import tqdm

from mlivr_gym import Box, Settings, State, stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.errors import GoalError, StanceError
from mlivr_gym.planners import PROVED_IMPOSSIBLE, Planner
from mlivr_gym.stances import StanceGraph

PLANNERS, TABLE = "mlivr_gym.planners", "mlivr_gym.planners.table_search"
PRESENT = "mlivr_gym.stances.present_table.PresentTable"


class Group(NamedTuple):
    """Tasks of one kind, and the variants that solve them."""

    world: dict[str, Any]
    """Arguments of `stance_graph`."""
    boxes: int
    """Boxes between start and goal."""
    points: int
    """Occupied points."""
    costs: tuple[str, ...]
    variants: dict[str, dict[str, Any]]
    """Of each variant, what replaces which names."""
    longer: float = 1.0
    """Factor of the time limit."""
    walls: bool = False
    """Whether a wall stands across the cabin, every second one up to its ceiling."""


def weights(among_obstacles: float, free: float) -> dict[str, Any]:
    """Return the patches that give the first stage of more than two limbs other weights."""
    return {f"{TABLE}.AMONG_OBSTACLES": among_obstacles, f"{TABLE}.FREE": free}


ALL: dict[str, Any] = {}
AT_ONCE = {f"{TABLE}.EDGES_AT_ONCE": 10**9}
FEW_LIMBS = {
    "all": ALL,
    "no searches from the goal": {
        f"{TABLE}.TableSearch._improved_bounds": lambda search, bounds, limit: bounds
    },
    "all edges of a path at once": AT_ONCE,
    "no looks before checks": {f"{PRESENT}.look": lambda present, edges: present.kept(edges)},
    "nodes are not all checked": {f"{TABLE}.MANY": 10**9},
}
MANY_LIMBS = {
    "all": ALL,
    "all edges of a path at once": AT_ONCE,
    "weight 1": weights(1.0, 1.0),
    "weights exchanged": weights(1.5, 3.0),
    "no table": {"mlivr_gym.stances.stance_graph.StanceGraph.table": None},
}
NO_TABLE = {
    "all": ALL,
    "order by the lower bound": {
        f"{PLANNERS}.implicit_search.ImplicitSearch._keys": lambda _, at, g, bounds: bounds
    },
}
LABORATORY = {
    "grasp_map": "uslab", "robot": "mlivr3", "settings": Settings(limb_threshold=0.09)
}  # fmt: skip

GROUPS = {
    "two limbs, boxes": Group({}, 3, 0, ("steps", "base"), FEW_LIMBS),
    "two limbs, walls": Group({}, 0, 0, ("steps", "base"), FEW_LIMBS, 3.0, walls=True),
    **{
        f"{name} limbs, {world}": Group({"robot": robot}, boxes, points, ("steps",), MANY_LIMBS)
        for name, robot in (("three", "mlivr3"), ("four", "mlivr4"))
        for world, boxes, points in (("free", 0, 0), ("box", 1, 0), ("box and points", 1, 10))
    },
    "three limbs, laboratory": Group(LABORATORY, 0, 0, ("steps",), NO_TABLE, 3.0),
}


class Drawn(NamedTuple):
    """A task in a world."""

    start: State
    goal: Array
    boxes: list[Box]
    points: list[int]


def drawn(group: Group, count: int) -> Iterator[Drawn]:
    """Yield random tasks whose start can be held."""
    graph, seed = stance_graph(**group.world), 0
    while count:
        rng, seed = np.random.default_rng([seed, graph.limbs, 7]), seed + 1
        start, goal = random_task(graph, rng)
        here, boxes = graph.posture_of(start).base_position[0], []
        for k in range(group.boxes):
            centre = here + rng.uniform(0.3, 0.7) * (goal - here) + rng.uniform(-0.3, 0.3, 3)
            half = tuple(rng.uniform(0.05, 0.15, 3).tolist())
            boxes.append(Box(f"box{k}", "obstacle", tuple(centre.tolist()), half))
        if group.walls:
            x = float(here[0] + rng.uniform(0.3, 0.7) * (goal[0] - here[0]))
            top = 1.1 if count % 2 else float(rng.uniform(0.0, 0.5))
            boxes.append(
                Box.between("wall", "obstacle", (x - 0.1, -1.1, -1.1), (x + 0.1, 1.1, top))
            )
        points = rng.permutation(len(graph.grasp_map))
        points = points[~np.isin(points, start.stance)][: group.points]
        graph.add_obstacles(boxes)
        try:
            graph.state(start.stance)
            graph.grasp_map.check_goal(goal)
        except (GoalError, StanceError):
            continue
        finally:
            graph.remove_obstacles()
        count -= 1
        yield Drawn(start, goal, boxes, points.tolist())


def planned(graph: StanceGraph, task: Drawn, cost: str, seconds: float) -> dict[str, Any]:
    """Plan a task once; return whether it was decided, the processor time, cost and bound."""
    graph.add_obstacles(task.boxes)
    graph.occupy(task.points)
    began = time.process_time()
    found = Planner(graph).plan(task.start.stance, task.goal, cost, time_limit=seconds)
    return {
        "decided": found.plan is not None or found.reason in PROVED_IMPOSSIBLE,
        "first": found.improvements[0].time if found.improvements else None,
        "seconds": time.process_time() - began,
        "cost": found.plan.statistics.cost if found.plan else None,
        "proved": bool(found.plan and found.plan.statistics.bound == 1.0),
    }


def measured(tasks: int, seconds: float) -> dict[str, Any]:
    """Plan all tasks with all variants, by turns; time limits are of processor time."""
    data: dict[str, Any] = {"seconds": seconds, "groups": {}}
    for name, group in GROUPS.items():
        rows: dict[str, list[Any]] = {variant: [] for variant in group.variants}
        every = list(drawn(group, tasks))
        planned(stance_graph(**group.world), every[0], group.costs[0], 60.0)  # compiles
        for task in tqdm(every, desc=name, disable=None):
            for cost in group.costs:
                for variant, patches in group.variants.items():
                    with ExitStack() as stack:
                        stack.enter_context(patch("time.perf_counter", time.process_time))
                        for target, value in patches.items():
                            stack.enter_context(patch(target, value))
                        graph = stance_graph(**group.world)
                        rows[variant].append(planned(graph, task, cost, group.longer * seconds))
        data["groups"][name] = rows
    return data


def markdown(data: dict[str, Any]) -> str:
    """Return the page: what each variant solves, and how soon."""
    cells = []
    for name, rows in data["groups"].items():
        for variant, found in rows.items():
            times = [one["seconds"] for one in found]
            solved, proved = (sum(one[what] for one in found) for what in ("decided", "proved"))
            first = [one["first"] for one in found if one["first"] is not None]
            cells.append([
                name, variant, f"{solved} of {len(found)}", proved,
                f"{np.median(first):.3f}" if first else "-",
                f"{np.median(times):.3f}", f"{np.mean(times):.3f}",
            ])  # fmt: skip
    head = "tasks | search | decided | proved optimal | first plan [s] | whole [s] | mean [s]"
    return f"""# Ablation

Made by `experiments/ablation.py`: each part of the search is switched off in turn. A task is \
decided if a plan is found in {data["seconds"]:g} s of processor time (three times as much among \
walls and in the laboratory), or it is proved that there is none. Times are medians of processor \
time; the last is a mean. Tasks of a row are those of the rows beside it.

{table(head, cells)}"""


if __name__ == "__main__":
    experiment("ablation", __doc__, measured, markdown, indent=None, tasks=20, seconds=2.0)
