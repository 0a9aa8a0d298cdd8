"""Compiled checks of direct swings, for steps that a folded limb cannot make.

Where a limb cannot be carried folded, the line in joint space from above one point to above the
other is looked at while the base moves, for pairs of branches in order of travel. Both branches
come from the masks of their stances, among whose branches the limb can change at rest
(`release_kernels.release`): one pair that is free serves them all, and the search need not know
which it was.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.swept_swing import swing_free
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.transitions.grasp_poses import flange_at, lifted_branches, line_end

TRIES = 8
"""Pairs of branches that are looked at for one base path."""


@kernel
def lifted_at(
    limb, mask, point, normal, rail, tool_length, lift, position, rotation, mount_rotations,
    mount_positions, lengths, limits, q
):  # fmt: skip
    """Joint angles of a limb that has departed from a point at a stance, see `grasp_kernels.lifted_branches`."""
    p, x, z, away = floats(3), floats(3), floats(3), floats(3)
    flange_at(
        point, normal, rail, tool_length, position, rotation, mount_rotations[limb],
        mount_positions[limb], p, x, z, away
    )  # fmt: skip
    return lifted_branches(limb, mask, p, x, z, away, lift, lengths, limits, q)


@kernel
def pairs_by_travel(mask0, q0, mask1, q1, limits, order):
    """Pairs of branches of two masks with angles `q0` and `q1` (8, 6), `8 * b0 + b1`, shortest line first.

    Written into `order`, shape (64,); returns their number.
    """
    travel, end, count = floats(64), floats(6), 0
    for b0 in range(8):
        for b1 in range(8):
            if mask0 & (0x0101 << b0) and mask1 & (0x0101 << b1):
                length = line_end(q0[b0], q1[b1], limits, end)
                if length < np.inf:
                    place = count
                    while place > 0 and travel[place - 1] > length:
                        travel[place], order[place] = travel[place - 1], order[place - 1]
                        place -= 1
                    travel[place], order[place] = length, 8 * b0 + b1
                    count += 1
    return count


@kernel
def line_free(
    limb, start, goal, path, limits, mount_rotations, mount_positions, lengths, collision_model, inside, end
):  # fmt: skip
    """Whether a limb can go from `start` to `goal` (6,) on a line while the base follows a path; where it ends, into `end`."""
    if line_end(start, goal, limits, end) == np.inf:
        return False
    shapes, _, _, fixed, world, clearance, body = collision_model
    none = floats(0, len(shapes[0]), 2, 3)
    found = swing_free(
        limb, path, 0.0, 1.0, start, end, lengths, mount_rotations[limb], mount_positions[limb],
        none, shapes, fixed, world,
        clearance, inside, body,
    )  # fmt: skip
    return found == CLEAR
