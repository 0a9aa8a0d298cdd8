"""Selection of postures among candidates (compiled); see `solver` for what it serves."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.distances import CLEAR, SELF
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.compiled.bit_sets import ALL, CLASSES, NONE, class_of
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.arm import FlangeAxis
from mlivr_gym.kinematics.families import SINGULAR, branch_terms
from mlivr_gym.kinematics.limb import flange_seen
from mlivr_gym.kinematics.manipulability import limb_information
from mlivr_gym.kinematics.poses import Pose, columns, turn, vector
from mlivr_gym.postures.branches import combined, hold_masks
from mlivr_gym.postures.records import (
    CandidatePose,
    HeldStance,
    Posture,
    PostureRule,
    PostureScratch,
    PostureSearch,
)
from mlivr_gym.postures.rule import best_posture, enter, touches_nothing


@kernel
def reach(
    robot: RobotModel, held: HeldStance, floor: float, tried: CandidatePose, scratch: PostureScratch
) -> float:
    """Flange poses and `w_m` of the classes of each limb at a base pose, into `tried.limbs`.

    Returns
    -------
    float
        The least over the limbs of the best class; 0 as soon as that of one is below `floor`.
    """
    least = np.inf
    terms = scratch.holding.proof.terms
    for i in range(robot.limb_count):
        limb, reached = robot.limbs[i], tried.limbs[i]
        unit = limb.arm.links / robot.characteristic_length**3
        seen, _ = flange_seen(limb, tried.base, held.grasps[i].flange)
        branch_terms(limb.arm, seen, terms)
        best = 0.0
        for k in range(3):
            reached.p[k], reached.z[k] = seen.p[k], seen.z[k]
        for c in range(CLASSES):
            square = terms[c, 3]
            reached.w[c] = unit * np.sqrt(square) if square > SINGULAR * SINGULAR else 0.0
            best = max(best, reached.w[c])
        if best < floor:
            return 0.0
        least = min(least, best)
    return least


@entry
def reach_all(robots: Any, held: Any, tried: Any, scratch_rows: Any) -> None:
    """`reach` of K stances, each at one base pose.

    Rows of `RobotModel`, shape (1,), `HeldStance` and `CandidatePose`, shape (K,), and
    `PostureScratch`, shape (1,).
    """
    for k in range(len(held)):
        tried[k].bound = reach(robots[0], held[k], 0.0, tried[k], scratch_rows[0])


@entry
def base_along(robots: Any, tried: Any, branches: IntArray, scratch_rows: Any, w_b: Array) -> None:
    """`w_b` of K stances on given branches, shape (K, N), from what `reach_all` has found."""
    robot, scratch = robots[0], scratch_rows[0]
    count = robot.limb_count
    for k in range(len(tried)):
        for i in range(count):
            reached, b = tried[k].limbs[i], branches[k, i]
            scratch.trial[i] = b
            limb_information(
                robot.limbs[i],
                FlangeAxis(vector(reached.p), vector(reached.z)),
                b,
                robot.characteristic_length,
                scratch.inversion,
                scratch.information[i, b],
            )
        w_b[k] = combined(count, scratch)


@entry
def solve_postures(
    start: int,
    stop: int,
    stances: Any,
    robots: Any,
    rules: Any,
    grid: BoxGrid,
    out: Any,
    scratch_rows: Any,
) -> None:
    """Best posture of each stance from `start` to `stop`.

    Grasps, directions and base poses of a stance are given in a frame about the grasps' centroid.

    Parameters
    ----------
    start
        First stance.
    stop
        One past the last.
    stances
        Rows of `HeldStance`, shape (k,).
    robots
        A row of `RobotModel`, shape (1,).
    rules
        A row of `PostureRule`: which base poses are tried, and which is taken.
    grid
        The boxes.
    out
        Rows of `Posture`, shape (k,), zeros; filled.
    scratch_rows
        A row of `PostureScratch`, shape (1,).
    """
    scratch = scratch_rows[0]
    for g in range(start, stop):
        _solve(stances[g], robots[0], rules[0], grid, out[g], scratch)


@part
def _solve(
    held: HeldStance,
    robot: RobotModel,
    rule: PostureRule,
    grid: BoxGrid,
    out: Posture,
    scratch: PostureScratch,
) -> None:
    """The best posture of one stance, see `solve_postures`."""
    count = _try_poses(held, robot, rule, scratch)
    limits = rule.thresholds
    # First the best posture that does not penetrate the robot itself; only if that comes too close
    # to something, the best of those that keep the clearance.
    chosen, node, touches = NONE, False, CLEAR
    loose = PostureSearch(robot, held, rule, grid, 0.0, count)
    strict = PostureSearch(robot, held, rule, grid, limits.clearance, count)
    for avoid in range(2):
        if (avoid == 0 and rule.first_avoid) or (
            avoid == 1 and not (rule.first_avoid or touches != CLEAR)
        ):
            continue
        search, lowest = (strict if avoid else loose), 0.0
        if avoid or rule.nodes_only:
            lowest = rule.nodes_margin
        out.cause = touches
        found = best_posture(search, lowest, avoid == 0, scratch, out.branch)
        chosen = found.pose
        node = _take(robot, rule, scratch, found.pose, found.w_b, out)
        if avoid == 0:
            if not node and found.seen > rule.nodes_margin:
                out.cause = SELF
            if node and rule.collide and not _clear(strict, chosen, out, scratch):
                touches = SELF
        elif node:
            out.cause = CLEAR
    if node and rule.check:
        search = strict if rule.collide else loose
        enter(search, chosen, np.inf, chosen < 0, scratch)
        tried = scratch.tried[chosen]
        hold_masks(search, tried, scratch, out)
    elif node:
        for i in range(robot.limb_count):
            out.mask[i] = ALL


@kernel
def _try_poses(
    held: HeldStance, robot: RobotModel, rule: PostureRule, scratch: PostureScratch
) -> int:
    """Set up the base poses of a stance; returns their number."""
    floor = rule.nodes_margin * rule.scale_m if rule.nodes_only else 0.0
    count = rule.roll_count * rule.height_count
    if held.opposed:
        count = rule.wide_roll_count * rule.wide_height_count
    for c in range(count):
        tried = scratch.tried[c]
        _set_pose(held, rule, c, tried.base)
        tried.bound = reach(robot, held, floor, tried, scratch) / rule.scale_m
    return count


@kernel
def _set_pose(held: HeldStance, rule: PostureRule, c: int, base: Pose) -> None:
    """Base pose `c` of a stance, from the centroid of its grasps, into `base`."""
    rolls, heights, height_count = rule.rolls, rule.heights, rule.height_count
    if held.opposed:
        rolls, heights, height_count = rule.wide_rolls, rule.wide_heights, rule.wide_height_count
    line = vector(held.line)
    x, y, z = columns(held.frame)
    roll, height = rolls[c // height_count], heights[c % height_count]
    cosine, sine = np.cos(roll), np.sin(roll)
    axes = turn(line, cosine, sine, x), turn(line, cosine, sine, y), turn(line, cosine, sine, z)
    up = turn(line, cosine, sine, vector(held.out))
    for k in range(3):
        base.position[k] = height * up[k]
        for col in range(3):
            base.rotation[k, col] = axes[col][k]


@entry
def set_poses(stances: Any, rules: Any, numbers: IntArray, out: Any) -> None:
    """A base pose of each of k stances, from the centroid of its grasps.

    Parameters
    ----------
    stances
        Rows of `HeldStance`, shape (k,).
    rules
        A row of `PostureRule`, which tells what is tried.
    numbers
        Which of those of the stance, shape (k,); what is none is passed over.
    out
        Rows of `Pose`, shape (k,), filled.
    """
    rule = rules[0]
    for k in range(len(numbers)):
        count = rule.roll_count * rule.height_count
        if stances[k].opposed:
            count = rule.wide_roll_count * rule.wide_height_count
        if numbers[k] < count:
            _set_pose(stances[k], rule, numbers[k], out[k])


@kernel
def _take(
    robot: RobotModel,
    rule: PostureRule,
    scratch: PostureScratch,
    chosen: int,
    w_b: float,
    out: Posture,
) -> bool:
    """Make base pose `chosen` the posture; whether it meets the thresholds. -1: there is none."""
    node = chosen >= 0 and w_b >= rule.thresholds.w_b
    out.w_b, out.tried = w_b, chosen
    for i in range(robot.limb_count):
        out.w_m[i] = 0.0
        if chosen >= 0:
            out.w_m[i] = scratch.tried[chosen].limbs[i].w[class_of(out.branch[i])]
        node = node and out.w_m[i] >= rule.thresholds.w_m
    if chosen >= 0:
        base = scratch.tried[chosen].base
        for k in range(3):
            out.base.position[k] = base.position[k]
            for col in range(3):
                out.base.rotation[k, col] = base.rotation[k, col]
    return node


@part
def _clear(search: PostureSearch, chosen: int, out: Posture, scratch: PostureScratch) -> bool:
    """Whether a posture touches nothing, boxes apart."""
    enter(search, chosen, np.inf, chosen < 0, scratch)
    for i in range(search.robot.limb_count):
        scratch.trial[i] = out.branch[i]
    return touches_nothing(search, chosen, scratch)
