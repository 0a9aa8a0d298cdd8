"""The check of a step of two limbs: the support's joints go on one line (compiled).

A robot of two limbs that moves one stands on the other alone. From the hold before to the hold
after, on the same branch with the same flip, the joints of this support change linearly, and the
base goes where they take it. Joint windows are boxes, so the line stays inside them; no inverse
kinematics is needed on the way. Each hold is looked at on its own: an edge keeps it if its line is
clear while the other limb stays in one of the folds that it has at both stances, or moves on a line
of its own from above one point to above the other. The first such swing, in a fixed order, is that
of the hold.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.intervals import check_line
from mlivr_gym.collisions.joint_lines import place_axes
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.compiled.bit_sets import (
    BRANCHES,
    EMPTY,
    NO,
    NONE,
    YES,
    code_of,
    has,
    has_branch,
    only,
    with_code,
)
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.kinematics.chain import LIMIT_TOLERANCE, in_window
from mlivr_gym.kinematics.following import invert_jacobian
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.inverse import SINGULAR_TOO
from mlivr_gym.kinematics.limb import Angles, angles_at
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.transitions.grasp_poses import folded, line_end
from mlivr_gym.transitions.records import (
    STORED_ALONE,
    StepContext,
    StepRecord,
    StepScratch,
    WorldRecord,
)
from mlivr_gym.transitions.swing_lines import TRIES, lines_by_travel

PLACES = 4
"""Places of a line at which `w_m` of the support is compared with the floor."""

OTHER_FOLD, ON_LINE, UNSERVED = (cast(int, k) for k in np.array([14, 15, -1]))
"""Codes of the swing of a hold beside the numbers of folds: some fold, which flip 0 and 1 need not
share; the line of the edge; none."""

SAME_LINE = 1e-9
"""Turns of joint 6 that differ by less are equal [rad]."""


@kernel
def hold(limb: LimbModel, base: Pose, grasp: Grasp, branch: int, to: Angles) -> bool:
    """Compute the joint angles with which a limb holds a grasp on a branch with flip 0.

    Returned is whether the branch exists there with every joint but the last in its window.
    """
    if not angles_at(limb, base, grasp.flange, branch, SINGULAR_TOO, to.q):
        return False
    inside = True
    for j in range(6):
        to.q[j] = in_window(to.q[j], limb.arm.window[j, 0])
        inside = inside and (j == 5 or to.q[j] <= limb.arm.window[j, 1] + LIMIT_TOLERANCE)
    return inside


@kernel
def set_line(
    step: StepRecord, context: StepContext, branch: int, flip: int, scratch: StepScratch
) -> bool:
    """Set the line of the support of a step from hold to hold; return whether there is one.

    With flip 1 the tool is turned by half a turn, and so is joint 6.
    """
    stances, robot, world = context.stances, context.robots[0], context.world
    support, line = 1 - step.limb, scratch.line.line
    limb, window = robot.limbs[support], robot.limbs[support].arm.window
    grasp = world.grasps[stances.points[step.after, support]]
    there = True
    for side in range(2):
        to = line.last[support] if side else line.first[support]
        base = stances.base[step.after] if side else stances.base[step.before]
        there = there and hold(limb, base, grasp, branch, to)
        to.q[5] = in_window(to.q[5] + np.pi * flip, window[5, 0])
        there = there and to.q[5] <= window[5, 1] + LIMIT_TOLERANCE
    line.leader, line.follows, sign = support, EMPTY, 1.0 - 2.0 * flip
    for k in range(3):
        line.grasp.position[k] = grasp.flange.position[k]
        for column in range(3):
            turned = sign if column < 2 else 1.0
            line.grasp.rotation[k, column] = turned * grasp.flange.rotation[k, column]
    return there


@kernel
def _wanted(step: StepRecord, context: StepContext) -> int:
    """Return the holds of the support that a step asks for and that the stance after has."""
    support = 1 - step.limb
    if step.fixed:
        return int(step.branches[support])
    return int(step.branches[support] & context.stances.branch_sets[step.after, support])


@kernel
def check_alone(step: StepRecord, context: StepContext, scratch: StepScratch) -> None:
    """Check a step of two limbs, and write the holds that its edge keeps into it.

    Holds are first looked at beside the other limb in its folds, and those that no fold serves
    beside the first line that serves one of them.
    """
    stances, world = context.stances, context.world
    support, known = 1 - step.limb, step.recheck != 0
    wanted = _wanted(step, context)
    if known:
        wanted &= step.kept[support]
    codes, line_branches = step.swings, step.line_branches
    step.kept[0] = step.kept[1] = step.swings = EMPTY
    step.line_branches = NONE
    before = stances.releases[step.before, step.limb]
    after = stances.releases[step.after, step.limb]
    if world.stop > 0 and (before.branches == 0 or after.branches == 0):
        return
    folds, rest = before.folds & after.folds, EMPTY
    for branch in range(BRANCHES):
        last_turn, code, leads = np.inf, UNSERVED, NO
        for flip in range(2):
            if not has(wanted, branch + BRANCHES * flip):
                continue
            if not set_line(step, context, branch, flip, scratch):
                continue
            line = scratch.line.line
            turn = line.last[support].q[5] - line.first[support].q[5]
            if abs(turn - last_turn) > SAME_LINE:
                # Otherwise flip 1 moves as flip 0 does.
                known_code = code_of(codes, branch) if known else OTHER_FOLD
                code = _fold_of(known_code, folds, step, context, scratch)
                leads = scratch.line.is_leader
            last_turn = turn
            if code >= 0:
                _keep(branch, flip, code, step)
            elif not leads and (not known or code_of(codes, branch) == ON_LINE):
                rest |= only(branch + BRANCHES * flip)
    if rest and world.stop > 0:
        _on_lines(rest, line_branches if known else NONE, step, context, scratch)


@kernel
def _keep(branch: int, flip: int, code: int, step: StepRecord) -> None:
    """Keep a hold, with the code of its swing."""
    support = 1 - step.limb
    if has_branch(step.kept[support], branch) and code_of(step.swings, branch) != code:
        code = OTHER_FOLD
    step.kept[support] |= only(branch + BRANCHES * flip)
    step.swings = with_code(step.swings, branch, code)


@kernel
def _stays_regular(limb: LimbModel, floor: float, scratch: LineScratch) -> bool:
    """Return whether `|det J|` of the leader is above a floor [m^3] at `PLACES` of its line."""
    first, last = scratch.line.first[limb.index].q, scratch.line.last[limb.index].q
    placed = scratch.placed[limb.index]
    for k in range(PLACES):
        s = (k + 0.5) / PLACES
        for j in range(6):
            placed.q[j] = first[j] + s * (last[j] - first[j])
        place_axes(limb, placed)
        if invert_jacobian(placed.joints, scratch.proof) < floor:
            return False
    return True


@kernel
def _fold_of(
    known: int, folds: int, step: StepRecord, context: StepContext, scratch: StepScratch
) -> int:
    """Return the first fold of a set beside which the line of the support is clear, or -1.

    `known` is the fold that is known to be clear of the map, or another code. If the line is not
    clear whatever the other limb does, `LineScratch.is_leader` is true.
    """
    robot, world, lines = context.robots[0], context.world, scratch.line
    support, moving, lines.is_leader = 1 - step.limb, step.limb, True
    floor = world.thresholds[0].floor * robot.characteristic_length**3
    if step.recheck == 0 and not _stays_regular(robot.limbs[support], floor, lines):
        return UNSERVED
    if world.stop == 0:
        return OTHER_FOLD
    lines.is_leader = False
    if step.recheck and known == ON_LINE:
        return UNSERVED
    if step.recheck and has(folds, known):
        _set_fold(known, robot, moving, lines)
        if is_clear(world.first, support, moving, robot, world, lines):
            return known
        if lines.is_leader:
            return UNSERVED
    if step.recheck == STORED_ALONE:
        return UNSERVED
    for fold in range(robot.fold_count):
        if has(folds, fold) and not (step.recheck and fold == known):
            _set_fold(fold, robot, moving, lines)
            if is_clear(0, support, moving, robot, world, lines):
                return fold
            if lines.is_leader:
                return UNSERVED
    return UNSERVED


@kernel
def _set_fold(fold: int, robot: RobotModel, moving: int, lines: LineScratch) -> None:
    """Set the limb that moves to stay in a fold."""
    folded(robot, fold, 0.0, lines.line.first[moving])
    folded(robot, fold, 0.0, lines.line.last[moving])


@kernel
def _on_lines(
    rest: int, known: int, step: StepRecord, context: StepContext, scratch: StepScratch
) -> None:
    """Keep those holds of a set that are clear beside the first line that serves one of them.

    `known` is the only pair of branches that is looked at, -1 for all.
    """
    lines, robot, world = scratch.line, context.robots[0], context.world
    support, moving = 1 - step.limb, step.limb
    first_layer = world.first if step.recheck else EMPTY
    count = lines_by_travel(step, context, scratch)
    for k in range(count if known >= 0 else min(count, TRIES)):
        pair = scratch.order[k]
        if known >= 0 and pair != known:
            continue
        start, end = lines.line.first[moving], lines.line.last[moving]
        first, last = scratch.q[0, pair // BRANCHES], scratch.q[1, pair % BRANCHES]
        line_end(first, last, end)
        for j in range(6):
            start.q[j] = first.q[j]
        for bit in range(2 * BRANCHES):
            if not has(rest, bit):
                continue
            branch, flip = bit % BRANCHES, bit // BRANCHES
            set_line(step, context, branch, flip, scratch)
            if is_clear(first_layer, support, moving, robot, world, lines):
                _keep(branch, flip, ON_LINE, step)
                step.line_branches = pair
            elif lines.is_leader:
                rest &= ~only(bit)
        if step.line_branches >= 0:
            return


@kernel
def is_clear(
    first_layer: int,
    support: int,
    moving: int,
    robot: RobotModel,
    world: WorldRecord,
    lines: LineScratch,
) -> bool:
    """Return whether the robot is clear along the line in `lines`, in layers of the world."""
    compared = lines.compared
    compared.boxes = only(support) | only(moving)
    compared.holding, compared.base, compared.resting = only(support), YES, NO
    compared.first, compared.placed = moving, EMPTY
    lines.surface.applies = False
    # Obstacles come first: where there are any, most lines are known to be clear of the map.
    for k in range(first_layer, world.stop):
        layer = world.stop - 1 - k + first_layer
        compared.itself = compared.boxes if layer == 0 else EMPTY
        compared.second = support if layer == 0 else NONE
        grid = world.boxes if layer == 0 else world.obstacles
        if check_line(robot, grid, world.thresholds[0].clearance, lines) != CLEAR:
            return False
    return True


@entry
def line_clear(support: int, moving: int, robots: Any, world: WorldRecord, lines: Any) -> bool:
    """Return whether a robot of two limbs is clear along a line, in a row of `LineScratch`."""
    return is_clear(world.first, support, moving, robots[0], world, lines[0])


@entry
def find_lines(start: int, stop: int, steps: Any, context: StepContext, scratch_rows: Any) -> None:
    """Check whether the support has a line on any hold, for steps from `start` to `stop` - 1.

    This is quick. `StepRecord.kept` is not empty if it has, and has no other meaning.
    """
    for k in range(start, stop):
        step, support = steps[k], 1 - steps[k].limb
        wanted = _wanted(step, context)
        step.kept[0] = step.kept[1] = EMPTY
        for hold_number in range(2 * BRANCHES):
            branch, flip = hold_number % BRANCHES, hold_number // BRANCHES
            asked = step.kept[support] == 0 and has(wanted, hold_number)
            if asked and set_line(step, context, branch, flip, scratch_rows[0]):
                step.kept[support] = wanted


@entry
def check_all_alone(
    start: int, stop: int, steps: Any, context: StepContext, scratch_rows: Any
) -> None:
    """Check the steps of two limbs from `start` to `stop` - 1, rows of `StepRecord`."""
    for k in range(start, stop):
        check_alone(steps[k], context, scratch_rows[0])
