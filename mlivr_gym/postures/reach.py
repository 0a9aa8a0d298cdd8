"""Reach and manipulability of the limbs at base poses, without joint angles (compiled)."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.compiled.bit_sets import CLASSES
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.kinematics.chain import FlangeAxis
from mlivr_gym.kinematics.inverse import branch_sizes
from mlivr_gym.kinematics.limb import flange_seen
from mlivr_gym.kinematics.manipulability import inverse_root_determinant, limb_information
from mlivr_gym.kinematics.poses import length, minus, vector
from mlivr_gym.postures.base_poses import place, pose_count, set_pose, set_stance
from mlivr_gym.postures.records import CandidatePose, PostureWorld, StanceGeometry
from mlivr_gym.robot.specification import RobotSpec


@kernel
def evaluate_reach(
    robot: RobotModel,
    geometry: StanceGeometry,
    floor: float,
    candidate: CandidatePose,
    sizes: Array,
) -> float:
    """Compute flange poses and `w_m` of the branch classes of each limb at a base pose.

    The results are stored in `candidate.limbs`. Returned is the minimum over the limbs of the `w_m`
    of their best class; 0 as soon as one is below `floor`. `sizes` is scratch, shape (4,).
    """
    least = np.inf
    for i in range(robot.limb_count):
        limb, limb_reach = robot.limbs[i], candidate.limbs[i]
        seen, _ = flange_seen(limb, candidate.base, geometry.grasps[i].flange)
        branch_sizes(limb.arm, seen, sizes)
        best = 0.0
        for k in range(3):
            limb_reach.p[k], limb_reach.z[k] = seen.p[k], seen.z[k]
        for c in range(CLASSES):
            limb_reach.w[c] = sizes[c] / robot.characteristic_length**3
            best = max(best, limb_reach.w[c])
        if best < floor:
            return 0.0
        least = min(least, best)
    return least


@entry
def reach_all(robots: Any, geometry: Any, candidates: Any, scratch_rows: Any) -> None:
    """Evaluate the reach of K stances, records of `StanceGeometry`, each at one base pose.

    `candidates` are records of `CandidatePose` with the base poses, shape (K,); the results are
    filled.
    """
    for k in range(len(geometry)):
        candidates[k].margin_bound = evaluate_reach(
            robots[0], geometry[k], 0.0, candidates[k], scratch_rows[0].sizes
        )


@entry
def base_along(
    robots: Any, candidates: Any, branches: IntArray, scratch_rows: Any, w_b: Array
) -> None:
    """Compute `w_b` of K stances on given branches, shape (K, N), after `reach_all`."""
    robot, scratch = robots[0], scratch_rows[0]
    information, total = scratch.information[0, 0], scratch.sums[0, 0]
    for k in range(len(candidates)):
        for i in range(robot.limb_count):
            limb, reach = robot.limbs[i], candidates[k].limbs[i]
            flange, l_c = FlangeAxis(vector(reach.p), vector(reach.z)), robot.characteristic_length
            limb_information(limb, flange, branches[k, i], l_c, scratch.inversion, information)
            for row in range(6):
                for col in range(6):
                    total[row, col] = information[row, col] + (total[row, col] if i else 0.0)
        w_b[k] = inverse_root_determinant(scratch.sums[0])


def orders_of(robot: RobotSpec) -> IntArray:
    """Return the orders in which the limbs may hold N points, shape (k, N).

    Of limbs that are alike, orders that differ only in their first point count once.
    """
    every = permutations(range(robot.limbs))
    return np.array([one for one in every if not (robot.is_symmetric and one[0])], dtype=np.int64)


@entry
def sets_in_reach(
    start: int,
    stop: int,
    stances: IntArray,
    orders: IntArray,
    world: PostureWorld,
    region: Array,
    out: BoolArray,
    scratch_rows: Any,
) -> None:
    """Write whether sets of points may be held in some order from some candidate base pose.

    That is, every limb reaches its point there with the threshold of `w_m`, and the base is in a
    `region`, the ball of a position and a radius, shape (4,) [m]. Every node holds such a set,
    whatever its surroundings. `stances` are the sets, shape (k, N), each in the first of `orders`;
    `out`, shape (k,), is filled from `start` to `stop`.
    """
    robot, rule, scratch = world.robots[0], world.rules[0], scratch_rows[0]
    geometry, candidate, stance = scratch.geometry, scratch.candidate, scratch.combination
    count, floor = stances.shape[1], rule.node_margin * rule.scale_m
    for s in range(start, stop):
        out[s] = False
        for order in range(len(orders)):
            for i in range(count):
                stance[i] = stances[s, orders[order, i]]
            set_stance(world.points, rule, stance[:count], geometry)
            for number in range(pose_count(geometry, rule)):
                set_pose(geometry, rule, number, candidate.base)
                place(geometry, candidate.base, scratch.base)
                away = length(minus(vector(scratch.base.position), vector(region)))
                if (
                    away <= region[3]
                    and evaluate_reach(robot, geometry, floor, candidate, scratch.sizes) > 0.0
                ):
                    out[s] = True
                    break
            if out[s]:
                break
