"""The check of a step, for any number of limbs (compiled).

Where a limb cannot stay folded while the base moves, see `release`, the line in joint space from
above one point to above the other is checked instead, for pairs of branches in order of travel.
Both branches come from those on which the limb can be released at the two stances, among which it
can change at rest: one pair that is free serves them all, and the search need not know which it
was.
"""

from __future__ import annotations

from typing import Any

from mlivr_gym.collisions.limb_shapes import Robot
from mlivr_gym.compiled.bit_sets import (
    ALL,
    BRANCHES,
    EMPTY,
    NONE,
    any_flip,
    has,
    has_branch,
    only,
)
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, set_path
from mlivr_gym.kinematics.holding import hold_mask
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.transitions.grasp_poses import folded, lifted_branches, line_end
from mlivr_gym.transitions.holds import BOTH, MOVER, STANDING, hold_apart
from mlivr_gym.transitions.motions import (
    follow_path,
    swing_clear,
)
from mlivr_gym.transitions.records import Scene, Step, StepRoom

TRIES = 8
"""Pairs of branches that are checked for one base path."""

TIE = 1e-9
"""Lines whose lengths differ by this or less count as equal [rad]: the first pair is taken."""


@entry
def hold_all(start: int, stop: int, steps: Any, scene: Scene, rooms: Any) -> None:
    """Whether every limb that holds can follow some base path, for steps from `start` to `stop`.

    This is quick; `Step.kept` is then not empty, and says no more.
    """
    robot = scene.robots[0]
    for k in range(start, stop):
        step, room = steps[k], rooms[0]
        forget(step, robot, room)
        held = (step.limb + 1) % robot.limb_count
        for kind in range(2):
            if all_hold(kind, step, scene, room):
                step.kept[held] = ALL


@entry
def check_all(start: int, stop: int, steps: Any, scene: Scene, rooms: Any) -> None:
    """Check steps from `start` to `stop`.

    Args:
        start: First row of `steps`.
        stop: One past the last.
        steps: Rows of `Step`, shape (k,); what is found is written into them.
        scene: The stances before and after them, with what can be released there, and what is
            checked.
        rooms: A row of `StepRoom`, shape (1,).
    """
    for k in range(start, stop):
        check(steps[k], scene, rooms[0])


@kernel
def forget(step: Step, robot: Robot, room: StepRoom) -> None:
    """Start with no answer, and with no limb at rest."""
    room.sweep.resting.count = 0
    for kind in range(2):
        # Of an edge that is known it is known on which branches limbs can hold on either path.
        room.holds_known[kind] = step.again
        for i in range(robot.limb_count):
            on_path = step.on_arc if kind == ARC else ~step.on_arc
            room.holds[kind, i] = step.kept[i] & step.wanted[i] & on_path
    for i in range(robot.limb_count):
        step.kept[i], room.now[i] = 0, ALL
    step.on_arc = 0
    if not step.again:
        step.kind, step.pair = STRAIGHT, -1
        step.folds[0] = step.folds[1] = -1


@kernel
def all_hold(kind: int, step: Step, scene: Scene, room: StepRoom) -> bool:
    """Work out `room.holds` for a kind of path, once; whether all limbs that hold can follow it."""
    stances, robot, world = scene.stances, scene.robots[0], scene.world
    if not room.holds_known[kind]:
        room.holds_known[kind] = True
        set_step_path(kind, step, scene, room)
        floor = world.thresholds[0].floor * robot.characteristic_length**3
        able = True
        for i in range(robot.limb_count):
            room.holds[kind, i] = 0
            if i != step.limb and able:
                mask = step.wanted[i]
                if not step.given:
                    mask &= stances.mask[step.after, i]
                flange = world.grasps[stances.points[step.after, i]].flange
                limb, holding = robot.limbs[i], room.holding
                room.holds[kind, i] = hold_mask(limb, flange, room.path, floor, mask, holding)
                able = room.holds[kind, i] != 0
    return _each_holds(kind, step, robot, room)


@kernel
def _each_holds(kind: int, step: Step, robot: Robot, room: StepRoom) -> bool:
    """Whether every limb that holds has one of the branches `now` on which it can follow a path."""
    for i in range(robot.limb_count):
        if i != step.limb and room.holds[kind, i] & room.now[i] == 0:
            return False
    return True


@kernel
def set_step_path(kind: int, step: Step, scene: Scene, room: StepRoom) -> None:
    """Set up the base path of a step, for the sweeps too."""
    stances = scene.stances
    before, after = stances.base[step.before], stances.base[step.after]
    set_path(room.path, before, after, kind, vector(step.pivot))


@part
def check(step: Step, scene: Scene, room: StepRoom) -> None:
    """Check a step; what is found is written into it.

    Of an edge that is known already its motion alone is checked, on the branches it keeps.
    """
    stances, robot, world = scene.stances, scene.robots[0], scene.world
    on_line = step.again and step.pair >= 0
    forget(step, robot, room)
    able = False
    for kind in range(2):
        able = able or all_hold(kind, step, scene, room)
    if not able:
        return
    if world.stop == 0:
        _folded(step, scene, EMPTY, room)
        return
    before = stances.released[step.before, step.limb]
    after = stances.released[step.after, step.limb]
    if before.branches == 0 or after.branches == 0:
        return
    folds = before.folds & after.folds
    stages = 1 if step.again or step.given or robot.limb_count > 2 else 3
    for stage in range(stages):
        if not _any_kept(step, robot) and not on_line:
            if stages > 1:
                _set_stage(stage, step, scene, room)
            if folds:
                _folded(step, scene, folds, room)
    if (on_line or not step.again) and not _any_kept(step, robot):
        for i in range(robot.limb_count):
            room.now[i] = ALL
        _on_lines(step, scene, room)


@kernel
def _any_kept(step: Step, robot: Robot) -> bool:
    """Whether limbs keep a branch."""
    kept = EMPTY
    for i in range(robot.limb_count):
        kept |= step.kept[i]
    return bool(kept != 0)


@kernel
def _set_stage(stage: int, step: Step, scene: Scene, room: StepRoom) -> None:
    """Which branches of the limb that holds alone are looked at, in three stages.

    First those on which it can be released before the step and after it, as one must be that
    grasped just before or moves just after; then those where only one is true, then the others.
    Where more limbs hold all branches are looked at at once: a limb that neither grasped just
    before nor moves just after may be on any.
    """
    stances, robot = scene.stances, scene.robots[0]
    for i in range(robot.limb_count):
        # What is clear with one flip is clear with the other.
        first = any_flip(stances.released[step.before, i].branches)
        second = any_flip(stances.released[step.after, i].branches)
        if stage == 0:
            room.now[i] = first & second
        elif stage == 1:
            room.now[i] = (first | second) & ~(first & second)
        else:
            room.now[i] = ALL & ~(first | second)


@kernel
def _folded(step: Step, scene: Scene, folds: int, room: StepRoom) -> None:
    """Branches that limbs that hold keep while the other moves folded, in one of some folds.

    Without collisions there are no folds. One limb that holds may take some branches along the line
    and others along the arc.
    """
    robot, world = scene.robots[0], scene.world
    alone = robot.limb_count == 2
    for kind in range(2):
        for i in range(robot.limb_count):
            if alone:
                room.now[i] &= ~step.kept[i]
        if not all_hold(kind, step, scene, room):
            continue
        for i in range(robot.limb_count):
            room.standing[i] = room.holds[kind, i] & room.now[i]
        fold = NONE
        if world.stop > 0:
            set_step_path(kind, step, scene, room)
            follow_path(room.sweep, room.path, 0.0, 1.0)
            some = folds & only(step.folds[kind]) if step.again else folds
            fold = _stays_folded(step, scene, some, room)
            if fold < 0 or not hold_apart(BOTH, step, scene, room.standing, room):
                continue
        step.folds[kind] = fold
        _keep(kind, step, robot, room)
        if step.given or not alone:
            return


@kernel
def _keep(kind: int, step: Step, robot: Robot, room: StepRoom) -> None:
    """Keep the branches that are left in `room.standing`."""
    if not _any_kept(step, robot):
        step.kind = kind
    for i in range(robot.limb_count):
        if i != step.limb:
            step.kept[i] |= room.standing[i]
            if kind == ARC:
                step.on_arc |= room.standing[i]


@part
def _stays_folded(step: Step, scene: Scene, folds: int, room: StepRoom) -> int:
    """The first fold of a set in which the limb can stay along the base path, -1 if none serves.

    Another fold might serve the obstacles; the first that serves the map must serve all.
    """
    robot, world = scene.robots[0], scene.world
    fold = NONE
    for layer in range(world.first, world.stop):
        found = NONE
        for k in range(robot.fold_count):
            if found < 0 and has(folds, k):
                folded(robot, k, 0.0, room.start)
                folded(robot, k, 0.0, room.end)
                if swing_clear(robot, world, layer, step.limb, room.start, room.end, room.sweep):
                    found = k
        if found < 0:
            return -1
        fold, folds = found, only(found)
    return fold


@kernel
def _on_lines(step: Step, scene: Scene, room: StepRoom) -> None:
    """Branches that limbs that hold keep while the other swings along a line in joint space."""
    robot = scene.robots[0]
    count = lines_by_travel(step, scene, room)
    for kind in range(2):
        if not all_hold(kind, step, scene, room):
            continue
        for i in range(robot.limb_count):
            room.standing[i] = room.holds[kind, i] & room.now[i]
        set_step_path(kind, step, scene, room)
        follow_path(room.sweep, room.path, 0.0, 1.0)
        stood = False
        for k in range(count if step.again else min(count, TRIES)):
            pair = room.order[k]
            if (step.again and pair != step.pair) or not line_clear(pair, step, scene, room):
                continue
            if not stood:
                # Whether the limbs that hold can stay does not depend on the swing, but for the
                # limb that makes it.
                stood = True
                if not hold_apart(STANDING, step, scene, room.standing, room):
                    break
            for i in range(robot.limb_count):
                room.now_on_line[i] = room.standing[i]
            if hold_apart(MOVER, step, scene, room.now_on_line, room):
                for i in range(robot.limb_count):
                    room.standing[i] = room.now_on_line[i]
                step.pair = pair
                _keep(kind, step, robot, room)
                return


@kernel
def lines_by_travel(step: Step, scene: Scene, room: StepRoom) -> int:
    """The lines along which a limb may swing, see `pairs_by_travel`, and their number."""
    stances, robot, world = scene.stances, scene.robots[0], scene.world
    limb = robot.limbs[step.limb]
    for side in range(2):
        s = step.after if side else step.before
        grasp = world.grasps[stances.points[s, step.limb]]
        mask = stances.released[s, step.limb].branches
        base = stances.base[s]
        room.lifted[side] = lifted_branches(robot, limb, base, grasp, mask, side, room)
    return pairs_by_travel(room)


@kernel
def pairs_by_travel(room: StepRoom) -> int:
    """Pairs of branches above both points, those with the shortest line first, into `room.order`.

    Returns the number of pairs.
    """
    order, travel, count = room.order, room.travel, 0
    for b0 in range(BRANCHES):
        for b1 in range(BRANCHES):
            if has_branch(room.lifted[0], b0) and has_branch(room.lifted[1], b1):
                length = line_end(room.q[0, b0], room.q[1, b1], room.end)
                place = count
                while place > 0 and travel[place - 1] > length + TIE:
                    travel[place], order[place] = travel[place - 1], order[place - 1]
                    place -= 1
                travel[place], order[place] = length, BRANCHES * b0 + b1
                count += 1
    return count


@part
def line_clear(pair: int, step: Step, scene: Scene, room: StepRoom) -> bool:
    """Whether the limb can swing along the line between a pair of branches, along the base path."""
    robot, world = scene.robots[0], scene.world
    first, last = room.q[0, pair // BRANCHES], room.q[1, pair % BRANCHES]
    line_end(first, last, room.end)
    for joint in range(6):
        room.start.q[joint] = first.q[joint]
    for layer in range(world.first, world.stop):
        if not swing_clear(robot, world, layer, step.limb, room.start, room.end, room.sweep):
            return False
    return True
