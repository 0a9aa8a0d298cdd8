"""The planner's collision checks against MuJoCo's collision pipeline and coal.

    python experiments/collision_truth.py [--stances 2000] [--steps 300] [--blocked 150] [--plans 200] [--out results]

Stances, steps and plans that the planner calls free are put into the exported MuJoCo scene, motions
as dense samples, and every pair of shapes that MuJoCo finds in contact is counted; coal measures
the least distance of all compared pairs. What the planner calls blocked is looked at in the same
way. Writes `collision_truth.md` and `collision_truth.json`.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from itertools import combinations
from pathlib import Path
from typing import Any

import coal
import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from mlivr_gym import Settings, State, jem_map, stance_graph
from mlivr_gym.collisions.contacts import Configuration, capsule_ends, contacts
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.swept_swing import departure_free
from mlivr_gym.collisions.uncompared import NOT_COMPARED
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.files import write_whole
from mlivr_gym.motion.commitment import assemble
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.motion.sampling import sampled_line
from mlivr_gym.motion.swings import Hold, SwingFinder
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.simulation.scene import scene_spec
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.pair_steps import edge_entry
from mlivr_gym.stances.stance_graph import join
from mlivr_gym.transitions.grasp_poses import flange_at, lifted_branches, line_end, place_branches
from mlivr_gym.world.boxes import BOX, scene_name

SAMPLED_PAIRS = 2
"""Pairs of postures between which the sampling planner looks for a swing of a blocked step."""

TOUCH = 1e-6
"""Overlaps below this are rounding [m]."""


class Judge:
    """MuJoCo's and coal's opinion of a configuration."""

    def __init__(self, graph: PairGraph) -> None:
        """Build the scene, and the shapes once more for coal."""
        self.graph, self.robot = graph, graph.robot
        self.model = scene_spec(graph.grasp_map, graph.robot).compile()
        self.data = mujoco.MjData(self.model)
        self.names = [self.model.geom(i).name for i in range(self.model.ngeom)]
        self.address = [
            [int(self.model.joint(f"limb{i}/joint{k + 1}").qposadr[0]) for k in range(6)]
            for i in range(graph.robot.limbs)
        ]
        self.shapes = LimbShapes(graph.robot)

    def penetrations(
        self, configuration: Configuration, points: list[tuple[int, int]]
    ) -> list[tuple[str, str, float]]:
        """Pairs in contact, but for grippers with the track they hold; `points` are limbs and the points they are at."""
        position, quaternion, joints = configuration
        self.data.qpos[:3], self.data.qpos[3:7] = position, quaternion
        for i, angles in enumerate(joints):
            self.data.qpos[self.address[i]] = angles
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        ids = self.graph.grasp_map.ids
        own = {(f"limb{i}/gripper/0", scene_name(BOX, ids[p].split(":")[0])) for i, p in points}
        found = []
        for k in range(self.data.ncon):
            if self.data.contact.dist[k] < -TOUCH:
                a, b = (self.names[g] for g in self.data.contact.geom[k])
                if (a, b) not in own and (b, a) not in own:
                    found.append((a, b, float(self.data.contact.dist[k])))
        return found

    def least_distance(self, configuration: Configuration, points: list[tuple[int, int]]) -> float:
        """Coal's least distance of the robot to boxes and between limbs [m].

        Grippers at a grasp are left out.
        """
        ends = capsule_ends(self.robot, self.shapes, configuration)
        base = Rotation.from_quat(configuration[1], scalar_first=True).as_matrix()
        radius = self.shapes.arrays[2]
        mounts, mount_radius, half, _ = self.shapes.fixed
        at_grasp = {i for i, _ in points}
        limbs = [
            [_capsule(*axis, r) for axis, r in zip(limb, radius, strict=True)] for limb in ends
        ]  # fmt: skip
        with_boxes = [
            _capsule(*(configuration[0] + axis @ base.T), r)
            for axis, r in zip(mounts, mount_radius, strict=True)
        ]
        with_boxes.append((coal.Box(*(2.0 * half)), coal.Transform3s(base, configuration[0])))
        for i, limb in enumerate(limbs):
            with_boxes += limb[: self.shapes.first_gripper] if i in at_grasp else limb
        least = min(
            (
                _distance(a, b)
                for first, second in combinations(limbs, 2)
                for a in first
                for b in second
            ),
            default=np.inf,
        )
        for shape, pose in with_boxes:
            # The sphere round a shape tells which boxes it cannot come near.
            shape.computeLocalAABB()
            middle = pose.getTranslation()
            for box in self.graph.grasp_map.boxes:
                away = np.maximum(np.maximum(box.bounds[0] - middle, middle - box.bounds[1]), 0.0)
                if np.linalg.norm(away) - shape.aabb_radius < min(least, 0.1):
                    solid = coal.Box(*(2.0 * np.array(box.half)))
                    where = coal.Transform3s(np.array(box.rotation), np.array(box.centre))
                    least = min(least, _distance((shape, pose), (solid, where)))
        return float(least)


def _capsule(
    start: NDArray[np.float64], end: NDArray[np.float64], radius: float
) -> tuple[Any, Any]:
    """A capsule for coal, and where it is."""
    along = end - start
    length = float(np.linalg.norm(along))
    if length < 1e-9:
        return coal.Sphere(float(radius)), coal.Transform3s(np.eye(3), start)
    turn = Rotation.align_vectors([along / length], [[0.0, 0.0, 1.0]])[0].as_matrix()
    return coal.Capsule(float(radius), length), coal.Transform3s(turn, 0.5 * (start + end))


def _distance(first: tuple[Any, Any], second: tuple[Any, Any]) -> float:
    """Coal's distance of two placed shapes [m]."""
    return float(coal.distance(*first, *second, coal.DistanceRequest(), coal.DistanceResult()))


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
    """Random free stances, and the best postures of those that were left out."""
    touching, least = 0, []
    for s in tqdm(
        rng.choice(len(graph), count, replace=False), desc="free stances", mininterval=2.0
    ):
        here, points = configuration_of(graph, int(s), rng)
        touching += bool(judge.penetrations(here, points))
        least.append(judge.least_distance(here, points))
    left_out = [s for s in range(len(free)) if graph.find(free.points[s].tolist()) < 0]
    near = overlap = 0
    for s in left_out:
        a, b = free.points[s].tolist()
        posture = int(free.branch[s, 0]), int(free.branch[s, 1])
        here = free.configuration(State((a, b), (1 << posture[0], 1 << posture[1])))
        grasps = [(i, free.solver.points[p], free.solver.normals[p]) for i, p in ((0, a), (1, b))]
        near += bool(
            contacts(free.robot, free.grasp_map.boxes, here, graph.settings.clearance, grasps)
        )
        overlap += bool(judge.penetrations(here, [(0, a), (1, b)]))
    return {
        "free": count, "free_penetrating": touching, "free_least_distance": min(least),
        "left_out": len(left_out), "left_out_nearer_than_clearance": near,
        "left_out_penetrating": overlap,
    }  # fmt: skip


def one_step(graph: PairGraph, s0: int, s1: int, held: int) -> Plan | None:
    """The plan of a single step, put together as any plan is."""
    entry = int(edge_entry(held, s0, s1, graph.edges)) & 0xFFFF
    stances = [tuple(graph.points[s].tolist()) for s in (s0, s1)]
    postures = join(graph.posture(stances[0]), graph.posture(stances[1]))
    masks = [graph.mask[s].tolist() for s in (s0, s1)]
    masks[0][held] = masks[1][held] = entry
    masks[1][1 - held] = graph.released(stances[1], graph.posture(stances[1]), 1 - held) & 0xFFFF
    parts = assemble(
        graph, [State(stance, tuple(m)) for stance, m in zip(stances, masks, strict=True)], postures
    )
    if parts.beyond is not None:
        return None
    rotations = [Rotation.from_matrix(r).as_quat(scalar_first=True) for r in postures.rotation]
    return Plan(
        stances=tuple(graph.ids(stance) for stance in stances),
        actions=((1 - held, parts.steps[0].to_point),),
        steps=parts.steps, base_positions=postures.position, base_quaternions=np.array(rotations),
        joint_positions=parts.joints, branches=parts.branches, w_m=parts.w_m, w_b=parts.w_b,
        goal=(0.0, 0.0, 0.0),
        goal_tolerance=0.0, cost_name="base", cost=0.0, regrasp_price=None, method="astar",
        heuristic="zero", expanded=0,
        generated=0, feasibility_time=0.0, search_time=0.0, map_name="", map_fingerprint="",
        robot=graph.robot,
        settings=graph.settings,
    )  # fmt: skip


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
    """A step between two stances of the graph, limb that holds first, possible when collisions are not looked at."""
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
    hindered: int,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Random free steps, and random blocked ones, for which a way is looked for by other means."""
    looked = bad = done = 0
    kinds: Counter[str] = Counter()
    blocked: list[tuple[int, int, int]] = []
    drawn = possible = 0
    bar = tqdm(total=count, desc="free steps", mininterval=2.0)
    while done < count or len(blocked) < hindered:
        held, s0, s1 = random_step(graph, free, rng)
        drawn += 1
        if not int(edge_entry(held, s0, s1, graph.edges)) & 0xFFFF:
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
        for step in tqdm(blocked[:hindered], desc="blocked steps", mininterval=2.0)
    )
    return {
        "free": done, "configurations": looked, "penetrating": bad, "swings": dict(kinds),
        "share_blocked": 1 - possible / drawn,
        "blocked": hindered, "blocked_because": dict(causes),
    }  # fmt: skip


DIRECT, SAMPLED, DEPARTURE = (
    "a direct swing exists",
    "a sampled swing exists",
    "no limb can depart or approach",
)
NO_SWING, HOLD = "no swing found", "the limb that holds or the body"
"""What keeps a step out of the graph."""


def why_blocked(graph: PairGraph, held: int, s0: int, s1: int) -> str:
    """What keeps a step out of the graph, looked for without what the graph takes for granted.

    Each branch of the limb that holds is looked at on its own, all branches of the limb that moves,
    lines between all of them, and then, by a sampling planner in base parameter and joint angles
    together, ways between the nearest.
    """
    stances = [tuple(graph.points[s].tolist()) for s in (s0, s1)]
    static = graph.postures(np.array(stances))
    mover, point = 1 - held, stances[0][held]
    pivot = graph.solver.points[point]
    answers, chances = {HOLD}, []
    for kind in (0, 1):
        mask = graph.hold(
            kind, pivot, point, held, static, int(static.mask[0, held] & static.mask[1, held])
        )
        path = (
            static.position[0],
            static.rotation[0],
            static.position[1],
            static.rotation[1],
            kind,
            pivot,
        )
        for bit in range(8):
            if not mask & 0x0101 << bit or not _holds(graph, held, point, bit, path):
                continue
            finder = SwingFinder(graph, mover, path, [Hold(held, point, bit)])
            ends = [
                _departures(
                    graph,
                    stances[k],
                    static.position[k],
                    static.rotation[k],
                    mover,
                    static.mask[k],
                    bit,
                )
                for k in (0, 1)
            ]
            if not ends[0] or not ends[1]:
                answers.add(DEPARTURE)
                continue
            answers.add(NO_SWING)
            for start in ends[0]:
                for end in ends[1]:
                    last = np.empty(6)
                    length = line_end(start, end, graph.solver.limits, last)
                    if np.isfinite(length):
                        if finder.clear(np.array([[0.0, *start], [1.0, *last]])):
                            return DIRECT
                        chances.append((length, len(chances), finder, start, last))
    for _, _, finder, start, last in sorted(chances, key=lambda chance: chance[:2])[:SAMPLED_PAIRS]:
        knots = sampled_line(
            finder.clear,
            finder.graph.robot.limb.limits,
            np.array([0.0, *start]),
            np.array([1.0, *last]),
        )
        if knots is not None and finder.clear(knots):
            return SAMPLED
    return next(answer for answer in (NO_SWING, DEPARTURE, HOLD) if answer in answers)


def _departures(
    graph: PairGraph, stance: tuple[int, ...], position: NDArray[np.float64],
    rotation: NDArray[np.float64], limb: int,
    masks: NDArray[np.int64], branch: int,
) -> list[NDArray[np.float64]]:  # fmt: skip
    """Angles above its point on each branch on which a limb can depart, while the other holds on `branch`."""
    solver, robot, other = graph.solver, graph.robot, 1 - limb
    point, grasp = stance[limb], stance[other]
    shapes, gripper, _, fixed, world, clearance, _ = solver.collision_model.arrays
    mounts = (solver.mount_rotations, solver.mount_positions, solver.lengths)
    placed = np.empty((1, len(shapes[0]), 2, 3))
    place_branches(
        other, 1 << branch, solver.points[grasp], solver.normals[grasp], robot.tool_length,
        position, rotation, *mounts, shapes,
        0, placed,
    )  # fmt: skip
    p, x, z, away, q = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((8, 6))
    flange_at(
        solver.points[point], solver.normals[point], solver.rails[point], robot.tool_length,
        position, rotation,
        solver.mount_rotations[limb], solver.mount_positions[limb], p, x, z, away,
    )  # fmt: skip
    there = lifted_branches(
        limb, int(masks[limb]), p, x, z, away, robot.lift, solver.lengths, solver.limits, q
    )
    free = []
    for b in range(8):
        if there & 0x0101 << b:
            found = departure_free(
                limb, p, x, z, away, robot.lift, solver.lengths, b, solver.mount_rotations[limb],
                solver.mount_positions[limb], position, rotation, placed, shapes, gripper, fixed,
                world, solver.points[point],
                solver.normals[point], clearance, True,
            )  # fmt: skip
            if found == CLEAR:
                free.append(q[b])
    return free


def _holds(graph: PairGraph, held: int, point: int, branch: int, path: tuple[Any, ...]) -> bool:
    """Whether a limb can hold along a path if the other were not there: dense samples, judged pair by pair."""
    from mlivr_gym.kinematics.base_path import STRAIGHT, follow
    from mlivr_gym.kinematics.holding import base_path, quaternion

    solver = graph.solver
    where, turned = base_path(*path, np.linspace(0.0, 1.0, 25))
    q = np.full(6, np.nan)
    for position, rotation in zip(where, turned, strict=True):
        if not follow(
            graph.solver.flanges[point], solver.tools[point], position, rotation, position,
            rotation, STRAIGHT, position,
            solver.mount_rotations[held], solver.mount_positions[held], solver.lengths, branch, 0,
            np.empty(6), q,
            np.full(6, np.inf), np.full(6, -np.inf),
        ):  # fmt: skip
            return False
        joints = np.zeros((2, 6))
        joints[held] = q
        grasps = [(held, solver.points[point], solver.normals[point])]
        here = (position, quaternion(rotation), joints)
        for contact in contacts(
            graph.robot, graph.grasp_map.boxes, here, graph.settings.clearance, grasps
        ):
            names = f"{contact.first} {contact.second}"
            if f"limb{held}" in names and f"limb{1 - held}" not in names:
                return False
    return True


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
        "plans": count, "outcomes": dict(reasons), "steps": steps, "configurations": looked,
        "penetrating": bad,
        "swings": dict(kinds), "pairs": pairs[:20],
    }  # fmt: skip


def markdown(data: dict[str, Any]) -> str:
    """The figures as Markdown."""
    s, t, p = data["stances"], data["steps"], data["plans"]
    because = ", ".join(f"{name} {count}" for name, count in sorted(t["blocked_because"].items()))
    lost = sum(t["blocked_because"].get(name, 0) for name in (DIRECT, SAMPLED)) / t["blocked"]
    rows = "\n".join(
        f"| {row.first} | {row.second} | {row.whose} | {row.reason} |" for row in NOT_COMPARED
    )
    return f"""# Collision checks against MuJoCo and coal

Made by `experiments/collision_truth.py`. The MuJoCo scene holds the shapes that the planner checks. Clearance {data["clearance"]:g} m.

| what | looked at | penetrating by MuJoCo |
|---|---|---|
| random stances called free, on random branches of those allowed | {s["free"]} | {s["free_penetrating"]} |
| random steps called free, sampled | {t["free"]} ({t["configurations"]} configurations) | {t["penetrating"]} |
| random plans, sampled | {p["plans"]} ({p["steps"]} steps, {p["configurations"]} configurations) | {p["penetrating"]} |

Least distance of limbs, body and mounts to boxes and of limbs to each other over the free stances by coal:
{1000 * s["free_least_distance"]:.2f} mm.

**What is called blocked.** {s["left_out"]} stances meet the thresholds but are left out; the best posture of
{s["left_out_nearer_than_clearance"]} of them lies nearer than the clearance to something, that of {s["left_out_penetrating"]}
penetrates by MuJoCo's judgement. Of steps between free stances that are possible without collisions, {100 * t["share_blocked"]:.1f} % are
called blocked. Of {t["blocked"]} of these, looked at branch by branch and with a sampling planner in base parameter and joint
angles: {because}. So {100 * lost:.1f} % of the steps called blocked could be made; they are
{100 * lost * t["share_blocked"]:.1f} % of the possible ones.

Swings of the plans: {", ".join(f"{name} {count}" for name, count in sorted(p["swings"].items()))}. Outcomes:
{", ".join(f"{name} {count}" for name, count in sorted(p["outcomes"].items()))}.

**What is not compared** (`mlivr_gym/uncompared.py`); everything else is.

| shape | with | of | because |
|---|---|---|---|
{rows}
"""


def main() -> None:
    """Run the studies and write the results."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--stances", type=int, default=2000, help="random free stances")
    parser.add_argument("--steps", type=int, default=300, help="random free steps")
    parser.add_argument("--blocked", type=int, default=150, help="random blocked steps")
    parser.add_argument("--plans", type=int, default=200, help="random plans")
    parser.add_argument("--out", type=Path, default=Path("results"), help="folder for the results")
    args = parser.parse_args()
    graph, free = (
        stance_graph(jem_map()),
        stance_graph(jem_map(), settings=Settings(collisions=False)),
    )
    assert isinstance(graph, PairGraph)
    assert isinstance(free, PairGraph)
    judge, rng = Judge(graph), np.random.default_rng(2026)
    data = {
        "clearance": graph.settings.clearance,
        "stances": study_stances(graph, free, judge, args.stances, rng),
        "steps": study_steps(graph, free, judge, args.steps, args.blocked, rng),
        "plans": study_plans(graph, judge, args.plans, rng),
    }
    args.out.mkdir(parents=True, exist_ok=True)
    write_whole(args.out / "collision_truth.json", json.dumps(data, indent=1) + "\n")
    write_whole(args.out / "collision_truth.md", markdown(data))
    print(markdown(data))


if __name__ == "__main__":
    main()
