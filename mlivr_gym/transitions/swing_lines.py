"""Lines in joint space along which a limb may swing from above one point to above another."""

from __future__ import annotations

from mlivr_gym.collisions.base_path import comes_first
from mlivr_gym.compiled.bit_sets import BRANCHES, has_branch
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.transitions.grasp_poses import lifted_branches, line_end
from mlivr_gym.transitions.records import StepContext, StepRecord, StepScratch

TRIES = 8
"""Maximum number of pairs of branches that are checked for a step."""

TIE = 1e-9
"""Difference of lengths up to which lines count as equally long [rad]: the first pair is used."""


@kernel
def lines_by_travel(step: StepRecord, context: StepContext, scratch: StepScratch) -> int:
    """List the lines along which a limb may swing, the shortest first; return how many.

    They are written into `scratch.order` as pairs of branches above both points. Lines of equal
    length, of which there are many where wrists are spherical, come in the order of their branches
    at the point that comes first: the step back takes the same line.
    """
    stances, robot, world = context.stances, context.robots[0], context.world
    limb = robot.limbs[step.limb]
    for side in range(2):
        s = step.after if side else step.before
        grasp = world.grasps[stances.points[s, step.limb]]
        branch_set = stances.releases[s, step.limb].branches
        base = stances.base[s]
        scratch.lifted[side] = lifted_branches(robot, limb, base, grasp, branch_set, side, scratch)
    start = world.grasps[stances.points[step.before, step.limb]].point
    end = world.grasps[stances.points[step.after, step.limb]].point
    back, order, travel = comes_first(vector(end), vector(start)), scratch.order, scratch.travel
    count = 0
    for first in range(BRANCHES):
        for second in range(BRANCHES):
            b0, b1 = (second, first) if back else (first, second)
            if has_branch(scratch.lifted[0], b0) and has_branch(scratch.lifted[1], b1):
                length = line_end(scratch.q[0, b0], scratch.q[1, b1], scratch.end)
                position = count
                while position > 0 and travel[position - 1] > length + TIE:
                    travel[position], order[position] = travel[position - 1], order[position - 1]
                    position -= 1
                travel[position], order[position] = length, BRANCHES * b0 + b1
                count += 1
    return count
