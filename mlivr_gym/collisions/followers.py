"""Limbs that hold and follow a base that moves straight, with their branches (compiled)."""

from __future__ import annotations

from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.intervals import check_line
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.compiled.bit_sets import (
    BRANCHES,
    EMPTY,
    NO,
    NONE,
    has,
    has_branch,
    only,
    without_branch,
)
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.poses import Pose


@kernel
def set_follower(i: int, flange: Pose, lines: LineScratch) -> None:
    """Let limb `i` hold a flange pose in the world while the base moves straight."""
    line = lines.line
    held = line.held[i]
    line.moves, line.follows = True, line.follows | only(i)
    for k in range(3):
        held.position[k] = flange.position[k]
        for c in range(3):
            held.rotation[k, c] = flange.rotation[k, c]
    for b in range(BRANCHES):
        forget(i, b, lines)


@kernel
def forget(i: int, branch: int, lines: LineScratch) -> None:
    """Forget where a limb is along the way, on a branch if it holds."""
    known = lines.known[i * BRANCHES + branch]
    for k in range(len(known)):
        known[k] = 0


@kernel
def choose_branch(i: int, branch: int, branch_set: int, lines: LineScratch) -> None:
    """Let a limb follow on a branch, with the flips that a branch set has of it."""
    line = lines.line
    line.branch[i], line.flips[i] = branch, EMPTY
    for flip in range(2):
        if has(branch_set, branch + BRANCHES * flip):
            line.flips[i] |= only(flip)


@kernel
def with_flips(is_kept: bool, i: int, branch_set: int, lines: LineScratch) -> int:
    """Return a branch set with the flips that a check has left of the chosen branch, if any."""
    branch = lines.line.branch[i]
    branch_set = without_branch(branch_set, branch)
    for flip in range(2):
        if is_kept and has(lines.line.flips[i], flip):
            branch_set |= only(branch + BRANCHES * flip)
    return branch_set


@kernel
def compare_with(
    lines: LineScratch, boxes: int, base: bool, itself: int, pair: tuple[int, int]
) -> None:
    """Select what is compared: sets of limbs with boxes and with themselves, and two limbs."""
    compared = lines.compared
    compared.boxes, compared.base, compared.itself = boxes, base, itself
    compared.holding, compared.placed, compared.resting = lines.line.follows, EMPTY, NO
    compared.first, compared.second = pair


@kernel
def followed_branches(
    i: int, branch_set: int, before: int, robot: RobotModel, grid: BoxGrid, lines: LineScratch
) -> int:
    """Return the branches and flips of a set on which a limb follows; see `check_line`.

    What it touches does not count.
    """
    for b in range(BRANCHES):
        if has_branch(branch_set, b):
            choose_branch(i, b, branch_set, lines)
            compare_with(lines, EMPTY, NO, EMPTY, (NONE, NONE))
            lines.compared.placed = only(i)
            follows = check_line(robot, grid, 0.0, before, lines) == CLEAR
            branch_set = with_flips(follows, i, branch_set, lines)
    return branch_set
