"""Reach and manipulability of the limbs at base poses, without joint angles (compiled)."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.compiled.bit_sets import CLASSES
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.kinematics.inverse import branch_sizes
from mlivr_gym.kinematics.limb import flange_seen
from mlivr_gym.kinematics.poses import Pose, length, minus, vector
from mlivr_gym.postures.base_poses import place, pose_count, set_pose, set_stance
from mlivr_gym.postures.records import PostureWorld, StanceGeometry
from mlivr_gym.robot.specification import RobotSpec


@kernel
def set_reach(
    robot: RobotModel, geometry: StanceGeometry, base: Pose, least: float, w_m: Array
) -> bool:
    """Compute `w_m` of the branch classes of each limb at a base pose, 0 out of reach.

    The base is given in the frame of the stance's grasps; `w_m` has shape (N, 4). Returned is
    whether every limb is in reach with a `w_m` from `least` on; what follows the first that is not
    is not computed.
    """
    for i in range(robot.limb_count):
        limb, best = robot.limbs[i], 0.0
        flange, _ = flange_seen(limb, base, geometry.grasps[i].flange)
        branch_sizes(limb.arm, flange, w_m[i])
        for c in range(CLASSES):
            w_m[i, c] /= robot.characteristic_length**3
            best = max(best, w_m[i, c])
        if best < least or best == 0.0:
            return False
    return True


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
    geometry, base, stance = scratch.geometry, scratch.base, scratch.combination
    count, least = stances.shape[1], rule.node_margin * rule.scale_m
    for s in range(start, stop):
        out[s] = False
        for order in range(len(orders)):
            for i in range(count):
                stance[i] = stances[s, orders[order, i]]
            set_stance(world.points, rule, stance[:count], geometry)
            for number in range(pose_count(geometry, rule)):
                set_pose(geometry, rule, number, base)
                place(geometry, base, scratch.base_in_world)
                away = length(minus(vector(scratch.base_in_world.position), vector(region)))
                if away <= region[3] and set_reach(robot, geometry, base, least, scratch.w_m):
                    out[s] = True
                    break
            if out[s]:
                break
