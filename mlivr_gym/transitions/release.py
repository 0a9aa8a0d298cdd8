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
from mlivr_gym.collisions.compared import begin_comparing, copy_pending
from mlivr_gym.collisions.distances import CLEAR, UNDECIDED
from mlivr_gym.collisions.intervals import WHOLE, check_around, check_line, check_pending
from mlivr_gym.collisions.joint_lines import place_limb
from mlivr_gym.compiled.bit_sets import (
    BRANCHES,
    EMPTY,
    EVERY,
    NO,
    NONE,
    both_flips,
    has,
    has_branch,
    only,
    without_branch,
)
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.inverse import SINGULAR_TOO
from mlivr_gym.kinematics.limb import Angles, angles_at
from mlivr_gym.kinematics.poses import Pose, vector
from mlivr_gym.transitions.departures import set_departure
from mlivr_gym.transitions.grasp_poses import folded, line_end
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
    _rest(limb, base, layer, scratch)
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
        for b in range(BRANCHES):
            if has_branch(rest, b):
                departs = set_departure(arm, base, grasp, b, robot.lift, scratch.departure)
                departs &= rest
                rest = without_branch(rest, b)
                if departs and _departs_clear(limb, grasp, context, layer, scratch):
                    rest |= departs
                    for j in range(6):
                        scratch.q[0, b].q[j] = scratch.departure.knots[scratch.departure.pieces].q[
                            j
                        ]
        free |= rest
        if rest and (layer == 0 or known_folds):
            _fold(limb, rest, context, layer, scratch, answer)
            if answer.branches:
                return
    answer.folds = 0
    if free:
        answer.branches = _connected_by_lines(limb, free, context, layer, scratch)


@kernel
def _rest(limb: int, base: Pose, layer: int, scratch: StepScratch) -> None:
    """Set the base to rest, and what a limb is compared with in a layer of the world."""
    line, compared = scratch.line.line, scratch.line.compared
    line.moves, line.follows = False, EMPTY
    for k in range(3):
        line.base.position[k] = base.position[k]
        for c in range(3):
            line.base.rotation[k, c] = base.rotation[k, c]
    inside = layer == 0
    compared.boxes, compared.holding, compared.base = only(limb), EMPTY, NO
    compared.placed = EMPTY
    compared.itself = only(limb) if inside else EMPTY
    compared.first, compared.second, compared.resting = limb, NONE, inside
    scratch.line.resting.count = 0


@kernel
def _departs_clear(
    limb: int, grasp: Grasp, context: StepContext, layer: int, scratch: StepScratch
) -> bool:
    """Return whether a limb keeps the clearance on the departure in `scratch`.

    All pieces are looked at together first, around the knot in their middle; what is undecided
    there is compared on fewer together, and at last on each.
    """
    robot, world = context.robots[0], context.world
    grid, line = world.boxes if layer == 0 else world.obstacles, scratch.line
    clearance, pieces = world.thresholds[0].clearance, scratch.departure.pieces
    set_grasp_surface(line.surface, vector(grasp.point), vector(grasp.normal))
    begin_comparing(robot, line.compared, line.pending)
    first, last, clear = 0, pieces, True
    while clear and first < pieces:
        _set_around(limb, first, last, scratch)
        copy_pending(line.pending, line.intervals[0])
        line.intervals[0].middle = line.intervals[0].half = 0.5
        if last == first + 1:
            clear = check_pending(robot, grid, clearance, line) == CLEAR
            first, last = last, pieces
            continue
        result = check_around(robot, grid, clearance, line)
        clear = result <= UNDECIDED
        if last - first == pieces:
            copy_pending(line.intervals[0], line.pending)
        if result == CLEAR:
            first, last = last, pieces
        else:
            last = (first + last) // 2
    line.surface.applies = False
    return clear


@kernel
def _set_around(limb: int, first: int, last: int, scratch: StepScratch) -> None:
    """Set a line whose ends are as far from its middle as knots of a departure, or to one piece."""
    knots, line = scratch.departure.knots, scratch.line.line
    middle = (first + last) // 2
    for j in range(6):
        a, b = knots[first].q[j], knots[last].q[j]
        if last > first + 1:
            q, away = knots[middle].q[j], 0.0
            for k in range(first, last + 1):
                away = max(away, abs(knots[k].q[j] - q))
            a, b = q - away, q + away
        line.first[limb].q[j], line.last[limb].q[j] = a, b


@kernel
def _line_clear(
    limb: int, start: Angles, end: Angles, context: StepContext, layer: int, scratch: StepScratch
) -> bool:
    """Return whether a limb keeps the clearance on a line while all else is at rest."""
    robot, world, line = context.robots[0], context.world, scratch.line.line
    for j in range(6):
        line.first[limb].q[j], line.last[limb].q[j] = start.q[j], end.q[j]
    grid = world.boxes if layer == 0 else world.obstacles
    clearance = world.thresholds[0].clearance
    return check_line(robot, grid, clearance, WHOLE, scratch.line) == CLEAR


@kernel
def _place_held(s: int, limb: int, b: int, context: StepContext, scratch: StepScratch) -> bool:
    """Place a limb that holds at a stance on a branch; return whether the branch exists."""
    stances, arm = context.stances, context.robots[0].limbs[limb]
    line, placed = scratch.line.line, scratch.line.placed[limb]
    flange = context.world.grasps[stances.points[s, limb]].flange
    q = line.first[limb].q
    if not angles_at(arm, stances.base[s], flange, b, SINGULAR_TOO, q):
        return False
    for j in range(6):
        line.last[limb].q[j] = q[j]
    place_limb(arm, line, 0.0, 0.0, EVERY, placed)
    return True


@kernel
def _add_resting(s: int, limb: int, context: StepContext, scratch: StepScratch) -> None:
    """Put a limb at rest on each branch on which it may hold at a stance."""
    stances, others = context.stances, scratch.line.resting
    for b in range(BRANCHES):
        held = has_branch(stances.branch_sets[s, limb], b)
        if held and _place_held(s, limb, b, context, scratch):
            others.limb[others.count] = limb
            shapes, placed = others.shapes[others.count], scratch.line.placed[limb].in_body
            for c in range(context.robots[0].limbs[limb].capsule_count):
                for e in range(2):
                    shapes.motion[c, e] = 0.0
                    for k in range(3):
                        shapes.ends[c, e, k] = placed.ends[c, e, k]
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
    arm, ends = context.robots[0].limbs[limb], scratch.line.placed[limb].in_body.ends
    for b in range(0, BRANCHES, 2):
        if not (has_branch(branch_set, b) and has_branch(branch_set, b + 1)):
            continue
        lower = 0.0
        for side in range(2):
            height = 0.0
            if _place_held(s, limb, b + side, context, scratch):
                for c in range(arm.capsule_count):
                    height += ends[c, 0, 2] + ends[c, 1, 2]
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
    robot, recheck = context.robots[0], layer > 0
    for root in range(robot.fold_count):
        if recheck and answer.root != root:
            continue
        changeable = only(root)
        folded(robot, root, 0.0, scratch.start)
        for other in range(robot.fold_count):
            if other == root or (recheck and not has(answer.folds, other)):
                continue
            folded(robot, other, 0.0, scratch.end)
            if _line_clear(limb, scratch.start, scratch.end, context, layer, scratch):
                changeable |= only(other)
        reachable_folds = EMPTY
        for b in range(BRANCHES):
            if not has_branch(free, b):
                continue
            q = scratch.q[0, b]
            for fold in range(robot.fold_count):
                if not has(changeable, fold) or (recheck and answer.via[b] != fold):
                    continue
                folded(robot, fold, q.q[5], scratch.end)
                if _line_clear(limb, q, scratch.end, context, layer, scratch):
                    reachable_folds |= both_flips(b)
                    answer.via[b] = fold
                    break
        if reachable_folds & free:
            answer.branches, answer.folds, answer.root = reachable_folds & free, changeable, root
            return


@kernel
def _connected_by_lines(
    limb: int, free: int, context: StepContext, layer: int, scratch: StepScratch
) -> int:
    """Return the largest set of branches of `free` between which a limb can change along lines.

    Among obstacles it is the first branch alone, since the lines were not kept to check them again.
    """
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
            if _line_clear(limb, start, scratch.end, context, layer, scratch):
                gone = group[b]
                for c in range(BRANCHES):
                    if group[c] == gone:
                        group[c] = group[a]
    best, most = EMPTY, 0
    for a in range(BRANCHES):
        reached, count = EMPTY, 0
        for b in range(BRANCHES):
            if group[b] == group[a] and has_branch(free, b):
                reached |= both_flips(b)
                count += 1
        if count > most and has_branch(free, a):
            best, most = reached & free, count
    return best
