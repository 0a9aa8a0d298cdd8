"""Measure collision checks and replanning; part of `benchmark_planning.py`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import mujoco
import numpy as np
from numba import njit
from reports import spread, timed
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, State
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.against_boxes import (
    GraspSurface,
    compare_base_with_boxes,
    compare_limb_with_boxes,
)
from mlivr_gym.collisions.against_robot import (
    compare_limb_with_body,
    compare_limb_with_itself,
    compare_limbs,
)
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.placement import Placed, place_by_angles, place_in_world
from mlivr_gym.compiled.bit_sets import EVERY
from mlivr_gym.kinematics.path_following import poses
from mlivr_gym.planners import Planner, PlanningResult
from mlivr_gym.simulation.scene import scene_spec
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph


@njit(nogil=True, error_model="numpy")
def check_all(
    bases: Any,
    joints: Array,
    robots: Any,
    grid: BoxGrid,
    clearance: float,
    scratch_rows: tuple[Any, Any],
    out: IntArray,
) -> None:
    """Write the kind of contact of each configuration of a two-limb robot to `out`, 0 if none.

    `bases` holds records of `Pose`, shape (k,); `joints` has shape (k, 2, 6) [rad]; `robots` is a
    record of `Robot`, shape (1,). `scratch_rows` holds zeroed records of `Placed`, shape (2,), and
    of `GraspSurface`, shape (1,). Grippers are compared with all boxes; distances below `clearance`
    [m] count as contact.
    """
    robot, placed, nothing = robots[0], scratch_rows[0], scratch_rows[1][0]
    for k in range(len(bases)):
        base = bases[k]
        found = compare_base_with_boxes(robot, base, (0.0, 0.0), grid, clearance, nothing)
        for i in range(2):
            limb, here = robot.limbs[i], placed[i]
            for joint in range(6):
                here.q[joint] = joints[k, i, joint]
            place_by_angles(limb, here)
            place_in_world(limb, base, here.in_body, here.in_world)
            found = max(
                found,
                compare_limb_with_itself(limb, here.in_body, here, EVERY, clearance)[0],
                compare_limb_with_body(robot, limb, here.in_body, EVERY, clearance)[0],
                compare_limb_with_boxes(limb, here.in_world, EVERY, grid, clearance, nothing)[0],
            )
        first, second = placed[0].in_body, placed[1].in_body
        limbs = robot.limbs[0], robot.limbs[1]
        found = max(found, compare_limbs(limbs[0], first, limbs[1], second, EVERY, clearance)[0])
        out[k] = found


def configurations(graph: TwoLimbGraph, count: int) -> tuple[Array, Array, Array]:
    """Return base positions, rotations and joint angles of random stances with perturbed joints.

    The shapes are (count, 3) [m], (count, 3, 3) and (count, 2, 6) [rad].
    """
    rng = np.random.default_rng(0)
    chosen = rng.integers(len(graph), size=count)
    joints = np.empty((count, 2, 6))
    for k, s in enumerate(chosen):
        a, b = graph.points[s].tolist()
        branch_sets = tuple(1 << int(branch) for branch in graph.branch[s])
        joints[k] = graph.configuration(State((a, b), branch_sets))[2]
    joints += rng.normal(0.0, 0.1, joints.shape)
    return graph.base_position[chosen], graph.base_rotation[chosen], joints


def single_checks(graph: TwoLimbGraph, count: int) -> dict[str, float]:
    """Return time per configuration [us] in the kernel on one thread, and in MuJoCo's pipeline."""
    positions, rotations, joints = configurations(graph, count)
    robot, solver = graph.robot, graph.solver
    out = np.empty(count, dtype=np.int64)
    clearance, scratch_rows = graph.settings.clearance, (Placed.rows(2), GraspSurface.rows(1))
    bases, robots = poses(positions, rotations), solver.shapes.rows
    given = (bases, joints, robots, solver.boxes, clearance, scratch_rows, out)
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
    return {
        "configurations": count,
        "ours": 1e6 * ours / count,
        "mujoco": 1e6 * mujoco_time / count,
        "touching": float((out > 0).mean()),
    }


def changes(
    planner: Planner, start: tuple[str, ...], goal: Array, kind: str, count: int
) -> Iterator[tuple[list[str], list[Box]]]:
    """Yield points that become occupied, five of them on the plan, or a box in its way."""
    rng = np.random.default_rng(0)
    free, ids = planner.plan(start, goal).unwrap(), planner.graph.grasp_map.ids
    used = sorted({point for stance in free.stances for point in stance} - set(start))
    others = [point for point in ids if point not in used and point not in start]
    for _ in range(count):
        if kind == "points":
            few = rng.choice(used, min(5, len(used)), replace=False).tolist()
            yield [*few, *rng.choice(others, 10 - len(few), replace=False).tolist()], []
        else:
            middle = 0.5 * (free.motion.base_positions[0, 0] + goal[0])
            x, z = middle + rng.uniform(-0.6, 0.6), rng.choice([-1.0, 0.2])
            yield [], [Box.between("box", "obstacle", (x, -1.0, z), (x + 0.3, 1.0, z + 0.8))]


def replanning(planner: Planner, start: tuple[str, ...], goal: Array, count: int) -> dict[str, Any]:
    """Return the time from ten newly occupied points, or a new box, to the new plan [ms]."""
    graph, out = planner.graph, {}

    def replan(taken: list[str], boxes: list[Box]) -> PlanningResult:
        if taken:
            graph.occupy(taken)
        graph.add_obstacles(boxes)
        return planner.plan(start, goal)

    for kind in ("points", "box"):
        times, unsolved = [], 0
        for change in changes(planner, start, goal, kind, count):
            seconds, result = timed(partial(replan, *change))
            times.append(seconds)
            unsolved += result.plan is None
            graph.vacate()
            graph.remove_obstacles()
        out[kind] = spread(times) | {"unsolved": unsolved}
    return out
