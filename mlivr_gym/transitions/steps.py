"""The check of a step of three and more limbs (compiled); for two limbs see `line_steps`.

On each base path, the straight one first, every support limb must be able to follow the base on a
branch. The limb that moves is then checked in its folds, see `release`, with all branches of the
support limbs that can follow; those that come too close to something are dropped. If no step is
possible so, the line in joint space from above one point to above the other is checked instead, for
pairs of branches in order of length. Both branches are among those on which the limb can be
released at the two stances, between which it can change at rest: one pair that is clear serves them
all, and the search need not know which.
"""

from __future__ import annotations

from typing import Any

from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.compiled.bit_sets import (
    ALL,
    BRANCHES,
    EMPTY,
    NONE,
    has,
    only,
)
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.base_path import STRAIGHT, set_path
from mlivr_gym.kinematics.holding import held_branches
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.transitions.grasp_poses import folded, line_end
from mlivr_gym.transitions.motions import (
    set_base_motion,
    swing_clear,
)
from mlivr_gym.transitions.records import StepContext, StepRecord, StepScratch
from mlivr_gym.transitions.supports import (
    ALL_SHAPES,
    SWING_INDEPENDENT,
    SWING_LIMB,
    remove_collisions,
)
from mlivr_gym.transitions.swing_lines import TRIES, lines_by_travel


@entry
def check_supports(
    start: int, stop: int, steps: Any, context: StepContext, scratch_rows: Any
) -> None:
    """Check whether every support limb can follow some base path, for steps from `start` to `stop`.

    This is quick. `StepRecord.kept` is not empty if it can, and has no other meaning.
    """
    robot = context.robots[0]
    for k in range(start, stop):
        step, scratch = steps[k], scratch_rows[0]
        reset_step(step, robot, scratch)
        support = (step.limb + 1) % robot.limb_count
        for path_kind in range(2):
            if all_follow(path_kind, step, context, scratch):
                step.kept[support] = ALL


@entry
def check_all(start: int, stop: int, steps: Any, context: StepContext, scratch_rows: Any) -> None:
    """Check the steps from `start` to `stop` - 1, rows of `StepRecord` that receive the results.

    The context has the stances before and after the steps, with their releases.
    """
    for k in range(start, stop):
        check(steps[k], context, scratch_rows[0])


@kernel
def reset_step(step: StepRecord, robot: RobotModel, scratch: StepScratch) -> None:
    """Clear the results of a step, and the limbs at rest."""
    scratch.sweep.resting.count = 0
    for path_kind in range(2):
        scratch.can_follow_known[path_kind] = False
    for i in range(robot.limb_count):
        step.kept[i] = 0
    step.path_kind, step.line_branches, step.fold = STRAIGHT, -1, -1


@kernel
def all_follow(
    path_kind: int, step: StepRecord, context: StepContext, scratch: StepScratch
) -> bool:
    """Return whether all support limbs can follow a path; `scratch.can_follow` is filled once."""
    stances, robot, world = context.stances, context.robots[0], context.world
    is_known = scratch.can_follow_known[path_kind]
    if not is_known:
        scratch.can_follow_known[path_kind] = True
        set_step_path(path_kind, step, context, scratch)
    floor, able = world.thresholds[0].floor * robot.characteristic_length**3, True
    for i in range(robot.limb_count):
        if i == step.limb:
            scratch.can_follow[path_kind, i] = 0
            continue
        if not is_known:
            scratch.can_follow[path_kind, i] = 0
            if able:
                branch_set = step.branches[i]
                if not step.fixed:
                    branch_set &= stances.branch_sets[step.after, i]
                flange = world.grasps[stances.points[step.after, i]].flange
                limb, holding = robot.limbs[i], scratch.holding
                scratch.can_follow[path_kind, i] = held_branches(
                    limb, flange, scratch.path, floor, branch_set, holding
                )
        able = able and scratch.can_follow[path_kind, i] != 0
    return able


@kernel
def set_step_path(
    path_kind: int, step: StepRecord, context: StepContext, scratch: StepScratch
) -> None:
    """Set the base path of a step."""
    stances = context.stances
    before, after = stances.base[step.before], stances.base[step.after]
    set_path(scratch.path, before, after, path_kind, vector(step.pivot))


@part
def check(step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Check a step and write the result into it."""
    stances, robot, world = context.stances, context.robots[0], context.world
    reset_step(step, robot, scratch)
    able = False
    for path_kind in range(2):
        able = able or all_follow(path_kind, step, context, scratch)
    if not able:
        return
    if world.stop == 0:
        _folded(step, context, EMPTY, scratch)
        return
    before = stances.releases[step.before, step.limb]
    after = stances.releases[step.after, step.limb]
    if before.branches == 0 or after.branches == 0:
        return
    folds = before.folds & after.folds
    if folds:
        _folded(step, context, folds, scratch)
    if not _any_kept(step, robot):
        _on_lines(step, context, scratch)


@kernel
def _any_kept(step: StepRecord, robot: RobotModel) -> bool:
    """Return whether support limbs keep a branch."""
    kept = EMPTY
    for i in range(robot.limb_count):
        kept |= step.kept[i]
    return bool(kept != 0)


@kernel
def _folded(step: StepRecord, context: StepContext, folds: int, scratch: StepScratch) -> None:
    """Keep the branches of support limbs that are clear while the other limb is folded.

    Without collision checks there are no folds.
    """
    robot, world = context.robots[0], context.world
    for path_kind in range(2):
        if not all_follow(path_kind, step, context, scratch):
            continue
        for i in range(robot.limb_count):
            scratch.clear[i] = scratch.can_follow[path_kind, i]
        if world.stop > 0:
            set_step_path(path_kind, step, context, scratch)
            set_base_motion(scratch.sweep, scratch.path, 0.0, 1.0)
            step.fold = _stays_folded(step, context, folds, scratch)
            if step.fold < 0 or not remove_collisions(
                ALL_SHAPES, step, context, scratch.clear, scratch
            ):
                step.fold = NONE
                continue
        _keep(path_kind, step, robot, scratch)
        return


@kernel
def _keep(path_kind: int, step: StepRecord, robot: RobotModel, scratch: StepScratch) -> None:
    """Keep the branches in `scratch.clear`."""
    step.path_kind = path_kind
    for i in range(robot.limb_count):
        if i != step.limb:
            step.kept[i] = scratch.clear[i]


@part
def _stays_folded(step: StepRecord, context: StepContext, folds: int, scratch: StepScratch) -> int:
    """Return the first fold in which the limb stays along the base path, or -1.

    Among obstacles only the first fold that is clear of the map is checked.
    """
    robot, world = context.robots[0], context.world
    fold = NONE
    for layer in range(world.first, world.stop):
        found = NONE
        for k in range(robot.fold_count):
            if found < 0 and has(folds, k):
                folded(robot, k, 0.0, scratch.start)
                folded(robot, k, 0.0, scratch.end)
                if swing_clear(
                    robot, world, layer, step.limb, scratch.start, scratch.end, scratch.sweep
                ):
                    found = k
        if found < 0:
            return -1
        fold, folds = found, only(found)
    return fold


@kernel
def _on_lines(step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Keep the branches of support limbs that are clear while the other swings along a line."""
    robot = context.robots[0]
    count = lines_by_travel(step, context, scratch)
    for path_kind in range(2):
        if not all_follow(path_kind, step, context, scratch):
            continue
        for i in range(robot.limb_count):
            scratch.clear[i] = scratch.can_follow[path_kind, i]
        set_step_path(path_kind, step, context, scratch)
        set_base_motion(scratch.sweep, scratch.path, 0.0, 1.0)
        is_compared = False
        for k in range(min(count, TRIES)):
            line_branches = scratch.order[k]
            if not line_clear(line_branches, step, context, scratch):
                continue
            if not is_compared:
                # Only the comparison with the swing limb depends on the swing.
                is_compared = True
                if not remove_collisions(SWING_INDEPENDENT, step, context, scratch.clear, scratch):
                    break
            for i in range(robot.limb_count):
                scratch.clear_of_swing[i] = scratch.clear[i]
            if remove_collisions(SWING_LIMB, step, context, scratch.clear_of_swing, scratch):
                for i in range(robot.limb_count):
                    scratch.clear[i] = scratch.clear_of_swing[i]
                step.line_branches = line_branches
                _keep(path_kind, step, robot, scratch)
                return


@part
def line_clear(
    line_branches: int, step: StepRecord, context: StepContext, scratch: StepScratch
) -> bool:
    """Return whether the limb can swing along the line of a pair of branches."""
    robot, world = context.robots[0], context.world
    first, last = scratch.q[0, line_branches // BRANCHES], scratch.q[1, line_branches % BRANCHES]
    line_end(first, last, scratch.end)
    for joint in range(6):
        scratch.start.q[joint] = first.q[joint]
    for layer in range(world.first, world.stop):
        if not swing_clear(
            robot, world, layer, step.limb, scratch.start, scratch.end, scratch.sweep
        ):
            return False
    return True
