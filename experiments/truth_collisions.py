"""Check the planner's collision tests against MuJoCo and coal; parts of `truth.py`.

Stances, steps and plans that the planner calls free are put into the exported MuJoCo scene, motions
as dense samples, and every pair of shapes in contact is counted; coal measures the minimum distance
of the compared pairs. Stances that are called blocked are checked in the same way, and obstacles
are placed next to random steps.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from collision_judge import HeldPoints, Judge
from reports import study_rows, two_limb_graph
from scipy.spatial.transform import Rotation
from tqdm import tqdm
from truth_walks import random_walk, whole_graph

from mlivr_gym import Box, State
from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration, capsule_ends, contacts
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.planners.walks import plan_of
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

HALVES = {
    "rod": (0.0005, 0.0005, 0.3),
    "plate": (0.2, 0.2, 0.0005),
    "box": (0.05, 0.08, 0.03),
    "beam": (0.02, 0.02, 0.4),
}
"""Half edge lengths of the obstacles [m]."""

FARTHEST_GAP = 0.05
"""Maximum distance of an obstacle from the capsule that it is placed next to [m]."""


def sampled(
    graph: TwoLimbGraph, plan: Plan, samples: int
) -> list[tuple[Configuration, HeldPoints]]:
    """Return configurations along each step of a plan, with the limbs that are at a point."""
    out = []
    for k, step in enumerate(plan.steps):
        motion = step_motion(graph, plan, k, samples)
        before, after = (graph.indices(plan.stances[n]) for n in (k, k + 1))
        for n, phase in enumerate(motion.phase.tolist()):
            points = [(i, before[i]) for i in range(2) if i != step.limb]
            points += [(step.limb, before[step.limb])] if phase == 0 else []
            points += [(step.limb, after[step.limb])] if phase == 2 else []
            here = motion.base_positions[n], motion.base_quaternions[n], motion.joint_positions[n]
            out.append((here, points))
    return out


def penetrating(judge: Judge, places: list[tuple[Configuration, HeldPoints]]) -> int:
    """Count the configurations in which MuJoCo finds penetrating shapes."""
    return sum(bool(judge.penetrations(*place)) for place in places)


def study_stances(
    graph: TwoLimbGraph, free: TwoLimbGraph, judge: Judge, count: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Check random free stances, and the best postures of stances that only collisions rule out."""
    touching, least = 0, []
    chosen = rng.choice(len(graph), count, replace=False)
    for s in tqdm(chosen, desc="free stances", mininterval=2.0):
        a, b = graph.points[s].tolist()
        # A random branch among those on which each limb may hold.
        branches = [rng.choice([k for k in range(16) if m >> k & 1]) for m in graph.branch_sets[s]]
        here = graph.configuration(State((a, b), tuple(1 << int(branch) for branch in branches)))
        touching += bool(judge.penetrations(here, [(0, a), (1, b)]))
        least.append(judge.least_distance(here, [(0, a), (1, b)]))
    ruled_out = [s for s in range(len(free)) if graph.find(free.points[s].tolist()) < 0]
    close = overlap = 0
    grasps, clearance = free.solver.grasps, graph.settings.clearance
    for s in ruled_out:
        a, b = free.points[s].tolist()
        here = free.configuration(State((a, b), tuple(1 << int(k) for k in free.branch[s])))
        held = [(i, grasps["point"][p], grasps["normal"][p]) for i, p in enumerate((a, b))]
        close += bool(contacts(free.robot, free.grasp_map.boxes, here, clearance, held))
        overlap += bool(judge.penetrations(here, [(0, a), (1, b)]))
    return {
        "free": count,
        "free_penetrating": touching,
        "free_least_distance": min(least),
        "left_out": len(ruled_out),
        "left_out_nearer_than_clearance": close,
        "left_out_penetrating": overlap,
    }


def one_step(graph: TwoLimbGraph, s0: int, s1: int, held: int) -> Plan | None:
    """Return the plan of a single step, made as any plan is."""
    entry = int(graph.kept_branches(held, s0, np.array([s1]))[0])
    stances = [tuple(graph.points[s].tolist()) for s in (s0, s1)]
    branch_sets = [graph.branch_sets[s].tolist() for s in (s0, s1)]
    branch_sets[0][held] = branch_sets[1][held] = entry
    branch_sets[1][1 - held] = (
        graph.releasable_branches(stances[1], graph.posture(stances[1]), 1 - held) & 0xFFFF
    )
    states = [State(stance, tuple(m)) for stance, m in zip(stances, branch_sets, strict=True)]
    return plan_of(graph, states, np.zeros(3), 0.0, "astar")


def random_step(
    graph: TwoLimbGraph, free: TwoLimbGraph, rng: np.random.Generator
) -> tuple[int, int, int]:
    """Return support limb and both stances of a random step that is possible without collisions."""
    while True:
        s0, held = int(rng.integers(len(graph))), int(rng.integers(2))
        row = graph.row(held, s0)
        if not len(row):
            continue
        s1 = int(rng.choice(row))
        pair = [free.find(graph.points[s].tolist()) for s in (s0, s1)]
        if min(pair) >= 0 and free.kept_branches(held, pair[0], np.array([pair[1]]))[0]:
            return held, s0, s1


def study_steps(
    graph: TwoLimbGraph, free: TwoLimbGraph, judge: Judge, count: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Check random free steps, and measure the share of steps that are blocked."""
    configurations = bad = done = drawn = possible = 0
    bar = tqdm(total=count, desc="free steps", mininterval=2.0)
    while done < count:
        held, s0, s1 = random_step(graph, free, rng)
        drawn += 1
        if not graph.kept_branches(held, s0, np.array([s1]))[0]:
            continue
        possible += 1
        plan = one_step(graph, s0, s1, held)
        if plan is not None:
            places = sampled(graph, plan, 60)
            configurations, bad = configurations + len(places), bad + penetrating(judge, places)
            done += 1
            bar.update()
    bar.close()
    return {
        "free": done,
        "configurations": configurations,
        "penetrating": bad,
        "share_blocked": 1 - possible / drawn,
    }


def study_plans(
    graph: TwoLimbGraph, judge: Judge, count: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Check dense samples of random plans of both costs."""
    planner, kinds = Planner(graph), Counter[str]()
    configurations = bad = steps = 0
    for k in tqdm(range(count), desc="plans", mininterval=2.0):
        start, goal = sample_task(graph, rng, 0.2)
        plan = planner.plan(start.stance, goal, ("base", "steps")[k % 2]).unwrap()
        steps += len(plan.steps)
        kinds.update(step.swing for step in plan.steps)
        places = sampled(graph, plan, 30)
        configurations, bad = configurations + len(places), bad + penetrating(judge, places)
    return {
        "plans": count,
        "steps": steps,
        "configurations": configurations,
        "penetrating": bad,
        "swings": dict(kinds),
    }


def study_collisions(stances: int, steps: int, plans: int) -> dict[str, Any]:
    """Check random stances, steps and plans."""
    graph, free = two_limb_graph(), two_limb_graph(collisions=False)
    judge, rng = Judge(graph), np.random.default_rng(2026)
    return {
        "clearance": graph.settings.clearance,
        "stances": study_stances(graph, free, judge, stances, rng),
        "steps": study_steps(graph, free, judge, steps, rng),
        "plans": study_plans(graph, judge, plans, rng),
    }


def obstacle_beside(judge: Judge, here: Configuration, kind: str, rng: np.random.Generator) -> Box:
    """Return an obstacle next to a random capsule of a limb, in a random direction."""
    ends, half = capsule_ends(judge.robot, judge.shapes, here), HALVES[kind]
    limb, c = int(rng.integers(len(ends))), int(rng.integers(len(judge.shapes.radii)))
    a, b = ends[limb][c]
    point = a + rng.random() * (b - a)
    along = b - a if np.linalg.norm(b - a) > 1e-9 else rng.normal(size=3)
    across: Array = np.cross(along, rng.normal(size=3))
    across /= np.linalg.norm(across)
    gap = rng.uniform(0.0, FARTHEST_GAP) + judge.shapes.radii[c]
    thin = 2 if kind == "plate" else 0
    turn = Rotation.align_vectors([across], [np.eye(3)[thin]])[0].as_matrix()
    x, y, z = (point + (gap + half[thin]) * across).tolist()
    return Box("beside", "obstacle", (x, y, z), half, Box.rows(turn))


def step_past_obstacle(task: int) -> dict[str, Any]:
    """Place an obstacle next to a random step and check the step again.

    Return the kind of the obstacle, whether the step can still be made, the number of sampled
    configurations, and their minimum distance [m].
    """
    graph, rng = whole_graph(), np.random.default_rng([8, task])
    judge = Judge(graph)
    plan = None
    while plan is None:
        states = random_walk(graph, rng, 1)
        plan = plan_of(graph, states, np.zeros(3), 0.0, "astar") if len(states) == 2 else None
    kind = str(rng.choice(list(HALVES)))
    places = sampled(graph, plan, 500)
    box = obstacle_beside(judge, places[int(rng.integers(len(places)))][0], kind, rng)
    graph.add_obstacles([box])
    try:
        made = _made(graph, states)
        if made is None:
            return {"kind": kind, "made": False, "configurations": 0, "least": np.inf}
        places = sampled(graph, made, 500)
        least = min(judge.least_distance(here, points, [box]) for here, points in places)
        return {"kind": kind, "made": True, "configurations": len(places), "least": least}
    finally:
        graph.remove_obstacles()


def _made(graph: TwoLimbGraph, states: list[State]) -> Plan | None:
    """Return the plan of the same step among the present obstacles, or None if it is blocked."""
    stance, after = states[0].stance, states[1].stance
    s = graph.find(stance)
    if not graph.branch_sets[s].all() or not graph.branch_sets[graph.find(after)].all():
        return None
    state = State(stance, tuple(graph.branch_sets[s].tolist()))
    reached = graph.step_to(state, after)
    return None if reached is None else plan_of(graph, [state, reached], np.zeros(3), 0.0, "astar")


def study_clearance(number: int, workers: int) -> dict[str, Any]:
    """Measure distances along random steps past obstacles with coal."""
    rows, kinds = study_rows("truth_collisions:step_past_obstacle", number, workers), {}
    for kind in HALVES:
        some = [row for row in rows if row["kind"] == kind]
        kinds[kind] = {
            "steps": len(some),
            "made": sum(row["made"] for row in some),
            "configurations": sum(row["configurations"] for row in some),
            "least": min((row["least"] for row in some), default=np.inf),
        }
    return {"clearance": two_limb_graph().settings.clearance, "obstacles": kinds}
