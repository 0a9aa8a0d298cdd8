"""What the rule of windows costs, and how long it takes to say no; parts of `truth.py`."""

from __future__ import annotations

import time
from collections import Counter
from typing import Any

import numpy as np
from numba import njit
from tqdm import tqdm

from mlivr_gym import jem_map, stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, BasePath, base_path
from mlivr_gym.kinematics.certificate import certify
from mlivr_gym.kinematics.holding import Holding, in_windows
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.planners import Planner
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.transitions.state import State

KEPT = 0.35
"""Share of the points of a map on which some goals cannot be reached."""

RADIUS = 0.05
"""Radius of the goal regions there [m]."""


@njit  # type: ignore[untyped-decorator]
def held(
    robots: Any, i: int, flange: Pose, path: BasePath, floor: float, mask: int, room: Holding
) -> tuple[int, int]:
    """Branches on which limb `i` can hold along a path, and those with joints in their windows."""
    free = certify(robots[0].limbs[i], flange, path, floor, mask, room.proof)
    return free, in_windows(robots[0].limbs[i], flange, path, free, room.track)


def study_windows(number: int) -> dict[str, Any]:
    """Random pairs of stances of a row: how many steps are no edges for their windows alone."""
    graph, rng = stance_graph(jem_map()), np.random.default_rng(6)
    assert isinstance(graph, PairGraph)
    floor = graph.settings.path_floor * graph.robot.characteristic_length**3
    room, able, lost, branches, gone = Holding.row(), 0, 0, 0, 0
    for _ in range(number):
        s, i = int(rng.integers(len(graph))), int(rng.integers(2))
        row = graph.row(i, s)
        if not len(row):
            continue
        both = np.array([s, int(rng.choice(row))])
        mask = int(np.bitwise_and.reduce(graph.mask[both, i]))
        bases = graph.node_postures(both).base_rows
        grasp = graph.solver.grasps[graph.points[s, i]]
        free = inside = 0
        for kind in (STRAIGHT, ARC):
            path = base_path(bases[0], bases[1], kind, grasp["point"])
            one, other = held(graph.checks.robots, i, grasp["flange"], path, floor, mask, room)
            free, inside = free | one, inside | other
        # Of the two flips one is enough.
        free, inside = ((m | m >> 8) & 0xFF for m in (free, inside))
        branches, gone = branches + free.bit_count(), gone + (free & ~inside).bit_count()
        able, lost = able + (free != 0), lost + (free != 0 and inside == 0)
    return {"pairs": number, "able": able, "lost": lost, "branches": branches, "gone": gone}


def study_no(number: int) -> dict[str, Any]:
    """Queries with and without a plan on a sparse map, in turns, as many of each.

    Each is answered by a planner and a stance graph that know nothing yet of steps.
    """
    whole, rng = jem_map(), np.random.default_rng(7)
    sparse = whole.subset(rng.random(len(whole)) < KEPT, "sparse")
    graph = stance_graph(sparse)
    assert isinstance(graph, PairGraph)
    low, high = sparse.cabin
    queries: dict[bool, list[tuple[State, Array]]] = {True: [], False: []}
    while len(queries[False]) < number:
        start, goal = random_state(graph, rng), graph.base_in_world[rng.integers(len(graph))]
        if (goal >= low).all() and (goal <= high).all():
            found = Planner(graph).plan(start, goal, "base", goal_tolerance=RADIUS)
            queries[bool(found)].append((start, goal))
    chosen = rng.choice(len(queries[True]), number, replace=False)
    queries[True] = [queries[True][k] for k in chosen]
    times: dict[bool, list[float]] = {True: [], False: []}
    reasons: Counter[str] = Counter()
    for k in tqdm(range(number), desc="yes and no", mininterval=5.0):
        for reached in (True, False):
            new = stance_graph(sparse)
            assert isinstance(new, PairGraph)
            assert len(new.table.points)
            planner, (start, goal) = Planner(new), queries[reached][k]
            began = time.perf_counter()
            found = planner.plan(start, goal, "base", goal_tolerance=RADIUS)
            times[reached].append(1e3 * (time.perf_counter() - began))
            if not found:
                reasons[found.reason] += 1
    out: dict[str, Any] = {"points": len(sparse), "reasons": dict(reasons)}
    for name, values in (("yes", times[True]), ("no", times[False])):
        out[name] = {
            "queries": len(values),
            "median_ms": float(np.median(values)),
            "p95_ms": float(np.quantile(values, 0.95)),
            "largest_ms": max(values),
        }
    return out
