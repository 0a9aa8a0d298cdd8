"""The check that a limb can be released from a point and folded (compiled).

A step is shown to be possible by one of two motions. In the first the limb departs along the
surface normal and folds at the body, the base moves while the limb stays folded, and the limb
unfolds and approaches. A robot may have several folds (`RobotSpec.folds`); those between which a
limb can change while the base is at rest count as one. In the second, for steps that the first
does not show, the limb swings along a line in joint space while the base moves, see `steps`.

The branches of a `ReleaseRecord` are those between which the limb can change while all else is at
rest, through a fold or, if it cannot fold, along lines from branch to branch. A limb that can
depart from or reach one of them can depart from or reach all, so branches need not be checked in
pairs. A plan uses a shorter swing if there is one, see `motion.swings`.
"""

from __future__ import annotations

from typing import Any

from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.against_boxes import set_grasp_surface
from mlivr_gym.collisions.placement import axis_of, place
from mlivr_gym.compiled.bit_sets import (
    BRANCHES,
    EMPTY,
    NO,
    YES,
    both_flips,
    has,
    has_branch,
    only,
    without_branch,
)
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.base_path import resting
from mlivr_gym.kinematics.families import branch_frames
from mlivr_gym.kinematics.limb import flange_seen
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.transitions.grasp_poses import BEFORE, folded, lifted_branches, line_end
from mlivr_gym.transitions.motions import (
    compare_with,
    is_clear,
    set_base_motion,
    set_departure,
    swing_clear,
)
from mlivr_gym.transitions.records import ReleaseRecord, StepContext, StepScratch


@entry
def release_all(
    start: int, stop: int, todo: IntArray, context: StepContext, scratch_rows: Any
) -> None:
    """Compute `StanceArrays.releases` for rows `start` to `stop` - 1 of stances and limbs (k, 2).

    If the first layer of the context is the obstacles, only the motions of the present results are
    checked.
    """
    stances, world = context.stances, context.world
    for k in range(start, stop):
        s, limb = todo[k, 0], todo[k, 1]
        answer, branches = stances.releases[s, limb], stances.branch_sets[s, limb]
        if world.first > 0:
            branches &= answer.branches
        else:
            answer.branches = 0
        for layer in range(world.first, world.stop):
            if branches:
                release(s, limb, branches, context, layer, scratch_rows[0])
            else:
                answer.branches = 0
            branches = answer.branches
        if world.stop == 0:
            answer.branches = branches
        answer.known = True


@part
def release(
    s: int, limb: int, branch_set: int, context: StepContext, layer: int, scratch: StepScratch
) -> None:
    """Compute the branches on which a limb can be released at a stance and then change.

    All else is at rest. Branches with the elbow up are preferred: of twins that differ in the elbow
    alone the other is checked only if none with the elbow up can fold. The result is written into
    `stances.releases`. Layer 0 is the map and the robot itself, 1 obstacles, among which only the
    motions of the present result are checked.
    """
    stances, robot, world = context.stances, context.robots[0], context.world
    answer, base = stances.releases[s, limb], stances.base[s]
    arm, grasp = robot.limbs[limb], world.grasps[stances.points[s, limb]]
    resting(scratch.path, base)
    set_base_motion(scratch.sweep, scratch.path, 0.0, 0.0)
    scratch.sweep.resting.count = 0
    first = branch_set
    if layer == 0:
        for other in range(robot.limb_count):
            if other != limb:
                _add_resting(s, other, context, scratch)
        first = _elbow_up(s, limb, branch_set, context, scratch)
    known_folds, free = answer.folds, EMPTY
    answer.branches = 0
    for attempt in range(2):
        rest = first if attempt == 0 else branch_set & ~first
        if not rest:
            continue
        rest = lifted_branches(robot, arm, base, grasp, rest, BEFORE, scratch)
        for b in range(BRANCHES):
            if has_branch(rest, b):
                _depart(limb, b, stances.points[s, limb], context, layer, scratch)
                if not is_clear(robot, world, layer, scratch.sweep):
                    rest = without_branch(rest, b)
        free |= rest
        if rest and (layer == 0 or known_folds):
            _fold(limb, rest, context, layer, scratch, answer)
            if answer.branches:
                return
    answer.folds = 0
    if free:
        answer.branches = _connected_by_lines(limb, free, context, layer, scratch)


@kernel
def _depart(
    limb: int, branch: int, point: int, context: StepContext, layer: int, scratch: StepScratch
) -> None:
    """Set the departure of a limb from a point."""
    grasp, inside, sweep = context.world.grasps[point], layer == 0, scratch.sweep
    set_departure(sweep.motion.first, limb, branch, grasp)
    set_departure(sweep.motion.second, limb, branch, grasp)
    compare_with(sweep, YES, inside, inside, NO)
    set_grasp_surface(sweep.surface, vector(grasp.point), vector(grasp.normal))


@kernel
def _add_resting(s: int, limb: int, context: StepContext, scratch: StepScratch) -> None:
    """Put a limb at rest on each branch on which it may hold at a stance."""
    stances, robot, world = context.stances, context.robots[0], context.world
    arm, others = robot.limbs[limb], scratch.sweep.resting
    seen, _ = flange_seen(arm, stances.base[s], world.grasps[stances.points[s, limb]].flange)
    placed, axes = scratch.sweep.first, scratch.axes
    for b in range(BRANCHES):
        if has_branch(stances.branch_sets[s, limb], b) and branch_frames(
            arm.arm, seen, b, axes, placed.frames
        ):
            others.limb[others.count] = limb
            place(arm, placed.frames, others.shapes[others.count])
            others.count += 1


@kernel
def _elbow_up(
    s: int, limb: int, branch_set: int, context: StepContext, scratch: StepScratch
) -> int:
    """Return the branches of a branch set with the elbow up.

    Of twins that differ in the elbow alone, and are both in the branch set, the one is removed that
    is closer to the surface. Twins have equal `w_m` and the same wrist; to keep one of them halves
    the work and costs few steps.
    """
    stances, robot, world = context.stances, context.robots[0], context.world
    arm, placed = robot.limbs[limb], scratch.sweep.first
    seen, _ = flange_seen(arm, stances.base[s], world.grasps[stances.points[s, limb]].flange)
    for b in range(0, BRANCHES, 2):
        if not (has_branch(branch_set, b) and has_branch(branch_set, b + 1)):
            continue
        lower = 0.0
        for side in range(2):
            height = 0.0
            if branch_frames(arm.arm, seen, b + side, scratch.axes, placed.frames):
                place(arm, placed.frames, placed.in_body)
                for c in range(arm.capsule_count):
                    a, e = axis_of(placed.in_body.ends, c)
                    height += a[2] + e[2]
            if side == 0:
                lower = height
        branch_set = (
            without_branch(branch_set, b) if height > lower else without_branch(branch_set, b + 1)
        )
    return branch_set


@kernel
def _fold(
    limb: int,
    free: int,
    context: StepContext,
    layer: int,
    scratch: StepScratch,
    answer: ReleaseRecord,
) -> None:
    """Write the branches of `free` from which a limb can fold into `answer`, if there are any.

    The limb is above its point, with the joint angles `scratch.q[0]`. It folds through one fold, or
    through those that it can change to from there.
    """
    robot, world = context.robots[0], context.world
    recheck, sweep = layer > 0, scratch.sweep
    for root in range(robot.fold_count):
        if recheck and answer.root != root:
            continue
        changeable = only(root)
        folded(robot, root, 0.0, scratch.start)
        for other in range(robot.fold_count):
            if other == root or (recheck and not has(answer.folds, other)):
                continue
            folded(robot, other, 0.0, scratch.end)
            if swing_clear(robot, world, layer, limb, scratch.start, scratch.end, sweep):
                changeable |= only(other)
        able = EMPTY
        for b in range(BRANCHES):
            if not has_branch(free, b):
                continue
            q = scratch.q[0, b]
            for fold in range(robot.fold_count):
                if not has(changeable, fold) or (recheck and answer.via[b] != fold):
                    continue
                folded(robot, fold, q.q[5], scratch.end)
                if swing_clear(robot, world, layer, limb, q, scratch.end, sweep):
                    able |= both_flips(b)
                    answer.via[b] = fold
                    break
        if able & free:
            answer.branches, answer.folds, answer.root = able & free, changeable, root
            return


@kernel
def _connected_by_lines(
    limb: int, free: int, context: StepContext, layer: int, scratch: StepScratch
) -> int:
    """Return the largest set of branches of `free` between which a limb can change along lines.

    Among obstacles it is the first branch alone.
    """
    robot, world = context.robots[0], context.world
    group = scratch.group
    for a in range(BRANCHES):
        group[a] = a
    for a in range(BRANCHES):
        if not has_branch(free, a):
            continue
        if layer > 0:
            return free & both_flips(a)
        for b in range(a + 1, BRANCHES):
            if not has_branch(free, b) or group[a] == group[b]:
                continue
            start = scratch.q[0, a]
            line_end(start, scratch.q[0, b], scratch.end)
            if swing_clear(robot, world, layer, limb, start, scratch.end, scratch.sweep):
                gone = group[b]
                for c in range(BRANCHES):
                    if group[c] == gone:
                        group[c] = group[a]
    best, most = EMPTY, 0
    for a in range(BRANCHES):
        here, count = EMPTY, 0
        for b in range(BRANCHES):
            if group[b] == group[a] and has_branch(free, b):
                here |= both_flips(b)
                count += 1
        if count > most and has_branch(free, a):
            best, most = here & free, count
    return best
