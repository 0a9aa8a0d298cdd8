"""Switch off each part of the search for three and four limbs in turn, and measure its worth.

    python experiments/ablation.py --variant NAME [--out results] [--tasks 50] [--seconds 2]

Random tasks on the JEM with collisions checked and the step cost: without obstacles, with a box on
the straight line to the goal, and with such a box and ten occupied points. All variants get the
same tasks. A call measures one variant, with at
most ten minutes of planning, adds it to `ablation.json` and
writes `ablation.md`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from many_limbs import random_task
from reports import command_line, publish, read, table

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


def _no_node_table() -> None:
    searches.node_table = lambda graph: None  # type: ignore[attr-defined]


def _no_stance_sets() -> None:
    _no_node_table()
    ImplicitGraph.sets = lambda self, *args, **kinds: None  # type: ignore[method-assign,assignment]


def _cheapest_path_alone() -> None:
    table_search.STAGES = table_search.OBSTACLE_STAGES = table_search.STAGES[-2:]


def _no_enclosure_probe() -> None:
    table_search.OBSTACLE_STAGES = table_search.OBSTACLE_STAGES[2:]


def _no_half_weight() -> None:
    probe, proof, _, *others = table_search.OBSTACLE_STAGES
    table_search.OBSTACLE_STAGES = (probe, proof, *others)


def _no_middle_weight() -> None:
    for name in ("STAGES", "OBSTACLE_STAGES"):
        stages = getattr(table_search, name)
        setattr(table_search, name, (*stages[:-3], *stages[-2:]))


def _no_inflation() -> None:
    _no_node_table()
    implicit_search.COST_TO_GO_INFLATION = 1.0


def _by_lower_bound() -> None:
    _no_node_table()
    search: Any = implicit_search._ImplicitSearch
    search._next_queue = lambda self: self.by_lower_bound


VARIANTS: dict[str, Callable[[], None]] = {
    "all": lambda: None,
    "only the stages of the cheapest path": _cheapest_path_alone,
    "no probe for an enclosed start": _no_enclosure_probe,
    "no stage of weight 1 / 2 among obstacles": _no_half_weight,
    "no stage of weight 1 / 1.1": _no_middle_weight,
    "no node table": _no_node_table,
    "neither node table nor stance sets": _no_stance_sets,
    "no node table, queues by estimate and lower bound alone": _no_inflation,
    "no node table, queue by lower bound alone": _by_lower_bound,
}
"""Variants, and the functions that switch parts of the search off."""


def tasks(robot: str, world: str, count: int) -> list[tuple[State, Array, list[Box], list[int]]]:
    """Return start, goal, boxes and occupied points of random tasks whose start can be held."""
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


def solved(robot: str, world: str, count: int, seconds: float) -> list[dict[str, Any]]:
    """Plan the tasks and return time, cost and bound of each result."""
    out = []
    for start, goal, boxes, taken in tasks(robot, world, count):
        graph = stance_graph(robot=robot)
        graph.add_obstacles(boxes)
        graph.occupy(taken)
        began = time.perf_counter()
        found = Planner(graph).plan(start.stance, goal.tolist(), "steps", time_limit=seconds)
        out.append(
            {
                "seconds": time.perf_counter() - began,
                "reason": found.reason,
                "first": found.improvements[0].time if found.improvements else None,
                "steps": len(found.plan.steps) if found.plan else None,
                "bound": found.plan.statistics.bound if found.plan else None,
            }
        )
    return out


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


def main() -> None:
    """Measure one variant."""
    parser = command_line(__doc__)
    parser.add_argument("--tasks", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--variant", choices=list(VARIANTS))
    parser.add_argument("--name")
    parser.add_argument("--remark", help="what is to be known of how this variant was measured")
    given = parser.parse_args()
    rows = read(given.out, "ablation")
    name, rows["seconds"] = given.name or given.variant, given.seconds
    if given.remark:
        rows.setdefault("remarks", []).append(f"* {name}: {given.remark}")
    VARIANTS[given.variant]()
    for robot in ROBOTS:
        solved(robot, WORLDS[0], 1, given.seconds)  # compiles, and unpacks the table
        for world in WORLDS:
            found = solved(robot, world, given.tasks, given.seconds)
            rows.setdefault(f"{robot}, {world}", {})[name] = found
            publish(given.out, "ablation", rows, markdown, indent=None)
            print(robot, world, name, sum(o["first"] is not None for o in found), flush=True)


if __name__ == "__main__":
    main()
