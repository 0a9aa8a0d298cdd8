"""Compiled steps of a two-limb stance graph: where a limb can let go, and what each step leaves, worked out on demand.

`edges` are always `PairGraph.edges`, the graph in the kernels' form.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.swept_hold import BOTH
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats, integers
from mlivr_gym.kinematics.holding import hold_mask
from mlivr_gym.transitions.grasp_poses import place_branches
from mlivr_gym.transitions.line_swings import TRIES, lifted_at, line_free, pairs_by_travel
from mlivr_gym.transitions.release import FOLDS_AT, folded_swing, holding, release
from mlivr_gym.transitions.rule import can_release, kept_on_edge, mask_of_grasp

KNOWN = 1 << 16
"""Bit of an edge entry: the entry is filled. Below it are the branches and flips on which the limb can hold."""
ARC_BITS, FOLD_BITS = 17, 33
"""First bits of the branches and flips that need the arc, and of the folds on the line and on the arc (2 bits each)."""
LINE, PAIR_BITS = 1 << 37, 38
"""Bit of an entry whose step only a direct swing makes, and first bits of its branches after and before the step (3 each)."""


@kernel
def ensure_released(s, limb, edges):
    """Work out, once, on which branches a limb can let go at a stance: its answer of `release`, 0 if on none."""
    points, position, rotation, mask = edges[0], edges[5], edges[6], edges[7]
    mount_rotations, mount_positions, lengths, pivots, limits = (
        edges[8],
        edges[9],
        edges[10],
        edges[13],
        edges[15],
    )
    _, ready, released, normals, rails, tool_length, lift, folds, collision_model = edges[17]
    overlay, _, near, mask0, ready0, released0, _, obstacles = edges[18]
    if ready[s, limb]:
        return
    point, other, grasp = points[s, limb], 1 - limb, points[s, 1 - limb]
    placed = floats(8, len(collision_model[0][0]), 2, 3)
    with_robot = (
        len(mask) > 0
    )  # a variable: with literals the kernels would be compiled once for each value
    for layer in range(2):
        if layer == 0:
            if ready0[s, limb]:
                continue
            wanted, before = mask0[s, limb], np.int64(-1)
            count = place_branches(
                other, mask0[s, other], pivots[grasp], normals[grasp], tool_length, position[s],
                rotation[s], mount_rotations,
                mount_positions, lengths, collision_model[0], 0, placed,
            )  # fmt: skip
        else:
            if not overlay:
                continue
            before, count = released0[s, limb], 0
            wanted = before & mask[s, limb] if mask[s, other] else np.int64(0)
        answer = np.int64(0)
        if layer == 1 and wanted and not near[s]:
            answer = before
        elif wanted:
            answer = release(
                limb, wanted, pivots[point], normals[point], rails[point], tool_length, lift,
                position[s], rotation[s],
                placed[:count], folds, limits, mount_rotations, mount_positions, lengths,
                collision_model if layer == 0 else obstacles, with_robot if layer == 0 else not with_robot, before,
            )  # fmt: skip
        if layer == 0:
            released0[s, limb], ready0[s, limb] = answer, True
        else:
            released[s, limb] = answer
    ready[s, limb] = True


@kernel
def edge_entry(held, s0, s1, edges):
    """Branches that limb `held` can keep on the step from stance `s0` to `s1`, looked up or worked out.

    The limb that moves must be on one of the branches on which it can let go, see `ensure_released`, and
    lands on all on which it can let go again. Both directions of the step are entered.

    Args:
        held: The limb that holds.
        s0: Stance before the step.
        s1: Stance after it.
        edges: `PairGraph.edges`.

    Returns:
        The entry; see `KNOWN`, `ARC_BITS`, `FOLD_BITS`, `LINE` and `PAIR_BITS`.
    """
    points, local, degree, offset, table, _, _, mask = edges[:8]
    collide, released, collision_model = edges[17][0], edges[17][2], edges[17][8]
    _, boxes, near, mask0, _, released0, table0, obstacles = edges[18]
    point, mover = points[s0, held], 1 - held
    here = offset[held, point] + local[held, s0] * degree[held, point] + local[held, s1]
    there = offset[held, point] + local[held, s1] * degree[held, point] + local[held, s0]
    if table[here] & KNOWN:
        return table[here]
    back = collide and s0 > s1
    if back:
        # Always from the same end, since which swing is found first may depend on it.
        s0, s1, here, there = s1, s0, there, here
    for limb in range(2):
        ensure_released(s0, limb, edges)
        ensure_released(s1, limb, edges)
    with_robot = len(table) > 0
    if not table0[here] & KNOWN:
        wanted, entry = mask0[s0, held] & mask0[s1, held], np.int64(KNOWN)
        if released0[s0, mover] & 0xFFFF and released0[s1, mover] & 0xFFFF:
            folds_at_both = (released0[s0, mover] & released0[s1, mover]) >> FOLDS_AT & 15
            # First what serves a limb that landed before the step and lets go after it, then what
            # serves one of the two.
            both = wanted & released0[s0, held] & released0[s1, held]
            some = wanted & (released0[s0, held] | released0[s1, held]) & ~both
            for turn in range(3):
                now = both if turn == 0 else some if turn == 1 else wanted & ~(both | some)
                if now and not entry & 0xFFFF:
                    entry = _folded_entry(
                        held,
                        s0,
                        s1,
                        now,
                        now & 0,
                        folds_at_both,
                        folds_at_both,
                        edges,
                        collision_model,
                        with_robot,
                    )
            if collide and wanted and not entry & 0xFFFF:
                entry = _line_entry(held, s0, s1, wanted, np.int64(0), edges, collision_model)
        table0[here], table0[there] = entry, turned(entry)
    if boxes:
        entry = table0[here]
        kept = entry & mask[s0, held] & mask[s1, held]
        if not released[s0, mover] & 0xFFFF or not released[s1, mover] & 0xFFFF:
            kept &= 0
        arc = entry >> ARC_BITS & kept
        kept &= ~arc
        folds_at_both = (released[s0, mover] & released[s1, mover]) >> FOLDS_AT & 15
        if not (near[s0] or near[s1]):
            entry = entry & ~np.int64(0xFFFF) | kept | arc
        elif entry & LINE:
            entry = _line_entry(held, s0, s1, kept | arc, entry, edges, obstacles)
        else:
            entry = _folded_entry(
                held, s0, s1, kept, arc, folds_at_both & 1 << (entry >> FOLD_BITS & 3),
                folds_at_both & 1 << (entry >> (FOLD_BITS + 2) & 3), edges, obstacles, not with_robot,
            )  # fmt: skip
        table[here], table[there] = entry, turned(entry)
    return table[there] if back else table[here]


@kernel
def turned(entry):
    """The entry of the same step in the other direction."""
    if not entry & LINE:
        return entry
    pair = entry >> PAIR_BITS & 63
    return entry & ~(np.int64(63) << PAIR_BITS) | ((pair & 7) << 3 | pair >> 3) << PAIR_BITS


@kernel
def _folded_entry(held, s0, s1, wanted, arc, line_folds, arc_folds, edges, collision_model, inside):
    """An edge entry from the branches to look at on the line and on the arc and the folds to look at.

    With `inside` the limb that holds must also be shown to keep its branch, and what the line
    leaves of `wanted` is tried on the arc.
    """
    points, position, rotation = edges[0], edges[5], edges[6]
    mount_rotations, mount_positions, lengths, grips, tools, pivots = edges[8:14]
    determinant_floor, limits, full_turn = edges[14:17]
    collide, folds = edges[17][0], edges[17][7]
    point, mover = points[s0, held], 1 - held
    entry, folded = np.int64(KNOWN), floats(6)
    for kind in range(2):
        rest = wanted if kind == 0 else arc
        if collide and not (line_folds if kind == 0 else arc_folds):
            continue
        if inside:
            rest = wanted & ~entry
            if rest:
                rest = hold_mask(
                    kind, pivots[point], grips[point], tools[point], position[s0], rotation[s0],
                    position[s1], rotation[s1], mount_rotations[held], mount_positions[held],
                    lengths,
                    determinant_floor, limits, full_turn, rest,
                )  # fmt: skip
        if rest and collide:
            path = (position[s0], rotation[s0], position[s1], rotation[s1], kind, pivots[point])
            fold = folded_swing(
                mover, line_folds if kind == 0 else arc_folds, path, folds, mount_rotations,
                mount_positions, lengths, collision_model,
                inside, folded,
            )  # fmt: skip
            if fold < 0:
                continue
            rest = holding(
                held, rest, grips[point], tools[point], path, mover, folded, folded,
                mount_rotations, mount_positions, lengths, collision_model, inside, BOTH,
            )  # fmt: skip
            entry |= np.int64(fold) << (FOLD_BITS + 2 * kind)
        entry |= rest | (rest << ARC_BITS if kind == 1 else 0)
    return entry


@kernel
def _line_entry(held, s0, s1, wanted, before, edges, collision_model):
    """An entry for a direct swing, on the branches to look at.

    `before` is the entry in the world without obstacles, whose swing alone is looked at, or 0.
    """
    points, position, rotation, releasable = (
        edges[0],
        edges[5],
        edges[6],
        edges[17][2] if before else edges[18][5],
    )
    mount_rotations, mount_positions, lengths, grips, tools, pivots = edges[8:14]
    determinant_floor, limits, full_turn = edges[14:17]
    _, _, _, normals, rails, tool_length, lift, _, _ = edges[17]
    point, mover = points[s0, held], 1 - held
    q, end, order = floats(2, 8, 6), floats(6), integers(64)
    masks = integers(2)
    for side in range(2):
        s = s1 if side else s0
        grasp = points[s, mover]
        masks[side] = lifted_at(
            mover, releasable[s, mover] & 0xFFFF, pivots[grasp], normals[grasp], rails[grasp],
            tool_length, lift, position[s], rotation[s],
            mount_rotations, mount_positions, lengths, limits, q[side],
        )  # fmt: skip
    count = pairs_by_travel(masks[0], q[0], masks[1], q[1], limits, order)
    for kind in range(2):
        rest = wanted
        if before:
            if (before >> ARC_BITS & 0xFFFF > 0) != (kind == 1):
                continue
        else:
            rest = hold_mask(
                kind, pivots[point], grips[point], tools[point], position[s0], rotation[s0],
                position[s1], rotation[s1], mount_rotations[held], mount_positions[held], lengths,
                determinant_floor, limits, full_turn, rest,
            )  # fmt: skip
        if not rest:
            continue
        path = (position[s0], rotation[s0], position[s1], rotation[s1], kind, pivots[point])
        for k in range(count if before else min(count, TRIES)):
            pair = order[k]
            if before and before >> PAIR_BITS & 63 != pair:
                continue
            start = q[0, pair >> 3]
            if line_free(
                mover, start, q[1, pair & 7], path, limits, mount_rotations, mount_positions,
                lengths, collision_model, before == 0, end
            ):  # fmt: skip
                kept = holding(
                    held, rest, grips[point], tools[point], path, mover, start, end,
                    mount_rotations, mount_positions, lengths, collision_model, before == 0, BOTH,
                )  # fmt: skip
                if kept:
                    return (
                        KNOWN
                        | LINE
                        | np.int64(pair) << PAIR_BITS
                        | kept
                        | (kept << ARC_BITS if kind == 1 else 0)
                    )
    return np.int64(KNOWN)


@kernel
def fill_row(held, s0, row, out, edges):
    """Branches and flips of `edge_entry` from `s0` to each stance of `row`, into `out`; `edges` are its further arguments."""
    for k in range(len(row)):
        out[k] = edge_entry(held, s0, row[k], edges) & 0xFFFF


@kernel
def pair_successors(s, mask0, mask1, check, rows, row_start, limb, stance, masks, edges):
    """Steps that leave stance `s`, by the rule of `transitions.rule`; returns their number k.

    Args:
        s: Stance index.
        mask0: Branches that limb 0 may be on.
        mask1: Branches that limb 1 may be on.
        check: Whether steps are checked.
        rows: `PairGraph.rows`.
        row_start: `PairGraph.row_start`.
        limb: Limb that moves on each step, written.
        stance: Stance reached, written.
        masks: Masks after the step, shape (k, 2), written.
        edges: `PairGraph.edges`.
    """
    points, mask, released = edges[0], edges[7], edges[17][2]
    count = 0
    for moving in range(2):
        held = 1 - moving
        of_held, of_moving = (mask1, mask0) if held else (mask0, mask1)
        if check:
            ensure_released(s, moving, edges)
            if not can_release(of_moving, released[s, moving]):
                continue
        point = points[s, held]
        for k in range(row_start[held, point], row_start[held, point + 1]):
            s2 = rows[held, k]
            if s2 == s:
                continue
            kept, grasped = kept_on_edge(of_held, mask[s2, held]), mask[s2, moving]
            if check and kept:
                kept = kept_on_edge(kept, edge_entry(held, s, s2, edges))
                grasped = mask_of_grasp(released[s2, moving])
            if kept and grasped:
                limb[count], stance[count] = moving, s2
                masks[count, held], masks[count, moving] = kept, grasped
                count += 1
    return count


@kernel
def longest_step(start, stop, held, rows, row_start, position, out):
    """Largest squared base displacement [m^2] within each row from `start` to `stop`, into `out`."""
    for point in range(start, stop):
        for i in range(row_start[held, point], row_start[held, point + 1]):
            for j in range(row_start[held, point], i):
                a, b = rows[held, i], rows[held, j]
                square = 0.0
                for axis in range(3):
                    square += (position[a, axis] - position[b, axis]) ** 2
                out[point] = max(out[point], square)


@kernel
def fill_points(start, stop, held, rows, row_start, edges):
    """Work out every step of the rows from `start` to `stop`."""
    for point in range(start, stop):
        for i in range(row_start[held, point], row_start[held, point + 1]):
            for j in range(row_start[held, point], i):
                edge_entry(held, rows[held, i], rows[held, j], edges)
