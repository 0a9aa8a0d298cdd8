"""How long collision checks and replanning among obstacles take; part of `benchmark_planning.py`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import coal
import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, GraspMap, Settings, State, stance_graph
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.link_capsules import (
    EVERY,
    against_body,
    against_boxes,
    against_limb,
    body_against_boxes,
    frames_of_angles,
    place,
    to_world,
)
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.scene import scene_spec
from mlivr_gym.stances.pair_graph import PairGraph

Array = NDArray[np.float64]


@njit(nogil=True, error_model="numpy")
def check_all(
    positions: Array,
    rotations: Array,
    joints: Array,
    lengths: Array,
    mounts: Array,
    places: Array,
    collision_model: Any,
    out: Any,
) -> None:
    """Whether each of many configurations of a two-limb robot touches something; grippers are compared with all boxes."""
    shapes, _, _, fixed, world, clearance, body = collision_model
    count = len(shapes[0])
    ends, moved, still = np.empty((2, count, 2, 3)), np.empty((count, 2, 3)), np.zeros((count, 2))
    frames, shift, spin = np.empty((7, 4, 3)), np.zeros((5, 4)), np.zeros((5, 7))
    for k in range(len(positions)):
        found = body_against_boxes(positions[k], rotations[k], 0.0, 0.0, body, world, clearance)
        for i in range(2):
            frames_of_angles(joints[k, i], lengths, frames)
            place(frames, shapes, mounts[i], places[i], ends[i])
            found = max(
                found,
                against_body(i, ends[i], still, EVERY, shift, spin, 0.0, shapes, fixed, clearance)[
                    0
                ],
            )
            to_world(ends[i], positions[k], rotations[k], moved)
            found = max(
                found,
                against_boxes(
                    moved,
                    still,
                    EVERY,
                    count,
                    shapes[2],
                    world,
                    count,
                    positions[k],
                    positions[k],
                    clearance,
                )[0],
            )
        out[k] = max(
            found, against_limb(ends[0], still, EVERY, ends[1], still, shapes, clearance)[0]
        )


def configurations(graph: PairGraph, count: int) -> tuple[Array, Array, Array]:
    """Base positions, rotations and joint angles: random stances with every joint turned a little."""
    rng = np.random.default_rng(0)
    chosen = rng.integers(len(graph), size=count)
    joints = np.empty((count, 2, 6))
    for k, s in enumerate(chosen):
        a, b = graph.points[s].tolist()
        masks = tuple(1 << int(branch) for branch in graph.branch[s])
        joints[k] = graph.configuration(State((a, b), masks))[2]
    return (
        graph.position[chosen],
        graph.rotation[chosen],
        joints + rng.normal(0.0, 0.1, joints.shape),
    )


def single_checks(graph: PairGraph, count: int) -> dict[str, float]:
    """Microseconds a configuration: the compiled kernel in one thread, MuJoCo's pipeline, coal's broad phase."""
    positions, rotations, joints = configurations(graph, count)
    robot, solver = graph.robot, graph.solver
    out = np.empty(count, dtype=np.int64)
    given = (
        positions,
        rotations,
        joints,
        solver.lengths,
        solver.mount_rotations,
        solver.mount_positions,
    )
    check_all(*given, solver.collision_model.arrays, out)
    began = time.perf_counter()
    check_all(*given, solver.collision_model.arrays, out)
    ours = time.perf_counter() - began
    model = scene_spec(graph.grasp_map, robot).compile()
    data = mujoco.MjData(model)
    quaternions = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
    # Joints follow the free joint limb by limb.
    rows = np.concatenate([positions, quaternions, joints.reshape(count, 12)], axis=1)
    began = time.perf_counter()
    for row in rows:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
    mujoco_time = time.perf_counter() - began
    few = min(count, 1000)
    theirs = _coal(graph, positions[:few], quaternions[:few], joints[:few])
    return {
        "configurations": count, "ours": 1e6 * ours / count, "mujoco": 1e6 * mujoco_time / count,
        "coal": 1e6 * theirs / few, "touching": float((out > 0).mean()),
    }  # fmt: skip


def _coal(graph: PairGraph, positions: Array, quaternions: Array, joints: Array) -> float:
    """Seconds that coal needs: boxes in a tree made once, each limb's capsules against it and against the other limb's."""
    shapes = LimbShapes(graph.robot)
    radius = shapes.arrays[2]
    cabin = coal.DynamicAABBTreeCollisionManager()
    solids = [
        coal.CollisionObject(coal.Box(*(2.0 * np.array(b.half))), coal.Transform3s(np.array(b.rotation), np.array(b.centre)))
        for b in graph.grasp_map.boxes
    ]  # fmt: skip
    cabin.registerObjects(solids)
    cabin.setup()
    limbs = [[] for _ in range(2)]
    for i in range(2):
        for c in range(len(shapes)):
            length = float(np.linalg.norm(shapes.arrays[1][c, 1] - shapes.arrays[1][c, 0]))
            limbs[i].append(coal.CollisionObject(coal.Capsule(float(radius[c]), max(length, 1e-6))))
    managers = []
    for i in range(2):
        manager = coal.DynamicAABBTreeCollisionManager()
        manager.registerObjects(limbs[i])
        managers.append(manager)
    placed = []
    for k in range(len(positions)):
        ends = capsule_ends(graph.robot, shapes, (positions[k], quaternions[k], joints[k]))
        middle, along = ends.mean(axis=2), ends[:, :, 1] - ends[:, :, 0]
        turned = np.empty((2, len(shapes), 3, 3))
        for i in range(2):
            for c in range(len(shapes)):
                turned[i, c] = _frame(along[i, c])
        placed.append((middle, turned))
    callback = coal.CollisionCallBackDefault()
    began = time.perf_counter()
    for middle, turned in placed:
        for i in range(2):
            for c, thing in enumerate(limbs[i]):
                thing.setTransform(coal.Transform3s(turned[i, c], middle[i, c]))
                thing.computeAABB()
            managers[i].update()
            callback.init()
            managers[i].collide(cabin, callback)
        callback.init()
        managers[0].collide(managers[1], callback)
    return time.perf_counter() - began


def _frame(axis: Array) -> Array:
    """A rotation whose z axis lies along a vector."""
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return np.eye(3)
    z = axis / length
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def collisions(
    grasp_map: GraspMap,
    start: tuple[str, ...],
    goal: Array,
    repeats: int,
    progress: Callable[[str], None],
) -> dict[str, Any]:
    """Everything of this part."""
    progress("collisions: stance set")
    sets: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(repeats):
        for flag, times in sets.items():
            settings = Settings(collisions=flag)
            times.append(_timed(lambda s=settings: stance_graph(grasp_map, settings=s))[0])
    first = []
    for _ in range(repeats):
        first.append(_timed(lambda: Planner(stance_graph(grasp_map)).plan(start, goal).unwrap())[0])
    graph = stance_graph(grasp_map)
    assert isinstance(graph, PairGraph)
    progress("collisions: single checks")
    single = single_checks(graph, 200 * repeats)
    progress("collisions: replanning, nothing prepared")
    planner = Planner(graph)
    cold = replanning(planner, start, goal, 4 * repeats)
    progress("collisions: replanning, goal prepared")
    prepared = _timed(lambda: planner.prepare(goal))[0]
    warm = replanning(planner, start, goal, 8 * repeats)
    return {
        "stance_set": float(np.median(sets[True])),
        "stance_set_without": float(np.median(sets[False])),
        "stances": len(graph), "removed": graph.removed, "first_plan": float(np.median(first)),
        "single": single,
        "cold": cold, "prepare": prepared, "warm": warm,
    }  # fmt: skip


def replanning(planner: Planner, start: tuple[str, ...], goal: Array, count: int) -> dict[str, Any]:
    """Milliseconds from the change to the new plan: ten points newly occupied, and a box across the module."""
    rng, out = np.random.default_rng(0), {}
    graph = planner.graph
    free = planner.plan(start, goal).unwrap()
    used = sorted({point for stance in free.stances for point in stance} - set(start))
    others = [point for point in graph.grasp_map.ids if point not in used and point not in start]
    for kind in ("points", "box"):
        times, unsolved = [], 0
        for _ in range(count):
            boxes, taken = [], []
            if kind == "points":
                few = rng.choice(used, min(5, len(used)), replace=False).tolist()
                taken = [*few, *rng.choice(others, 10 - len(few), replace=False).tolist()]
            else:
                middle = 0.5 * (free.base_positions[0, 0] + goal[0])
                x, z = middle + rng.uniform(-0.6, 0.6), rng.choice([-1.0, 0.2])
                boxes = [Box.between("box", "obstacle", (x, -1.0, z), (x + 0.3, 1.0, z + 0.8))]
            began = time.perf_counter()
            if taken:
                graph.occupy(taken)
            graph.add_obstacles(boxes)
            result = planner.plan(start, goal)
            times.append(1e3 * (time.perf_counter() - began))
            unsolved += result.plan is None
            graph.vacate()
            graph.remove_obstacles()
        out[kind] = {
            "median": float(np.median(times)), "p95": float(np.percentile(times, 95)),
            "count": count, "unsolved": unsolved,
        }  # fmt: skip
    return out


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    began = time.perf_counter()
    value = call()
    return time.perf_counter() - began, value


def collision_targets(data: dict[str, Any]) -> Iterator[tuple[str, float, float]]:
    """Name, bound and measured value of each target of this part."""
    ratio = data["stance_set"] / data["stance_set_without"]
    yield "stance set with collisions, times that without", 3.0, ratio
    yield "check of one configuration, batched [us]", 5.0, data["single"]["ours"]
    yield "map to first plan, collisions checked, steps checked lazily [s]", 1.0, data["first_plan"]
    yield (
        "replan to a prepared goal, ten points newly occupied, median [ms]",
        5.0,
        data["warm"]["points"]["median"],
    )
    yield (
        "replan to a prepared goal, a box across the module, median [ms]",
        100.0,
        data["warm"]["box"]["median"],
    )


def collision_report(data: dict[str, Any]) -> list[str]:
    """The report's section as lines of Markdown."""
    single = data["single"]
    rows = [
        f"| {title} | {name} | {run['median']:.1f} | {run['p95']:.1f} | {run['count']} | {run['unsolved']} |"
        for title, part in (("no", data["cold"]), ("yes", data["warm"]))
        for name, run in part.items()
    ]
    return [
        "## Collisions", "",
        f"Stance set with collisions {data['stance_set']:.2f} s, without {data['stance_set_without']:.2f} s; {data['stances']} "
        f"stances are left. Map to first plan {data['first_plan']:.2f} s. One configuration, both limbs against the cabin, the "
        f"body, themselves and each other: {single['ours']:.2f} us in the compiled kernel on one core, {single['mujoco']:.1f} us in "
        f"MuJoCo (kinematics and collision pipeline, called from Python), {single['coal']:.1f} us in coal (trees of boxes "
        f"and capsules, called from Python, poses worked out beforehand), over the same {single['configurations']} configurations (coal: "
        f"the first 1000 at most), {100 * single['touching']:.0f} % of which touch something.", "",
        "Replanning from the change to the new plan, from the start of a walk, base cost. `Planner.prepare` works out the exact "
        f"cost to the goal once, in {data['prepare']:.1f} s here, and replans without it start from what earlier plans found out:", "",
        "| goal prepared | change | median [ms] | p95 [ms] | changes | without a plan |",
        "|---|---|---|---|---|---|", *rows, "",
    ]  # fmt: skip
