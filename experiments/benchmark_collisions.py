"""How long collision checks and replanning take; part of `benchmark_planning.py`."""

from __future__ import annotations

import time
from typing import Any

import coal
import mujoco
import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation
from stopwatch import spread

from mlivr_gym import Box, State
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.against_boxes import Behind, against_boxes, base_against_boxes
from mlivr_gym.collisions.against_robot import against_body, against_itself, against_limb
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.contacts import capsule_ends
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


def configurations(graph: PairGraph, count: int) -> tuple[Array, Array, Array]:
    """Random stances with every joint turned a little.

    Returns:
        Base positions, shape (count, 3) [m], base rotations, shape (count, 3, 3), and joint angles,
        shape (count, 2, 6) [rad].
    """
    rng = np.random.default_rng(0)
    chosen = rng.integers(len(graph), size=count)
    joints = np.empty((count, 2, 6))
    for k, s in enumerate(chosen):
        a, b = graph.points[s].tolist()
        masks = tuple(1 << int(branch) for branch in graph.branch[s])
        joints[k] = graph.configuration(State((a, b), masks))[2]
    return (
        graph.base_in_world[chosen],
        graph.base_axes_in_world[chosen],
        joints + rng.normal(0.0, 0.1, joints.shape),
    )


def single_checks(graph: PairGraph, count: int) -> dict[str, float]:
    """Time of one configuration in the compiled kernel, in MuJoCo and in coal [us].

    The kernel runs in one thread; MuJoCo's figure is that of kinematics and collision pipeline.
    """
    positions, rotations, joints = configurations(graph, count)
    robot, solver = graph.robot, graph.solver
    out = np.empty(count, dtype=np.int64)
    clearance, rooms = graph.settings.clearance, (Placed.rows(2), Behind.rows(1))
    bases, robots = poses(positions, rotations), solver.shapes.rows
    given = (bases, joints, robots, solver.boxes, clearance, rooms, out)
    check_all(*given)
    began = time.perf_counter()
    check_all(*given)
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
    theirs = coal_seconds(graph, positions[:few], quaternions[:few], joints[:few])
    return {
        "configurations": count,
        "ours": 1e6 * ours / count,
        "mujoco": 1e6 * mujoco_time / count,
        "coal": 1e6 * theirs / few,
        "touching": float((out > 0).mean()),
    }


def coal_seconds(graph: PairGraph, positions: Array, quaternions: Array, joints: Array) -> float:
    """Time that coal needs for the collision checks of configurations [s].

    The boxes are in a tree made once; each limb's capsules are compared with it and with those of
    the other limb. Poses of the capsules are worked out beforehand.

    Args:
        graph: Graph of a robot with two limbs.
        positions: Base positions, shape (k, 3) [m].
        quaternions: Base orientations w, x, y, z, shape (k, 4).
        joints: Joint angles, shape (k, 2, 6) [rad].
    """
    shapes = LimbShapes(graph.robot)
    boxes = [
        coal.CollisionObject(
            coal.Box(*(2.0 * np.array(box.half))),
            coal.Transform3s(np.array(box.rotation), np.array(box.centre)),
        )
        for box in graph.grasp_map.boxes
    ]
    cabin = _tree(boxes)
    limbs = [_capsules(shapes) for _ in range(2)]
    trees = [_tree(limb) for limb in limbs]
    placed = [
        _capsule_poses(capsule_ends(graph.robot, shapes, configuration))
        for configuration in zip(positions, quaternions, joints, strict=True)
    ]
    callback = coal.CollisionCallBackDefault()
    began = time.perf_counter()
    for middle, turned in placed:
        for i in range(2):
            for c, capsule in enumerate(limbs[i]):
                capsule.setTransform(coal.Transform3s(turned[i, c], middle[i, c]))
                capsule.computeAABB()
            trees[i].update()
            callback.init()
            trees[i].collide(cabin, callback)
        callback.init()
        trees[0].collide(trees[1], callback)
    return time.perf_counter() - began


def _tree(objects: list[Any]) -> Any:
    """A tree of collision objects; the objects must live as long as the tree."""
    tree = coal.DynamicAABBTreeCollisionManager()
    for thing in objects:
        tree.registerObject(thing)
    tree.setup()
    return tree


def _capsules(shapes: LimbShapes) -> list[Any]:
    """The capsules of a limb as collision objects."""
    lengths = np.linalg.norm(shapes.ends[:, 1] - shapes.ends[:, 0], axis=1)
    return [
        coal.CollisionObject(coal.Capsule(float(radius), max(float(length), 1e-6)))
        for radius, length in zip(shapes.radii, lengths, strict=True)
    ]


def _capsule_poses(ends: Array) -> tuple[Array, Array]:
    """Centres, shape (n, c, 3) [m], and rotations, shape (n, c, 3, 3), of capsules.

    Args:
        ends: Ends of the capsules of each limb, shape (n, c, 2, 3) [m].
    """
    axes = ends[:, :, 1] - ends[:, :, 0]
    return ends.mean(axis=2), np.array([[_frame(axis) for axis in limb] for limb in axes])


def _frame(axis: Array) -> Array:
    """A rotation whose z axis lies along a vector."""
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return np.eye(3)
    z = axis / length
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


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
            times.append(time.perf_counter() - began)
            unsolved += result.plan is None
            graph.vacate()
            graph.remove_obstacles()
        out[kind] = spread(times) | {"unsolved": unsolved}
    return out
