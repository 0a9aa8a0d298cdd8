"""Computation of postures from their candidates, for many stances (compiled).

`rule` chooses among the candidates, `branches` computes the branch sets; `solver` is the caller.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.distances import CLEAR, SELF
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.compiled.bit_sets import ALL, CLASSES, NO, NONE, class_of
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.arm import FlangeAxis
from mlivr_gym.kinematics.families import SINGULAR, branch_terms
from mlivr_gym.kinematics.limb import flange_seen
from mlivr_gym.kinematics.manipulability import limb_information
from mlivr_gym.kinematics.poses import Pose, columns, turn, vector
from mlivr_gym.postures.branches import combined_w_b, set_branch_sets
from mlivr_gym.postures.records import (
    CandidatePose,
    Posture,
    PostureRule,
    PostureScratch,
    PostureSearch,
    StanceGeometry,
)
from mlivr_gym.postures.rule import best_posture, prepare_candidate, touches_nothing


@kernel
def evaluate_reach(
    robot: RobotModel,
    geometry: StanceGeometry,
    floor: float,
    candidate: CandidatePose,
    scratch: PostureScratch,
) -> float:
    """Compute flange poses and `w_m` of the branch classes of each limb at a base pose.

    The results are stored in `candidate.limbs`. Returned is the minimum over the limbs of the `w_m`
    of their best class; 0 as soon as one is below `floor`.
    """
    least = np.inf
    terms = scratch.holding.proof.terms
    for i in range(robot.limb_count):
        limb, limb_reach = robot.limbs[i], candidate.limbs[i]
        unit = limb.arm.links / robot.characteristic_length**3
        seen, _ = flange_seen(limb, candidate.base, geometry.grasps[i].flange)
        branch_terms(limb.arm, seen, terms)
        best = 0.0
        for k in range(3):
            limb_reach.p[k], limb_reach.z[k] = seen.p[k], seen.z[k]
        for c in range(CLASSES):
            square = terms[c, 3]
            limb_reach.w[c] = unit * np.sqrt(square) if square > SINGULAR * SINGULAR else 0.0
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
            robots[0], geometry[k], 0.0, candidates[k], scratch_rows[0]
        )


@entry
def base_along(
    robots: Any, candidates: Any, branches: IntArray, scratch_rows: Any, w_b: Array
) -> None:
    """Compute `w_b` of K stances on given branches, shape (K, N), after `reach_all`."""
    robot, scratch = robots[0], scratch_rows[0]
    count = robot.limb_count
    for k in range(len(candidates)):
        for i in range(count):
            limb_reach, b = candidates[k].limbs[i], branches[k, i]
            scratch.combination[i] = b
            limb_information(
                robot.limbs[i],
                FlangeAxis(vector(limb_reach.p), vector(limb_reach.z)),
                b,
                robot.characteristic_length,
                scratch.inversion,
                scratch.information[i, b],
            )
        w_b[k] = combined_w_b(count, scratch)


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
    """Compute the posture of each stance from `start` to `stop`, excluded.

    Grasps, directions and base poses of a stance are relative to the centroid of its grasps.
    `stances` are records of `StanceGeometry` and `out` of `Posture`, initially zero, shape (k,);
    `robots`, `rules` and `scratch_rows` are one record of `RobotModel`, `PostureRule` and
    `PostureScratch`.
    """
    scratch = scratch_rows[0]
    for g in range(start, stop):
        _solve(stances[g], robots[0], rules[0], grid, out[g], scratch)


@part
def _solve(
    geometry: StanceGeometry,
    robot: RobotModel,
    rule: PostureRule,
    grid: BoxGrid,
    out: Posture,
    scratch: PostureScratch,
) -> None:
    """Compute the posture of one stance, see `solve_postures`."""
    count = _evaluate_candidates(geometry, robot, rule, scratch)
    limits = rule.thresholds
    # First the best posture without self-penetration; only if it comes closer to something than
    # the clearance, the best posture that keeps the clearance.
    chosen, node, touches = NONE, False, CLEAR
    loose = PostureSearch(robot, geometry, rule, grid, 0.0, count)
    strict = PostureSearch(robot, geometry, rule, grid, limits.clearance, count)
    for avoid in range(2):
        if (avoid == 0 and rule.best_touches) or (
            avoid == 1 and not (rule.best_touches or touches != CLEAR)
        ):
            continue
        search, lowest = (strict if avoid else loose), 0.0
        if avoid or rule.nodes_only:
            lowest = rule.node_margin
        out.cause = touches
        best = best_posture(search, lowest, avoid == 0, scratch, out.branch)
        chosen = best.pose
        node = _store(robot, rule, scratch, best.pose, best.w_b, out)
        if avoid == 0:
            if not node and best.largest_margin > rule.node_margin:
                out.cause = SELF
            if node and rule.check_contacts and not _keeps_clearance(strict, chosen, out, scratch):
                touches = SELF
        elif node:
            out.cause = CLEAR
    if node and rule.check_branches:
        search = strict if rule.check_contacts else loose
        prepare_candidate(search, chosen, np.inf, NO, scratch)
        candidate = scratch.candidates[chosen]
        set_branch_sets(search, candidate, scratch, out)
    elif node:
        for i in range(robot.limb_count):
            out.branch_sets[i] = ALL


@kernel
def _evaluate_candidates(
    geometry: StanceGeometry, robot: RobotModel, rule: PostureRule, scratch: PostureScratch
) -> int:
    """Set up the candidate base poses of a stance and return their number."""
    floor = rule.node_margin * rule.scale_m if rule.nodes_only else 0.0
    count = pose_count(geometry, rule)
    for c in range(count):
        candidate = scratch.candidates[c]
        set_pose(geometry, rule, c, candidate.base)
        candidate.margin_bound = (
            evaluate_reach(robot, geometry, floor, candidate, scratch) / rule.scale_m
        )
    return count


@kernel
def pose_count(geometry: StanceGeometry, rule: PostureRule) -> int:
    """Return the number of candidate base poses of a stance."""
    if geometry.opposed:
        return rule.opposed_roll_count * rule.opposed_height_count
    return rule.roll_count * rule.height_count


@kernel
def set_pose(geometry: StanceGeometry, rule: PostureRule, c: int, base: Pose) -> None:
    """Set `base` to candidate base pose `c` of a stance, relative to the centroid of its grasps."""
    rolls, heights, height_count = rule.rolls, rule.heights, rule.height_count
    if geometry.opposed:
        rolls, heights, height_count = (
            rule.opposed_rolls,
            rule.opposed_heights,
            rule.opposed_height_count,
        )
    line = vector(geometry.line)
    x, y, z = columns(geometry.frame)
    roll, height = rolls[c // height_count], heights[c % height_count]
    cosine, sine = np.cos(roll), np.sin(roll)
    axes = turn(line, cosine, sine, x), turn(line, cosine, sine, y), turn(line, cosine, sine, z)
    up = turn(line, cosine, sine, vector(geometry.out))
    for k in range(3):
        base.position[k] = height * up[k]
        for col in range(3):
            base.rotation[k, col] = axes[col][k]


@kernel
def _store(
    robot: RobotModel,
    rule: PostureRule,
    scratch: PostureScratch,
    chosen: int,
    w_b: float,
    out: Posture,
) -> bool:
    """Store candidate `chosen` (-1: none) as the posture; return whether it meets thresholds."""
    node = chosen >= 0 and w_b >= rule.thresholds.w_b
    out.w_b, out.pose_number = w_b, chosen
    for i in range(robot.limb_count):
        out.w_m[i] = 0.0
        if chosen >= 0:
            out.w_m[i] = scratch.candidates[chosen].limbs[i].w[class_of(out.branch[i])]
        node = node and out.w_m[i] >= rule.thresholds.w_m
    if chosen >= 0:
        base = scratch.candidates[chosen].base
        for k in range(3):
            out.base.position[k] = base.position[k]
            for col in range(3):
                out.base.rotation[k, col] = base.rotation[k, col]
    return node


@part
def _keeps_clearance(
    search: PostureSearch, chosen: int, out: Posture, scratch: PostureScratch
) -> bool:
    """Return whether a posture touches nothing, without comparing the base with boxes."""
    prepare_candidate(search, chosen, np.inf, NO, scratch)
    for i in range(search.robot.limb_count):
        scratch.combination[i] = out.branch[i]
    return touches_nothing(search, chosen, scratch)
