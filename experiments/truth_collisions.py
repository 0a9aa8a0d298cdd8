"""The planner's collision checks against MuJoCo's collision pipeline and coal; part of `truth.py`.

Stances, steps and plans that the planner calls free are put into the exported MuJoCo scene, motions
as dense samples, and every pair of shapes that MuJoCo finds in contact is counted; coal measures
the least distance of all compared pairs. What the planner calls blocked is looked at in the same
way.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from blocked_steps import DIRECT, SAMPLED, grasps_at, why_blocked
from collision_judge import Judge
from tqdm import tqdm

from mlivr_gym import Settings, State, jem_map, stance_graph
from mlivr_gym.collisions.contacts import Configuration, contacts
from mlivr_gym.collisions.uncompared import NOT_COMPARED
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.planners.walks import plan_of
from mlivr_gym.stances.pair_graph import PairGraph


def configuration_of(
    graph: PairGraph, s: int, rng: np.random.Generator
) -> tuple[Configuration, list[tuple[int, int]]]:
    """A stance on random ones of the branches that its limbs may hold on."""
    a, b = graph.points[s].tolist()
    masks = []
    for mask in graph.mask[s].tolist():
        bits = [bit for bit in range(16) if mask >> bit & 1]
        masks.append(1 << int(rng.choice(bits)))
    return graph.configuration(State((a, b), tuple(masks))), [(0, a), (1, b)]


def study_stances(
    graph: PairGraph, free: PairGraph, judge: Judge, count: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Random free stances, and the best postures of those that only collisions rule out."""
    touching, least = 0, []
    for s in tqdm(
        rng.choice(len(graph), count, replace=False), desc="free stances", mininterval=2.0
    ):
        here, points = configuration_of(graph, int(s), rng)
        touching += bool(judge.penetrations(here, points))
        least.append(judge.least_distance(here, points))
    ruled_out = [s for s in range(len(free)) if graph.find(free.points[s].tolist()) < 0]
    close = overlap = 0
    for s in ruled_out:
        a, b = free.points[s].tolist()
        posture = int(free.branch[s, 0]), int(free.branch[s, 1])
        here = free.configuration(State((a, b), (1 << posture[0], 1 << posture[1])))
        grasps = grasps_at(free, enumerate((a, b)))
        close += bool(
            contacts(free.robot, free.grasp_map.boxes, here, graph.settings.clearance, grasps)
        )
        overlap += bool(judge.penetrations(here, [(0, a), (1, b)]))
    return {
        "free": count,
        "free_penetrating": touching,
        "free_least_distance": min(least),
        "left_out": len(ruled_out),
        "left_out_nearer_than_clearance": close,
        "left_out_penetrating": overlap,
    }


def one_step(graph: PairGraph, s0: int, s1: int, held: int) -> Plan | None:
    """The plan of a single step, put together as any plan is."""
    entry = int(graph.edge_masks(held, s0, np.array([s1]))[0])
    stances = [tuple(graph.points[s].tolist()) for s in (s0, s1)]
    masks = [graph.mask[s].tolist() for s in (s0, s1)]
    masks[0][held] = masks[1][held] = entry
    masks[1][1 - held] = graph.released(stances[1], graph.posture(stances[1]), 1 - held) & 0xFFFF
    states = [State(stance, tuple(m)) for stance, m in zip(stances, masks, strict=True)]
    return plan_of(graph, states, np.zeros(3), 0.0, "astar")


def motion_penetrations(
    graph: PairGraph, judge: Judge, plan: Plan, samples: int
) -> tuple[int, int, list[tuple[str, str, float]]]:
    """Configurations looked at along a plan, how many penetrate, and the pairs."""
    looked = bad = 0
    pairs: list[tuple[str, str, float]] = []
    for k, step in enumerate(plan.steps):
        motion = step_motion(graph, plan, k, samples)
        before, after = (graph.indices(plan.stances[n]) for n in (k, k + 1))
        for n in range(len(motion.phase)):
            points = [(i, before[i]) for i in range(2) if i != step.limb]
            points += [(step.limb, before[step.limb])] if motion.phase[n] == 0 else []
            points += [(step.limb, after[step.limb])] if motion.phase[n] == 2 else []
            here = (motion.base_positions[n], motion.base_quaternions[n], motion.joint_positions[n])
            found = judge.penetrations(here, points)
            looked += 1
            bad += bool(found)
            pairs += found
    return looked, bad, pairs


def random_step(
    graph: PairGraph, free: PairGraph, rng: np.random.Generator
) -> tuple[int, int, int]:
    """The limb that holds and two stances of a step that is possible without collisions."""
    while True:
        s0, held = int(rng.integers(len(graph))), int(rng.integers(2))
        row = graph.row(held, s0)
        if not len(row):
            continue
        s1 = int(rng.choice(row))
        pair = [free.find(graph.points[s].tolist()) for s in (s0, s1)]
        if min(pair) >= 0 and free.edge_masks(held, pair[0], np.array([pair[1]]))[0]:
            return held, s0, s1


def study_steps(
    graph: PairGraph,
    free: PairGraph,
    judge: Judge,
    count: int,
    most_blocked: int,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Random free steps, and what keeps random blocked ones out of the graph."""
    looked = bad = done = 0
    kinds: Counter[str] = Counter()
    blocked: list[tuple[int, int, int]] = []
    drawn = possible = 0
    bar = tqdm(total=count, desc="free steps", mininterval=2.0)
    while done < count or len(blocked) < most_blocked:
        held, s0, s1 = random_step(graph, free, rng)
        drawn += 1
        if not graph.edge_masks(held, s0, np.array([s1]))[0]:
            blocked.append((held, s0, s1))
            continue
        possible += 1
        if done == count:
            continue
        plan = one_step(graph, s0, s1, held)
        if plan is None:
            kinds["no swing"] += 1
            continue
        a, b, _ = motion_penetrations(graph, judge, plan, 60)
        looked, bad, done = looked + a, bad + b, done + 1
        kinds[plan.steps[0].swing] += 1
        bar.update()
    bar.close()
    causes = Counter(
        why_blocked(graph, *step)
        for step in tqdm(blocked[:most_blocked], desc="blocked steps", mininterval=2.0)
    )
    return {
        "free": done,
        "configurations": looked,
        "penetrating": bad,
        "swings": dict(kinds),
        "share_blocked": 1 - possible / drawn,
        "blocked": most_blocked,
        "blocked_because": dict(causes),
    }


def study_plans(
    graph: PairGraph, judge: Judge, count: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Random plans of both costs, sampled densely."""
    planner = Planner(graph)
    looked = bad = steps = 0
    kinds: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    pairs: list[tuple[str, str, float]] = []
    for k in tqdm(range(count), desc="plans", mininterval=2.0):
        start, goal = sample_task(graph, rng, 0.2)
        result = planner.plan(start.stance, goal, ("base", "steps")[k % 2])
        reasons[result.reason or "found"] += 1
        if result.plan is None:
            continue
        steps += len(result.plan.steps)
        kinds.update(step.swing for step in result.plan.steps)
        a, b, found = motion_penetrations(graph, judge, result.plan, 30)
        looked, bad = looked + a, bad + b
        pairs += found
    return {
        "plans": count,
        "outcomes": dict(reasons),
        "steps": steps,
        "configurations": looked,
        "penetrating": bad,
        "swings": dict(kinds),
        "pairs": pairs[:20],
    }


def tell_collisions(data: dict[str, Any]) -> str:
    """The figures as Markdown."""
    s, t, p = data["stances"], data["steps"], data["plans"]
    because = ", ".join(f"{name} {count}" for name, count in sorted(t["blocked_because"].items()))
    lost = sum(t["blocked_because"].get(name, 0) for name in (DIRECT, SAMPLED)) / t["blocked"]
    rows = "\n".join(
        f"| {row.first} | {row.second} | {row.whose} | {row.reason} |" for row in NOT_COMPARED
    )
    swings, outcomes = (
        ", ".join(f"{name} {count}" for name, count in sorted(p[key].items()))
        for key in ("swings", "outcomes")
    )
    return f"""**Collisions.** The MuJoCo scene holds the shapes that the planner checks. \
Clearance {data["clearance"]:g} m.

| what | looked at | penetrating by MuJoCo |
|---|---|---|
| random stances called free, on random branches of those allowed | {s["free"]} \
| {s["free_penetrating"]} |
| random steps called free, sampled | {t["free"]} ({t["configurations"]} configurations) \
| {t["penetrating"]} |
| random plans, sampled | {p["plans"]} ({p["steps"]} steps, {p["configurations"]} configurations) \
| {p["penetrating"]} |

Least distance of limbs, body and mounts to boxes and of limbs to each other over the free \
stances by coal:
{1000 * s["free_least_distance"]:.2f} mm.

**What is called blocked.** {s["left_out"]} stances meet the thresholds but are left out; the best \
posture of
{s["left_out_nearer_than_clearance"]} of them lies nearer than the clearance to something, that of \
{s["left_out_penetrating"]}
penetrates by MuJoCo's judgement. Of steps between free stances that are possible without \
collisions, {100 * t["share_blocked"]:.1f} % are
called blocked. Of {t["blocked"]} of these, looked at branch by branch and with a sampling planner \
in base parameter and joint
angles: {because}. So {100 * lost:.1f} % of the steps called blocked could be made; they are
{100 * lost * t["share_blocked"]:.1f} % of the possible ones.

Swings of the plans: {swings}. Outcomes:
{outcomes}.

**What is not compared** (`mlivr_gym/collisions/uncompared.py`); everything else is.

| shape | with | of | because |
|---|---|---|---|
{rows}
"""


def study_collisions(stances: int, steps: int, blocked: int, plans: int) -> dict[str, Any]:
    """Random stances, steps and plans, and what keeps random blocked steps out of the graph."""
    graph, free = (
        stance_graph(jem_map()),
        stance_graph(jem_map(), settings=Settings(collisions=False)),
    )
    assert isinstance(graph, PairGraph)
    assert isinstance(free, PairGraph)
    judge, rng = Judge(graph), np.random.default_rng(2026)
    return {
        "clearance": graph.settings.clearance,
        "stances": study_stances(graph, free, judge, stances, rng),
        "steps": study_steps(graph, free, judge, steps, blocked, rng),
        "plans": study_plans(graph, judge, plans, rng),
    }
