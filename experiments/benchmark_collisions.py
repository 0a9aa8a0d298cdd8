"""How long collision checks and replanning take; part of `benchmark_planning.py`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import coal
import mujoco
import numpy as np
from collision_judge import capsule, solid
from numba import njit
from reports import pair_graph, table
from scipy.spatial.transform import Rotation
from stopwatch import timed

from mlivr_gym import Box, GraspMap, Settings, State, stance_graph
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.against_boxes import Behind, against_boxes, base_against_boxes
from mlivr_gym.collisions.against_robot import against_body, against_itself, against_limb
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.contacts import Configuration, capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.placing import Placed, place_by_angles, to_world
from mlivr_gym.compiled.bit_sets import EVERY
from mlivr_gym.kinematics.path_following import poses
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.scene import scene_spec
from mlivr_gym.stances.pair_graph import PairGraph


@njit(nogil=True, error_model="numpy")
def check_all(
    bases: Any,
    joints: Array,
    robots: Any,
    grid: BoxGrid,
    clearance: float,
    rooms: tuple[Any, Any],
    out: IntArray,
) -> None:
    """Whether each of many configurations of a two-limb robot touches something.

    Grippers are compared with all boxes.

    Args:
        bases: Bases in the world, rows of `Pose`, shape (k,).
        joints: Joint angles, shape (k, 2, 6) [rad].
        robots: A row of `Robot`, shape (1,).
        grid: The boxes.
        clearance: Least distance [m].
        rooms: Rows of `Placed`, shape (2,), and of `Behind`, shape (1,), of zeros.
        out: Filled with the kind of contact of each, 0 where there is none, shape (k,).
    """
    robot, placed, nothing = robots[0], rooms[0], rooms[1][0]
    for k in range(len(bases)):
        base = bases[k]
        found = base_against_boxes(robot, base, (0.0, 0.0), grid, clearance, nothing)
        for i in range(2):
            limb, here = robot.limbs[i], placed[i]
            for joint in range(6):
                here.q[joint] = joints[k, i, joint]
            place_by_angles(limb, here)
            to_world(limb, base, here.in_body, here.in_world)
            found = max(
                found,
                against_itself(limb, here.in_body, here, EVERY, clearance)[0],
                against_body(robot, limb, here.in_body, EVERY, clearance)[0],
                against_boxes(limb, here.in_world, EVERY, grid, clearance, nothing)[0],
            )
        first, second = placed[0].in_body, placed[1].in_body
        limbs = robot.limbs[0], robot.limbs[1]
        found = max(found, against_limb(limbs[0], first, limbs[1], second, EVERY, clearance)[0])
        out[k] = found


def configurations(graph: PairGraph, count: int) -> list[Configuration]:
    """Random stances with every joint turned a little."""
    rng, out = np.random.default_rng(0), []
    for s in rng.integers(len(graph), size=count):
        a, b = graph.points[s].tolist()
        state = State((a, b), tuple(1 << int(branch) for branch in graph.branch[s]))
        position, quaternion, joints = graph.configuration(state)
        out.append((position, quaternion, joints + rng.normal(0.0, 0.1, joints.shape)))
    return out


def single_checks(graph: PairGraph, count: int) -> dict[str, float]:
    """Time of one configuration in the compiled kernel, in MuJoCo and in coal [us].

    The kernel runs in one thread; MuJoCo's figure is that of kinematics and collision pipeline.
    """
    rows = configurations(graph, count)
    positions, quaternions, joints = (np.array(part) for part in zip(*rows, strict=True))
    rotations = Rotation.from_quat(quaternions, scalar_first=True).as_matrix()
    solver, out = graph.solver, np.empty(count, dtype=np.int64)
    bases, rooms = poses(positions, rotations), (Placed.rows(2), Behind.rows(1))
    clearance = graph.settings.clearance
    given = (bases, joints, solver.shapes.rows, solver.boxes, clearance, rooms, out)
    check_all(*given)
    ours = timed(lambda: check_all(*given))[0]
    model = scene_spec(graph.grasp_map, graph.robot).compile()
    data = mujoco.MjData(model)
    # Joints follow the free joint limb by limb.
    whole = np.concatenate([positions, quaternions, joints.reshape(count, 12)], axis=1)

    def theirs() -> None:
        for row in whole:
            data.qpos[:] = row
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)

    few = rows[:1000]
    return {
        "configurations": count,
        "ours": 1e6 * ours / count,
        "mujoco": 1e6 * timed(theirs)[0] / count,
        "coal": 1e6 * coal_seconds(graph, few) / len(few),
        "touching": float((out > 0).mean()),
    }


def coal_seconds(graph: PairGraph, rows: Sequence[Configuration]) -> float:
    """Time that coal needs for the collision checks of configurations of two limbs [s].

    The boxes are in a tree made once; each limb's capsules are compared with it and with those of
    the other limb. Poses of the capsules are worked out beforehand.
    """
    shapes = LimbShapes(graph.robot)
    placed = [
        [
            [capsule(*axis) for axis in zip(limb, shapes.radii, strict=True)]
            for limb in capsule_ends(graph.robot, shapes, row)
        ]
        for row in rows
    ]
    cabin, limbs = _tree([solid(box) for box in graph.grasp_map.boxes]), placed[0]
    trees, callback = [_tree(limb) for limb in limbs], coal.CollisionCallBackDefault()
    ahead = [[[one.getTransform() for one in limb] for limb in there] for there in placed]
    began = time.perf_counter()
    for there in ahead:
        for tree, limb, places in zip(trees, limbs, there, strict=True):
            for one, place in zip(limb, places, strict=True):
                one.setTransform(place)
                one.computeAABB()
            tree.update()
            callback.init()
            tree.collide(cabin, callback)
        callback.init()
        trees[0].collide(trees[1], callback)
    return time.perf_counter() - began


def _tree(objects: Sequence[Any]) -> Any:
    """A tree of collision objects; the objects must live as long as the tree."""
    tree = coal.DynamicAABBTreeCollisionManager()
    for thing in objects:
        tree.registerObject(thing)
    tree.setup()
    return tree


def collisions(
    grasp_map: GraspMap,
    start: tuple[str, ...],
    goal: Array,
    repeats: int,
    progress: Callable[[str], None],
) -> dict[str, Any]:
    """All figures of this part, as data for `collision_report`."""
    progress("collisions: stance set")
    sets: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(repeats):
        for flag, times in sets.items():
            settings = Settings(collisions=flag)
            times.append(timed(partial(stance_graph, grasp_map, settings=settings))[0])
    first = []
    for _ in range(repeats):
        first.append(timed(lambda: Planner(stance_graph(grasp_map)).plan(start, goal).unwrap())[0])
    graph = pair_graph(grasp_map)
    progress("collisions: single checks")
    single = single_checks(graph, 200 * repeats)
    progress("collisions: replanning, nothing prepared")
    planner = Planner(graph)
    cold = replanning(planner, start, goal, 4 * repeats)
    progress("collisions: replanning, goal prepared")
    prepared = timed(lambda: planner.prepare(goal))[0]
    warm = replanning(planner, start, goal, 8 * repeats)
    return {
        "stance_set": float(np.median(sets[True])),
        "stance_set_without": float(np.median(sets[False])),
        "stances": len(graph),
        "removed": graph.removed,
        "first_plan": float(np.median(first)),
        "single": single,
        "cold": cold,
        "prepare": prepared,
        "warm": warm,
    }


def replanning(planner: Planner, start: tuple[str, ...], goal: Array, count: int) -> dict[str, Any]:
    """Time from a change to the new plan [ms].

    The change is ten points newly occupied, or a box across the module.
    """
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
                middle = 0.5 * (free.motion.base_positions[0, 0] + goal[0])
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
            "median": float(np.median(times)),
            "p95": float(np.percentile(times, 95)),
            "count": count,
            "unsolved": unsolved,
        }
    return out


def collision_targets(data: dict[str, Any]) -> Iterator[tuple[str, float, float]]:
    """Name, bound and measured value of each target of this part."""
    ratio, warm = data["stance_set"] / data["stance_set_without"], data["warm"]
    yield "stance set with collisions, times that without", 3.0, ratio
    yield "check of one configuration, batched [us]", 5.0, data["single"]["ours"]
    yield "map to first plan, collisions checked, steps checked lazily [s]", 1.0, data["first_plan"]
    for change, bound, kind in (
        ("ten points newly occupied", 5.0, "points"),
        ("a box across the module", 100.0, "box"),
    ):
        name = f"replan to a prepared goal, {change}, median [ms]"
        yield name, bound, warm[kind]["median"]


HEAD = "goal prepared | change | median [ms] | p95 [ms] | changes | without a plan"


def collision_report(data: dict[str, Any]) -> list[str]:
    """The report's section as lines of Markdown."""
    single = data["single"]
    rows = [
        [title, name, f"{run['median']:.1f}", f"{run['p95']:.1f}", run["count"], run["unsolved"]]
        for title, part in (("no", data["cold"]), ("yes", data["warm"]))
        for name, run in part.items()
    ]
    return f"""## Collisions

Stance set with collisions {data["stance_set"]:.2f} s, without \
{data["stance_set_without"]:.2f} s; {data["stances"]} stances are left. Map to first plan \
{data["first_plan"]:.2f} s. One configuration, both limbs against the cabin, the body, themselves \
and each other: {single["ours"]:.2f} us in the compiled kernel on one core, \
{single["mujoco"]:.1f} us in MuJoCo (kinematics and collision pipeline, called from Python), \
{single["coal"]:.1f} us in coal (trees of boxes and capsules, called from Python, poses worked out \
beforehand), over the same {single["configurations"]} configurations (coal: the first 1000 at \
most), {100 * single["touching"]:.0f} % of which touch something.

Replanning from the change to the new plan, from the start of a walk, base cost. \
`Planner.prepare` works out the exact cost to the goal once, in {data["prepare"]:.1f} s here, and \
replans without it start from what earlier plans found out:

{table(HEAD, rows)}""".split("\n")
