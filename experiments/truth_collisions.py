"""Check the planner's collision tests against MuJoCo and coal; parts of `truth.py`.

Stances, steps and plans that the planner calls free are put into the exported MuJoCo scene, motions
as dense samples, and every pair of shapes in contact is counted; coal measures the minimum distance
of the compared pairs. Stances that are called blocked are checked in the same way, and obstacles
are placed next to random steps.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from coal_ruler import HeldPoints, Ruler, grasps_of, obstacles, sampled
from reports import study_rows, two_limb_graph
from scipy.spatial.transform import Rotation
from tqdm import tqdm
from truth_walks import random_walk, whole_graph

from mlivr_gym import Box, State
from mlivr_gym.arrays import Array
from mlivr_gym.collisions import Configuration, LimbShapes, capsule_ends
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.compiled.bit_sets import bits_of
from mlivr_gym.envs import sample_task
from mlivr_gym.planners import Plan, Planner, plan_of
from mlivr_gym.simulation import scene_spec, set_configuration
from mlivr_gym.stances import StanceGraph
from mlivr_gym.world import BOX, scene_name

HALVES = {
    "rod": (0.0005, 0.0005, 0.3),
    "plate": (0.2, 0.2, 0.0005),
    "box": (0.05, 0.08, 0.03),
    "beam": (0.02, 0.02, 0.4),
}
"""Half edge lengths of the obstacles [m]."""

FARTHEST_GAP = 0.05
"""Maximum distance of an obstacle from the capsule that it is placed next to [m]."""

TOUCH = 1e-6
"""Penetrations below this depth are rounding errors [m]."""


class Scene:
    """The exported MuJoCo scene of a graph's robot and map."""

    def __init__(self, graph: StanceGraph) -> None:
        """Compile the scene."""
        self.ids = graph.grasp_map.ids
        self.model = scene_spec(graph.grasp_map, graph.robot).compile()
        self.data = mujoco.MjData(self.model)

    def penetrates(self, configuration: Configuration, points: HeldPoints) -> bool:
        """Return whether shapes penetrate, except a gripper and the track that it holds."""
        set_configuration(self.model, self.data, *configuration)
        held = {
            frozenset((f"limb{i}/gripper/0", scene_name(BOX, self.ids[p].split(":")[0])))
            for i, p in points
        }
        touching = self.data.contact.geom[self.data.contact.dist < -TOUCH]
        pairs = (frozenset(self.model.geom(g).name for g in pair) for pair in touching)
        return any(pair not in held for pair in pairs)


def penetrating(scene: Scene, places: list[tuple[Configuration, HeldPoints]]) -> int:
    """Count the configurations in which MuJoCo finds penetrating shapes."""
    return sum(scene.penetrates(*place) for place in places)


def least_distance(
    graph: StanceGraph, ruler: Ruler, places: list[tuple[Configuration, HeldPoints]]
) -> float:
    """Return coal's minimum distance over configurations [m]."""
    measured = (ruler.measured(here, grasps_of(graph, points)) for here, points in places)
    return min((found[0][0] for found in measured if found), default=np.inf)


def study_stances(
    graph: StanceGraph, free: StanceGraph, scene: Scene, count: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Check random free stances, and the best postures of stances that only collisions rule out."""
    touching, places = 0, []
    chosen = rng.choice(len(graph), count, replace=False)
    for s in tqdm(chosen, desc="free stances", mininterval=2.0):
        a, b = graph.points[s].tolist()
        # A random branch among those on which each limb may hold.
        branches = [rng.choice(bits_of(m)) for m in graph.branch_sets[s]]
        here = graph.configuration(State((a, b), tuple(1 << int(branch) for branch in branches)))
        places.append((here, [(0, a), (1, b)]))
        touching += scene.penetrates(*places[-1])
    ruled_out = [s for s in range(len(free)) if graph.find(free.points[s].tolist()) < 0]
    close = overlap = 0
    clearance = graph.settings.clearance
    for s in ruled_out:
        a, b = free.points[s].tolist()
        here = free.configuration(State((a, b), tuple(1 << int(k) for k in free.branch[s])))
        held = [(0, a), (1, b)]
        grasps = grasps_of(free, held)
        close += bool(contacts(free.robot, free.grasp_map.boxes, here, clearance, grasps))
        overlap += scene.penetrates(here, held)
    ruler = Ruler(graph.robot, graph.grasp_map.boxes)
    return {
        "free": count,
        "free_penetrating": touching,
        "free_least_distance": least_distance(graph, ruler, places),
        "left_out": len(ruled_out),
        "left_out_nearer_than_clearance": close,
        "left_out_penetrating": overlap,
    }


def one_step(graph: StanceGraph, before: Sequence[int], after: Sequence[int]) -> Plan | None:
    """Return the plan of a step between two stances, or None if it is blocked."""
    stances = tuple(before), tuple(after)
    branch_sets = [graph.branch_sets[graph.find(stance)] for stance in stances]
    if not np.all(branch_sets):
        return None
    state = State(stances[0], tuple(branch_sets[0].tolist()))
    reached = graph.step_to(state, stances[1])
    return None if reached is None else plan_of(graph, [state, reached], np.zeros(3), 0.0, "astar")


def random_step(graph: StanceGraph, free: StanceGraph, rng: np.random.Generator) -> tuple[int, int]:
    """Return both stances of a random step that is possible without collisions."""
    while True:
        s0, held = int(rng.integers(len(graph))), int(rng.integers(2))
        row = np.flatnonzero(graph.points[:, held] == graph.points[s0, held])
        s1 = int(rng.choice(row))
        if s1 != s0 and is_step(free, graph.points[s0].tolist(), graph.points[s1].tolist()):
            return s0, s1


def is_step(graph: StanceGraph, before: Sequence[int], after: Sequence[int]) -> bool:
    """Return whether a step leads from a stance to another one."""
    if graph.find(before) < 0:
        return False
    return graph.step_to(graph.state(before), tuple(after)) is not None


def share_blocked(
    graph: StanceGraph, free: StanceGraph, count: int, rng: np.random.Generator
) -> float:
    """Return the share of random steps between free stances that only collisions rule out."""
    pairs = (graph.points[list(random_step(graph, free, rng))].tolist() for _ in range(count))
    return 1.0 - sum(is_step(graph, *pair) for pair in pairs) / count


def study_plans(
    graph: StanceGraph, scene: Scene, count: int, rng: np.random.Generator
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
        configurations, bad = configurations + len(places), bad + penetrating(scene, places)
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
    scene, rng = Scene(graph), np.random.default_rng(2026)
    return {
        "clearance": graph.settings.clearance,
        "stances": study_stances(graph, free, scene, stances, rng),
        "share_blocked": share_blocked(graph, free, steps, rng),
        "plans": study_plans(graph, scene, plans, rng),
    }


def obstacle_beside(
    graph: StanceGraph, here: Configuration, kind: str, rng: np.random.Generator
) -> Box:
    """Return an obstacle next to a random capsule of a limb, in a random direction."""
    shapes, half = LimbShapes(graph.robot), HALVES[kind]
    ends = capsule_ends(graph.robot, shapes, here)
    limb, c = int(rng.integers(len(ends))), int(rng.integers(len(shapes.radii)))
    a, b = ends[limb][c]
    point = a + rng.random() * (b - a)
    along = b - a if np.linalg.norm(b - a) > 1e-9 else rng.normal(size=3)
    across: Array = np.cross(along, rng.normal(size=3))
    across /= np.linalg.norm(across)
    gap = rng.uniform(0.0, FARTHEST_GAP) + shapes.radii[c]
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
    plan = None
    while plan is None:
        states = random_walk(graph, rng, 1)
        plan = plan_of(graph, states, np.zeros(3), 0.0, "astar") if len(states) == 2 else None
    kind = str(rng.choice(list(HALVES)))
    places = sampled(graph, plan, 500)
    box = obstacle_beside(graph, places[int(rng.integers(len(places)))][0], kind, rng)
    with obstacles(graph, box):
        made = one_step(graph, states[0].stance, states[1].stance)
        places = [] if made is None else sampled(graph, made, 500)
    least = least_distance(graph, Ruler(graph.robot, [*graph.grasp_map.boxes, box]), places)
    return {
        "kind": kind, "made": made is not None, "configurations": len(places), "least": least
    }  # fmt: skip


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
