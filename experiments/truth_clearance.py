"""Steps past obstacles that are put next to where they lead; part of `truth.py`."""

from __future__ import annotations

from typing import Any

import numpy as np
from collision_judge import Judge
from processes import Processes
from scipy.spatial.transform import Rotation
from truth_walks import random_walk, whole_graph

from mlivr_gym import Box
from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration, capsule_ends
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.planners.walks import plan_of
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.transitions.state import State

SAMPLES = 500
"""Configurations looked at along a step."""

HALVES = {
    "rod": (0.0005, 0.0005, 0.3),
    "plate": (0.2, 0.2, 0.0005),
    "box": (0.05, 0.08, 0.03),
    "beam": (0.02, 0.02, 0.4),
}
"""Half edges of the obstacles [m]."""

FARTHEST_GAP = 0.05
"""Largest distance of an obstacle from the capsule that it is put next to [m]."""


def sampled(graph: PairGraph, plan: Plan) -> list[tuple[Configuration, list[tuple[int, int]]]]:
    """Configurations along the one step of a plan, with the limbs that are at a point."""
    step, motion = plan.steps[0], step_motion(graph, plan, 0, SAMPLES)
    before, after = (graph.indices(plan.stances[n]) for n in (0, 1))
    out = []
    for n, phase in enumerate(motion.phase.tolist()):
        points = [(i, before[i]) for i in range(2) if i != step.limb]
        points += [(step.limb, before[step.limb])] if phase == 0 else []
        points += [(step.limb, after[step.limb])] if phase == 2 else []
        here = motion.base_positions[n], motion.base_quaternions[n], motion.joint_positions[n]
        out.append((here, points))
    return out


def beside(judge: Judge, here: Configuration, kind: str, rng: np.random.Generator) -> Box:
    """An obstacle next to a random capsule of a limb, in a random direction."""
    ends, half = capsule_ends(judge.robot, judge.shapes, here), HALVES[kind]
    limb, c = int(rng.integers(len(ends))), int(rng.integers(len(judge.shapes.radii)))
    a, b = ends[limb][c]
    point = a + rng.random() * (b - a)
    along = b - a if np.linalg.norm(b - a) > 1e-9 else rng.normal(size=3)
    across: Array = np.cross(along, rng.normal(size=3))
    across /= np.linalg.norm(across)
    gap = rng.uniform(0.0, FARTHEST_GAP) + judge.shapes.radii[c]
    turn = Rotation.align_vectors([across], [[1.0, 0.0, 0.0]])[0].as_matrix()
    if kind == "plate":
        turn = Rotation.align_vectors([across], [[0.0, 0.0, 1.0]])[0].as_matrix()
    depth = half[2] if kind == "plate" else half[0]
    centre = point + (gap + depth) * across
    x, y, z = centre.tolist()
    return Box("beside", "obstacle", (x, y, z), half, Box.rows(turn))


def past_an_obstacle(seed: int) -> tuple[str, str, int, float]:
    """A random step with an obstacle beside it: the obstacle, and what came of the step.

    Returns:
        Kind of the obstacle, `blocked` or `made`, configurations looked at, least distance [m].
    """
    graph, rng = whole_graph(), np.random.default_rng([8, seed])
    judge = Judge(graph)
    plan = None
    while plan is None:
        states = random_walk(graph, rng, 1)
        plan = plan_of(graph, states, np.zeros(3), 0.0, "astar") if len(states) == 2 else None
    kind = str(rng.choice(list(HALVES)))
    places = sampled(graph, plan)
    box = beside(judge, places[int(rng.integers(len(places)))][0], kind, rng)
    graph.add_obstacles([box])
    try:
        made = _made(graph, states)
        if made is None:
            return kind, "blocked", 0, np.inf
        places = sampled(graph, made)
        least = min(judge.least_distance(here, points, [box]) for here, points in places)
        return kind, "made", len(places), least
    finally:
        graph.remove_obstacles()


def _made(graph: PairGraph, states: list[State]) -> Plan | None:
    """The plan of the same step among the obstacles that there are now."""
    stance, after = states[0].stance, states[1].stance
    s = graph.find(stance)
    if not graph.mask[s].all() or not graph.mask[graph.find(after)].all():
        return None
    state = State(stance, tuple(graph.mask[s].tolist()))
    reached = graph.step_to(state, after)
    return None if reached is None else plan_of(graph, [state, reached], np.zeros(3), 0.0, "astar")


def study_clearance(number: int, processes: Processes) -> dict[str, Any]:
    """Random steps past obstacles, looked at with coal."""
    out: dict[str, Any] = {"clearance": whole_graph().settings.clearance}
    kinds = {kind: {"steps": 0, "made": 0, "configurations": 0, "least": np.inf} for kind in HALVES}
    for kind, told, looked, least in processes.answers(
        past_an_obstacle, range(number), "steps past obstacles"
    ):
        row = kinds[kind]
        row["steps"] += 1
        row["made"] += told == "made"
        row["configurations"] += looked
        row["least"] = min(row["least"], least)
    return out | {"obstacles": kinds}
