"""Support limbs that follow a base path, clear of each other and of the swing limb (compiled)."""

from __future__ import annotations

from typing import cast

import numpy as np

from mlivr_gym.compiled.bit_sets import (
    BRANCHES,
    NO,
    YES,
    both_flips,
    first_branch,
    has_branch,
    without_branch,
)
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.postures.records import Limbs
from mlivr_gym.transitions.motions import compare_with, is_clear, set_support, set_swing
from mlivr_gym.transitions.records import StepContext, StepRecord, StepScratch

SWING_INDEPENDENT, SWING_LIMB, ALL_SHAPES = (cast(int, k) for k in np.arange(3))
"""Shapes with which a support limb is compared: boxes, body, itself and other support limbs; the
swing limb; and both."""


@kernel
def remove_collisions(
    parts: int,
    step: StepRecord,
    context: StepContext,
    branch_sets: Limbs,
    scratch: StepScratch,
) -> bool:
    """Remove the branches on which support limbs collide with each other or with the swing.

    The swing limb goes from `scratch.start` to `scratch.end` while the base follows the path in
    `scratch.sweep`; `parts` is `SWING_INDEPENDENT`, `SWING_LIMB` or `ALL_SHAPES`. Branch sets of
    the support limbs are changed in place. Returned is whether every support limb keeps a branch;
    the check ends at the first that keeps none.
    """
    robot, world = context.robots[0], context.world
    for layer in range(world.first, world.stop):
        if not each_clear(parts, layer, step, context, branch_sets, scratch):
            return False
        if layer > 0 or parts == SWING_LIMB:
            continue
        for i in range(robot.limb_count):
            for j in range(i + 1, robot.limb_count):
                if i != step.limb and j != step.limb:
                    _remove_collisions_between(i, j, step, context, branch_sets, scratch)
                    if branch_sets[i] == 0 or branch_sets[j] == 0:
                        return False
    return True


@kernel
def each_clear(
    parts: int,
    layer: int,
    step: StepRecord,
    context: StepContext,
    branch_sets: Limbs,
    scratch: StepScratch,
) -> bool:
    """Remove branches as `remove_collisions` does, in one layer, without pairs of support limbs."""
    robot = context.robots[0]
    for i in range(robot.limb_count):
        if i == step.limb:
            continue
        for b in range(BRANCHES):
            if has_branch(branch_sets[i], b) and not _support_clear(
                parts, i, b, layer, step, context, scratch
            ):
                branch_sets[i] = without_branch(branch_sets[i], b)
        if branch_sets[i] == 0:
            return False
    return True


@part
def _support_clear(
    parts: int,
    i: int,
    b: int,
    layer: int,
    step: StepRecord,
    context: StepContext,
    scratch: StepScratch,
) -> bool:
    """Return whether limb `i` on branch `b` follows the base path clear of the given parts."""
    stances, robot, world = context.stances, context.robots[0], context.world
    inside, sweep = layer == 0, scratch.sweep
    set_support(sweep.motion.first, i, b, world.grasps[stances.points[step.after, i]])
    set_swing(sweep.motion.second, step.limb, scratch.start, scratch.end)
    others, swing_limb = parts != SWING_LIMB, parts != SWING_INDEPENDENT
    compare_with(sweep, others, others and inside, NO, swing_limb and inside)
    return is_clear(robot, world, layer, sweep)


@kernel
def both_clear(
    i: int, b: int, j: int, c: int, step: StepRecord, context: StepContext, scratch: StepScratch
) -> bool:
    """Return whether two support limbs stay clear of each other along the base path.

    Limb `i` is on branch `b`, limb `j` on branch `c`.
    """
    stances, robot, world = context.stances, context.robots[0], context.world
    sweep, points = scratch.sweep, stances.points
    set_support(sweep.motion.first, i, b, world.grasps[points[step.after, i]])
    set_support(sweep.motion.second, j, c, world.grasps[points[step.after, j]])
    compare_with(sweep, NO, NO, NO, YES)
    return is_clear(robot, world, world.first, sweep)


@part
def _remove_collisions_between(
    i: int,
    j: int,
    step: StepRecord,
    context: StepContext,
    branch_sets: Limbs,
    scratch: StepScratch,
) -> None:
    """Remove branches until all that two support limbs keep are clear of each other.

    A branch of the second limb is removed if it is too close to any branch of the first. If the
    second would keep none, it keeps its first branch, and those of the first limb that are too
    close to this one are removed.
    """
    kept = branch_sets[j]
    for c in range(BRANCHES):
        for b in range(BRANCHES):
            present = has_branch(kept, c) and has_branch(branch_sets[i], b)
            if present and not both_clear(i, b, j, c, step, context, scratch):
                kept = without_branch(kept, c)
    if kept:
        branch_sets[j] = kept
        return
    chosen = first_branch(branch_sets[j])
    branch_sets[j] &= both_flips(chosen)
    for b in range(BRANCHES):
        if has_branch(branch_sets[i], b) and not both_clear(
            i, b, j, chosen, step, context, scratch
        ):
            branch_sets[i] = without_branch(branch_sets[i], b)
