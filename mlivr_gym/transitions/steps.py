"""The check of a step: the base moves straight, and the support limbs follow it (compiled).

The base goes on a straight line and by slerp from one posture to the other, and each support limb
follows it on its branch, see `collisions.following`. The limb that moves stays in a fold that it
has at both stances, or goes on a line in joint space from above one point to above the other. The
first such swing, in a fixed order, beside which every support keeps a branch proves the step.
Where only one limb supports the robot, its branches need no swing in common: it keeps each branch
that some swing serves.

An edge is a fact of two stances: whatever branches limbs may be on before the step, after it the
supports may be on those of them that the edge keeps, in any combination.

What is quick comes first: in the middles of the first intervals, each support on its own. Motions
are checked from the end whose base comes first, so a step and that back have equal results.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from mlivr_gym.collisions.base_path import comes_first, set_path
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.followers import (
    choose_branch,
    compare_with,
    followed_branches,
    forget,
    set_follower,
    with_flips,
)
from mlivr_gym.collisions.intervals import WHOLE, check_line
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.compiled.bit_sets import (
    BRANCHES,
    EMPTY,
    NO,
    NONE,
    YES,
    both_flips,
    has,
    has_branch,
    only,
    without_branch,
)
from mlivr_gym.compiled.kernels import entry, kernel, late_entry
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.postures.records import Limbs
from mlivr_gym.transitions.grasp_poses import folded, line_end
from mlivr_gym.transitions.records import StepContext, StepRecord, StepScratch, WorldRecord
from mlivr_gym.transitions.swing_lines import TRIES, lines_by_travel

FEW = cast(int, np.int64(4))
"""Number of the interval before which middles are looked at first."""

OBSTACLES = cast(int, np.int64(1))
"""Layer of a world that has the obstacles."""

KEPT_CLEAR = 5e-4
"""How far what is committed may be from the motion that is checked, which keeps so much more than
the clearance while the base moves [m]."""


@entry
def check_supports(
    start: int, stop: int, steps: Any, context: StepContext, scratch_rows: Any
) -> None:
    """Look whether every support follows the base in the first middles, as in a step it must.

    For steps `start` to `stop` - 1. `StepRecord.kept` is not empty if so, and has no other meaning.
    """
    for k in range(start, stop):
        begin(steps[k], context, scratch_rows[0])
        if follow(FEW, steps[k], context, scratch_rows[0]):
            steps[k].kept[(steps[k].limb + 1) % context.robots[0].limb_count] = both_flips(EMPTY)


@entry
def look_all(start: int, stop: int, steps: Any, context: StepContext, scratch_rows: Any) -> None:
    """Of the branches that steps keep, keep those that are clear in the first middles, each alone.

    None are kept if no swing is clear of obstacles there. This is quick, and more than `check_all`
    keeps in the same world, or as much.
    """
    for k in range(start, stop):
        step, scratch = steps[k], scratch_rows[0]
        begin(step, context, scratch)
        if each_alone(FEW, step, context, scratch) and _some_swing(step, context, scratch):
            _keep(scratch.clear, step, context.robots[0])


@entry
def check_all(start: int, stop: int, steps: Any, context: StepContext, scratch_rows: Any) -> None:
    """Check the steps from `start` to `stop` - 1, rows of `StepRecord` that receive the results.

    The context has the stances before and after the steps, with their releases.
    """
    for k in range(start, stop):
        _check(steps[k], context, scratch_rows[0])


@kernel
def begin(step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Set the way of the base and the branches that supports may be on; clear the results."""
    stances, robot, world = context.stances, context.robots[0], context.world
    lines = scratch.line
    line, before, after = lines.line, stances.base[step.before], stances.base[step.after]
    scratch.back = comes_first(vector(after.position), vector(before.position))
    if scratch.back:
        set_path(line.path, after, before)
    else:
        set_path(line.path, before, after)
    line.follows = EMPTY
    lines.floor = world.thresholds[0].floor * robot.characteristic_length**3
    lines.surface.applies, lines.resting.count = NO, EMPTY
    for i in range(robot.limb_count):
        scratch.clear[i] = EMPTY
        if i != step.limb:
            set_follower(i, world.grasps[stances.points[step.after, i]].flange, lines)
            on_both = stances.branch_sets[step.before, i] & stances.branch_sets[step.after, i]
            scratch.clear[i] = on_both & step.kept[i]
    for i in range(len(step.kept)):
        step.kept[i] = EMPTY


@kernel
def stays_clear(
    before: int, layer: int, robot: RobotModel, world: WorldRecord, lines: LineScratch
) -> bool:
    """Return whether what was selected is clear in a layer of the world; see `check_line`."""
    grid, clearance = world.boxes if layer == 0 else world.obstacles, world.thresholds[0].clearance
    if lines.line.moves:
        clearance += KEPT_CLEAR
    return check_line(robot, grid, clearance, before, lines) == CLEAR


@kernel
def follow(before: int, step: StepRecord, context: StepContext, scratch: StepScratch) -> bool:
    """Keep the branches on which supports follow, whatever they are close to.

    For `before` see `check_line`. Returned is whether each support keeps one.
    """
    robot, lines = context.robots[0], scratch.line
    for i in range(robot.limb_count):
        kept = followed_branches(i, scratch.clear[i], before, robot, context.world.boxes, lines)
        scratch.clear[i] = kept
        if i != step.limb and kept == EMPTY:
            return False
    return True


@kernel
def each_alone(before: int, step: StepRecord, context: StepContext, scratch: StepScratch) -> bool:
    """Keep the branches on which supports are clear of all but other limbs; see `follow`."""
    robot, world, lines = context.robots[0], context.world, scratch.line
    for layer in range(world.first, world.stop):
        compare_with(lines, EMPTY, YES, EMPTY, (NONE, NONE))
        if not stays_clear(before, layer, robot, world, lines):
            return False
        for i in range(robot.limb_count):
            branch_set = scratch.clear[i]
            for b in range(BRANCHES):
                if has_branch(branch_set, b):
                    choose_branch(i, b, branch_set, lines)
                    itself = only(i) if layer == 0 else EMPTY
                    compare_with(lines, only(i), NO, itself, (NONE, NONE))
                    clear = stays_clear(before, layer, robot, world, lines)
                    branch_set = with_flips(clear, i, branch_set, lines)
            scratch.clear[i] = branch_set
            if i != step.limb and branch_set == EMPTY:
                return False
    return True


@kernel
def _check(step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Check a step and write the result into it."""
    stances, robot, world = context.stances, context.robots[0], context.world
    begin(step, context, scratch)
    if world.stop == 0:
        if follow(FEW, step, context, scratch) and follow(WHOLE, step, context, scratch):
            _keep(scratch.clear, step, robot)
        return
    before = stances.releases[step.before, step.limb]
    after = stances.releases[step.after, step.limb]
    if before.branches == 0 or after.branches == 0:
        return
    if not each_alone(FEW, step, context, scratch):
        return
    if not each_alone(WHOLE, step, context, scratch):
        return
    if not _all_apart(step, context, scratch):
        return
    for fold in range(robot.fold_count):
        if has(before.folds & after.folds, fold):
            set_fold(fold, step, robot, scratch)
            if _serves(step, context, scratch):
                return
    for k in range(min(lines_by_travel(step, context, scratch), TRIES)):
        set_swing_line(scratch.order[k], step, scratch)
        if _serves(step, context, scratch):
            return


@kernel
def _keep(branch_sets: Limbs, step: StepRecord, robot: RobotModel) -> None:
    """Add branches to those that supports keep."""
    for i in range(robot.limb_count):
        step.kept[i] |= branch_sets[i]


@kernel
def set_fold(fold: int, step: StepRecord, robot: RobotModel, scratch: StepScratch) -> None:
    """Set the limb that moves to stay in a fold."""
    moving, lines = step.limb, scratch.line
    folded(robot, fold, 0.0, lines.line.first[moving])
    folded(robot, fold, 0.0, lines.line.last[moving])
    forget(moving, EMPTY, lines)


@kernel
def set_swing_line(pair: int, step: StepRecord, scratch: StepScratch) -> None:
    """Set the limb that moves to go on the line of a pair of branches, `8 * before + after`."""
    moving, lines = step.limb, scratch.line
    first, last = scratch.q[0, pair // BRANCHES], scratch.q[1, pair % BRANCHES]
    line_end(first, last, scratch.end)
    for j in range(6):
        a, b = first.q[j], scratch.end.q[j]
        if scratch.back:
            a, b = b, a
        lines.line.first[moving].q[j], lines.line.last[moving].q[j] = a, b
    forget(moving, EMPTY, lines)


@kernel
def _some_swing(step: StepRecord, context: StepContext, scratch: StepScratch) -> bool:
    """Return whether some swing is clear of obstacles in the first middles, if there are any."""
    stances, robot, world = context.stances, context.robots[0], context.world
    if world.stop <= OBSTACLES:
        return True
    before = stances.releases[step.before, step.limb]
    after = stances.releases[step.after, step.limb]
    for fold in range(robot.fold_count):
        if has(before.folds & after.folds, fold):
            set_fold(fold, step, robot, scratch)
            if _swing_clear_of(OBSTACLES, FEW, step, robot, world, scratch.line):
                return True
    # With fewer branches other lines are among the shortest, so all are looked at.
    for k in range(lines_by_travel(step, context, scratch)):
        set_swing_line(scratch.order[k], step, scratch)
        if _swing_clear_of(OBSTACLES, FEW, step, robot, world, scratch.line):
            return True
    return False


@kernel
def swing_clear(
    before: int, step: StepRecord, robot: RobotModel, world: WorldRecord, lines: LineScratch
) -> bool:
    """Return whether the limb that moves is clear of all but other limbs; see `check_line`."""
    if world.stop > OBSTACLES:
        # Obstacles come first, in a few places, since most swings that fail do so there.
        if not _swing_clear_of(OBSTACLES, FEW, step, robot, world, lines):
            return False
        forget(step.limb, EMPTY, lines)  # nothing travels in places that are only looked at
    for k in range(world.stop):
        if not _swing_clear_of(world.stop - 1 - k, before, step, robot, world, lines):
            return False
    return True


@kernel
def _swing_clear_of(
    layer: int,
    before: int,
    step: StepRecord,
    robot: RobotModel,
    world: WorldRecord,
    lines: LineScratch,
) -> bool:
    """Return whether the limb that moves is clear of a layer, and of itself in the first one."""
    itself = only(step.limb) if layer == 0 else EMPTY
    compare_with(lines, only(step.limb), NO, itself, (NONE, NONE))
    return stays_clear(before, layer, robot, world, lines)


@kernel
def _serves(step: StepRecord, context: StepContext, scratch: StepScratch) -> bool:
    """Keep what supports keep beside the swing that is set; return whether no other is needed.

    With several supports that is so once each keeps a branch. With only one it is so once all of
    its branches are kept, beside this swing or others before.
    """
    robot, world, lines = context.robots[0], context.world, scratch.line
    if not swing_clear(WHOLE, step, robot, world, lines):
        return False
    for i in range(robot.limb_count):
        scratch.clear_of_swing[i] = scratch.clear[i]
        if i == step.limb:
            continue
        if robot.limb_count == 2:
            scratch.clear_of_swing[i] &= ~step.kept[i]
        for b in range(BRANCHES):
            if has_branch(scratch.clear_of_swing[i], b):
                choose_branch(i, b, scratch.clear_of_swing[i], lines)
                if not are_apart(WHOLE, step.limb, i, robot, world, lines):
                    scratch.clear_of_swing[i] = without_branch(scratch.clear_of_swing[i], b)
        if scratch.clear_of_swing[i] == EMPTY:
            return False
    _keep(scratch.clear_of_swing, step, robot)
    if robot.limb_count > 2:
        return True
    is_all: bool = step.kept[1 - step.limb] == scratch.clear[1 - step.limb]
    return is_all


@kernel
def are_apart(
    before: int, i: int, j: int, robot: RobotModel, world: WorldRecord, lines: LineScratch
) -> bool:
    """Return whether two limbs stay clear of each other; see `check_line`."""
    compare_with(lines, EMPTY, NO, EMPTY, (i, j))
    return stays_clear(before, 0, robot, world, lines)


@kernel
def _all_apart(step: StepRecord, context: StepContext, scratch: StepScratch) -> bool:
    """Remove branches until all that supports keep are clear of each other.

    They are compared in cyclic order from the limb that moves on, so that a robot that has turned
    by one of its limbs keeps the same. Returned is whether each support keeps one.
    """
    limbs, clear = context.robots[0].limb_count, scratch.clear
    for first in range(1, limbs):
        for second in range(first + 1, limbs):
            i, j = (step.limb + first) % limbs, (step.limb + second) % limbs
            _keep_apart(i, j, context, scratch)
            if clear[i] == EMPTY or clear[j] == EMPTY:
                return False
    return True


@kernel
def _keep_apart(i: int, j: int, context: StepContext, scratch: StepScratch) -> None:
    """Remove branches until all that two support limbs keep are clear of each other.

    A branch of the second limb is removed if it is too close to any branch of the first. If the
    second would keep none, it keeps its first branch, and those of the first limb that are too
    close to this one are removed.
    """
    robot, world, lines, clear = context.robots[0], context.world, scratch.line, scratch.clear
    kept = clear[j]
    for c in range(BRANCHES):
        for b in range(BRANCHES):
            if has_branch(kept, c) and has_branch(clear[i], b):
                choose_branch(i, b, clear[i], lines)
                choose_branch(j, c, clear[j], lines)
                if not are_apart(WHOLE, i, j, robot, world, lines):
                    kept = without_branch(kept, c)
    if kept:
        clear[j] = kept
        return
    chosen = 0
    while not has_branch(clear[j], chosen):
        chosen += 1
    clear[j] &= both_flips(chosen)
    for b in range(BRANCHES):
        if has_branch(clear[i], b):
            choose_branch(i, b, clear[i], lines)
            choose_branch(j, chosen, clear[j], lines)
            if not are_apart(WHOLE, i, j, robot, world, lines):
                clear[i] = without_branch(clear[i], b)


@late_entry
def line_clear(moving: int, robots: Any, world: WorldRecord, rows: Any) -> bool:
    """Return whether a limb is clear along a line while the base moves straight or rests.

    Line, base and what the others are at, or their branches, are set in `rows`, a row of
    `LineScratch`. The others are compared with this limb alone.
    """
    robot, lines = robots[0], rows[0]
    for i in range(robot.limb_count):
        forget(i, lines.line.branch[i] if i != moving else EMPTY, lines)
    # Boxes of the map, obstacles, then the other limbs.
    for k in range(world.stop + robot.limb_count):
        other = k - world.stop
        if other == moving:
            continue
        layer = k if other < 0 else 0
        if other < 0:
            itself = only(moving) if layer == 0 else EMPTY
            compare_with(lines, only(moving), NO, itself, (NONE, NONE))
        else:
            compare_with(lines, EMPTY, NO, EMPTY, (moving, other))
        if not stays_clear(WHOLE, layer, robot, world, lines):
            return False
    return True
