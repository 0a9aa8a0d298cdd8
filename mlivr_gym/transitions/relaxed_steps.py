"""Relaxed steps: an upper bound of the branches that a step keeps, whatever the label (compiled).

The branches that `steps` keeps depend on those that the support limbs may be on: of two branches
that come too close to each other one is removed, and the second base path is checked only if the
first keeps none. So a step that fails with all branches may pass with some of them. A relaxed step
removes a branch only if it is kept on no base path, in no fold and on no line, whatever branches
the other limbs are on. It keeps all that `steps` keeps for any label; if it keeps none, there is no
step.
"""

from __future__ import annotations

from typing import Any

from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, has, has_branch, without_branch
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.postures.records import Limbs
from mlivr_gym.transitions.grasp_poses import folded
from mlivr_gym.transitions.motions import set_base_motion, swing_clear
from mlivr_gym.transitions.records import StepContext, StepRecord, StepScratch
from mlivr_gym.transitions.steps import (
    all_follow,
    line_clear,
    reset_step,
    set_step_path,
)
from mlivr_gym.transitions.supports import SWING_INDEPENDENT, SWING_LIMB, both_clear, each_clear
from mlivr_gym.transitions.swing_lines import TRIES, lines_by_travel


@entry
def relax_all(start: int, stop: int, steps: Any, context: StepContext, scratch_rows: Any) -> None:
    """Relax the steps from `start` to `stop`: write the branches that they keep at most.

    For the parameters see `steps.check_all`.
    """
    for k in range(start, stop):
        _relax(steps[k], context, scratch_rows[0])


@kernel
def _relax(step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Write the branches that support limbs keep at most into `step.kept`.

    A motion is checked only while it can add a branch.
    """
    stances, robot, world = context.stances, context.robots[0], context.world
    reset_step(step, robot, scratch)
    before = stances.releases[step.before, step.limb]
    after = stances.releases[step.after, step.limb]
    if world.stop > 0 and (before.branches == 0 or after.branches == 0):
        return
    for path_kind in range(2):
        if not all_follow(path_kind, step, context, scratch):
            continue
        for i in range(robot.limb_count):
            scratch.clear[i] = scratch.can_follow[path_kind, i]
        if world.stop == 0:
            _add(step, scratch.clear, robot.limb_count)
        elif not _keeps_all(step, scratch.clear, robot.limb_count):
            set_step_path(path_kind, step, context, scratch)
            set_base_motion(scratch.sweep, scratch.path, 0.0, 1.0)
            if _each_keeps_one(SWING_INDEPENDENT, scratch.clear, step, context, scratch):
                _relax_folded(before.folds & after.folds, step, context, scratch)
                _relax_on_lines(step, context, scratch)


@kernel
def _keeps_all(step: StepRecord, branch_sets: Limbs, limbs: int) -> bool:
    """Return whether all requested branches are kept."""
    missing = EMPTY
    for i in range(limbs):
        if i != step.limb:
            missing |= branch_sets[i] & ~step.kept[i]
    return bool(missing == 0)


@kernel
def _add(step: StepRecord, branch_sets: Limbs, limbs: int) -> None:
    """Add branches to those that are kept at most."""
    for i in range(limbs):
        if i != step.limb:
            step.kept[i] |= branch_sets[i]


@kernel
def _each_keeps_one(
    parts: int, branch_sets: Limbs, step: StepRecord, context: StepContext, scratch: StepScratch
) -> bool:
    """Remove branches that collide whatever other limbs do; return whether each limb keeps one."""
    world = context.world
    for layer in range(world.first, world.stop):
        if not each_clear(parts, layer, step, context, branch_sets, scratch):
            return False
    return True


@kernel
def _relax_folded(folds: int, step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Add the branches that are clear while the swing limb stays in one of the given folds."""
    robot, world = context.robots[0], context.world
    for k in range(robot.fold_count):
        if not has(folds, k) or _keeps_all(step, scratch.clear, robot.limb_count):
            continue
        folded(robot, k, 0.0, scratch.start)
        folded(robot, k, 0.0, scratch.end)
        clear = True
        for layer in range(world.first, world.stop):
            clear = clear and swing_clear(
                robot, world, layer, step.limb, scratch.start, scratch.end, scratch.sweep
            )
        if clear:
            _relax_with_swing(step, context, scratch)


@kernel
def _relax_on_lines(step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Add the branches that are clear while the swing limb follows one of the candidate lines."""
    limbs = context.robots[0].limb_count
    if _keeps_all(step, scratch.clear, limbs):
        return
    count = lines_by_travel(step, context, scratch)
    for k in range(min(count, TRIES)):
        done = _keeps_all(step, scratch.clear, limbs)
        if not done and line_clear(scratch.order[k], step, context, scratch):
            _relax_with_swing(step, context, scratch)


@kernel
def _relax_with_swing(step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Add the branches that are clear of the swing in `scratch`."""
    limbs, branch_sets = context.robots[0].limb_count, scratch.clear_of_swing
    for i in range(limbs):
        branch_sets[i] = scratch.clear[i]
    if not _each_keeps_one(SWING_LIMB, branch_sets, step, context, scratch):
        return
    if context.world.first == 0:
        for i in range(limbs):
            for j in range(i + 1, limbs):
                if i != step.limb and j != step.limb:
                    _remove_conflicts(i, j, branch_sets, step, context, scratch)
                    if branch_sets[i] == 0:
                        return
    _add(step, branch_sets, limbs)


@kernel
def _remove_conflicts(
    i: int, j: int, branch_sets: Limbs, step: StepRecord, context: StepContext, scratch: StepScratch
) -> None:
    """Remove the branches of two support limbs that are too close to all of the other limb."""
    alone_i, alone_j = branch_sets[i], branch_sets[j]
    for b in range(BRANCHES):
        for c in range(BRANCHES):
            both = has_branch(branch_sets[i], b) and has_branch(branch_sets[j], c)
            new = has_branch(alone_i, b) or has_branch(alone_j, c)
            if both and new and both_clear(i, b, j, c, step, context, scratch):
                alone_i, alone_j = without_branch(alone_i, b), without_branch(alone_j, c)
    branch_sets[i], branch_sets[j] = branch_sets[i] & ~alone_i, branch_sets[j] & ~alone_j
