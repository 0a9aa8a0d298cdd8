"""Relaxed steps: an upper bound of the branches that a step keeps, in less time (compiled).

Of two branches that come too close to each other `steps` removes one, and takes the first swing
beside which each support keeps one. A relaxed step removes a branch only if it is not kept beside
any swing, whatever branches the other limbs are on: what a support is close to alone is proved on
the whole way, and what two limbs are close to is looked at in the middles of the first intervals.
So it keeps all that `steps` keeps; if it keeps none, there is no step. The step back is relaxed
alike, since both are checked from the same end.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from mlivr_gym.collisions.followers import choose_branch
from mlivr_gym.collisions.intervals import WHOLE
from mlivr_gym.compiled.bit_sets import (
    BRANCHES,
    EMPTY,
    any_flip,
    has,
    has_branch,
    only,
    without_branch,
)
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.transitions.records import StepContext, StepRecord, StepScratch
from mlivr_gym.transitions.steps import (
    are_apart,
    begin,
    each_alone,
    follow,
    set_fold,
    set_swing_line,
    swing_clear,
)
from mlivr_gym.transitions.swing_lines import TRIES, lines_by_travel

MIDDLES = cast(int, np.int64(8))
"""Number of the interval before which middles are looked at."""


@entry
def relax_all(start: int, stop: int, steps: Any, context: StepContext, scratch_rows: Any) -> None:
    """Relax the steps from `start` to `stop` - 1: write the branches that they keep at most.

    For the parameters see `steps.check_all`.
    """
    robot, world = context.robots[0], context.world
    for k in range(start, stop):
        step, scratch = steps[k], scratch_rows[0]
        begin(step, context, scratch)
        if world.stop == 0:
            if follow(WHOLE, step, context, scratch):
                for i in range(robot.limb_count):
                    step.kept[i] = scratch.clear[i]
            continue
        before = context.stances.releases[step.before, step.limb]
        after = context.stances.releases[step.after, step.limb]
        if before.branches == 0 or after.branches == 0:
            continue
        # Most branches that are lost are lost in a middle, which is quick to see.
        if not each_alone(MIDDLES, step, context, scratch):
            continue
        if not each_alone(WHOLE, step, context, scratch):
            continue
        _find_apart(step, context, scratch)
        for fold in range(robot.fold_count):
            if has(before.folds & after.folds, fold) and not _keeps_all(step, context, scratch):
                set_fold(fold, step, robot, scratch)
                _add_beside_swing(step, context, scratch)
        if not _keeps_all(step, context, scratch):
            count = lines_by_travel(step, context, scratch)
            for n in range(min(count, TRIES)):
                if not _keeps_all(step, context, scratch):
                    set_swing_line(scratch.order[n], step, scratch)
                    _add_beside_swing(step, context, scratch)


@kernel
def _keeps_all(step: StepRecord, context: StepContext, scratch: StepScratch) -> bool:
    """Return whether all branches that are clear alone are kept."""
    missing = EMPTY
    for i in range(context.robots[0].limb_count):
        missing |= scratch.clear[i] & ~step.kept[i]
    return bool(missing == EMPTY)


@kernel
def _find_apart(step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Find for each branch of a support the branches of the others that are clear of it."""
    robot, world, lines = context.robots[0], context.world, scratch.line
    for i in range(robot.limb_count):
        for b in range(BRANCHES):
            for j in range(robot.limb_count):
                scratch.apart[i, b, j] = EMPTY
    for i in range(robot.limb_count):
        for j in range(i + 1, robot.limb_count):
            for b in range(BRANCHES):
                for c in range(BRANCHES):
                    both = has_branch(scratch.clear[i], b) and has_branch(scratch.clear[j], c)
                    if not both:
                        continue
                    choose_branch(i, b, scratch.clear[i], lines)
                    choose_branch(j, c, scratch.clear[j], lines)
                    if are_apart(MIDDLES, i, j, robot, world, lines):
                        scratch.apart[i, b, j] |= only(c)
                        scratch.apart[j, c, i] |= only(b)


@kernel
def _add_beside_swing(step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Add the branches that supports keep at most beside the swing that is set."""
    robot, world, lines = context.robots[0], context.world, scratch.line
    if not swing_clear(MIDDLES, step, robot, world, lines):
        return
    kept = scratch.clear_of_swing
    for i in range(robot.limb_count):
        kept[i] = scratch.clear[i]
        for b in range(BRANCHES):
            if has_branch(kept[i], b):
                choose_branch(i, b, scratch.clear[i], lines)
                if not are_apart(MIDDLES, step.limb, i, robot, world, lines):
                    kept[i] = without_branch(kept[i], b)
        if i != step.limb and kept[i] == EMPTY:
            return
    for i in range(robot.limb_count):
        for j in range(robot.limb_count):
            for b in range(BRANCHES):
                if step.limb in (i, j) or i == j or not has_branch(kept[i], b):
                    continue
                if scratch.apart[i, b, j] & any_flip(kept[j]) == EMPTY:
                    kept[i] = without_branch(kept[i], b)
        if i != step.limb and kept[i] == EMPTY:
            return
    for i in range(robot.limb_count):
        step.kept[i] |= kept[i]
