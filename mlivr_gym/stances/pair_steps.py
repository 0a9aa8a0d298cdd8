"""Steps of a two-limb stance graph, worked out on demand (compiled).

On which branches a limb can be released at a stance, and which the other limb keeps on each step.
`edges` are always `PairGraph.edges`, the graph in the kernels' form.
"""

from __future__ import annotations

from typing import Any

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.swept_hold import BOTH
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats, integers
from mlivr_gym.kinematics.holding import hold_mask
from mlivr_gym.transitions.grasp_poses import place_branches
from mlivr_gym.transitions.line_swings import TRIES, lifted_at, line_free, pairs_by_travel
from mlivr_gym.transitions.release import FOLDS_AT, folded_swing, holding, release
from mlivr_gym.transitions.rule import BRANCH_BITS, can_release, kept_on_edge, mask_of_grasp

KNOWN = 1 << 16
"""Bit of an edge entry that is filled; below it the branches and flips on which a limb can hold."""
ARC_BITS, FOLD_BITS = 17, 33
"""First bits of the branches and flips that need the arc, and of the folds, 2 on each path."""
LINE, PAIR_BITS = 1 << 37, 38
"""Bit of an entry whose limb swings along a line, and first bits of its branches.

Three bits for the branch after the step, then three for the one before it.
"""


@kernel
def ensure_released(s: int, limb: int, edges: tuple[Any, ...]) -> None:
    """Work out, once, the answer of `release` for a limb at stance `s`."""
    points, position, rotation, mask = edges[0], edges[5], edges[6], edges[7]
    mount_rotations, mount_positions, lengths = edges[8], edges[9], edges[10]
    pivots, limits = edges[13], edges[15]
    _, ready, released, normals, rails, tool_length, lift, folds, collision_model = edges[17]
    overlay, _, close, mask0, ready0, released0, _, obstacles = edges[18]
    if ready[s, limb]:
        return
    point, other, grasp = points[s, limb], 1 - limb, points[s, 1 - limb]
    placed = floats(8, len(collision_model[0][0]), 2, 3)
    # A variable: with literals the kernels would be compiled once for each value.
    with_robot = len(mask) > 0
    for layer in range(2):
        if layer == 0:
            if ready0[s, limb]:
                continue
            wanted, before = mask0[s, limb], -1
            count = place_branches(
                other, mask0[s, other], pivots[grasp], normals[grasp], tool_length, position[s],
                rotation[s], mount_rotations,
                mount_positions, lengths, collision_model[0], 0, placed,
            )  # fmt: skip
        else:
            if not overlay:
                continue
            before, count = released0[s, limb], 0
            wanted = before & mask[s, limb] if mask[s, other] else 0
        answer = 0
        if layer == 1 and wanted and not close[s]:
            answer = before
        elif wanted:
            answer = release(
                limb, wanted, pivots[point], normals[point], rails[point], tool_length, lift,
                position[s], rotation[s], placed[:count], folds, limits, mount_rotations,
                mount_positions, lengths, collision_model if layer == 0 else obstacles,
                with_robot if layer == 0 else not with_robot, before,
            )  # fmt: skip
        if layer == 0:
            released0[s, limb], ready0[s, limb] = answer, True
        else:
            released[s, limb] = answer
    ready[s, limb] = True


@kernel
def edge_entry(held: int, s0: int, s1: int, edges: tuple[Any, ...]) -> int:
    """Branches that limb `held` can keep on the step from stance `s0` to `s1`, worked out once.

    The limb that moves must be on one of the branches on which it can be released, see
    `ensure_released`, and may then be on any on which it can be released again. Both directions of
    the step are entered.

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
    _, boxes, close, mask0, _, released0, table0, obstacles = edges[18]
    point, mover = points[s0, held], 1 - held
    here = offset[held, point] + local[held, s0] * degree[held, point] + local[held, s1]
    there = offset[held, point] + local[held, s1] * degree[held, point] + local[held, s0]
    if table[here] & KNOWN:
        known: int = table[here]
        return known
    back = collide and s0 > s1
    if back:
        # Always from the same end, since which swing is found first may depend on it.
        s0, s1, here, there = s1, s0, there, here
    for limb in range(2):
        ensure_released(s0, limb, edges)
        ensure_released(s1, limb, edges)
    with_robot = len(table) > 0
    if not table0[here] & KNOWN:
        wanted, entry = mask0[s0, held] & mask0[s1, held], KNOWN
        if released0[s0, mover] & BRANCH_BITS and released0[s1, mover] & BRANCH_BITS:
            folds_at_both = (released0[s0, mover] & released0[s1, mover]) >> FOLDS_AT & 15
            # First the branches of a limb that grasped before the step and is released after it,
            # then those of one that did one of the two.
            both = wanted & released0[s0, held] & released0[s1, held]
            some = wanted & (released0[s0, held] | released0[s1, held]) & ~both
            for turn in range(3):
                now = both if turn == 0 else some if turn == 1 else wanted & ~(both | some)
                if now and not entry & BRANCH_BITS:
                    entry = _folded_entry(
                        held, s0, s1, now, now & 0, folds_at_both, folds_at_both, edges,
                        collision_model, with_robot,
                    )  # fmt: skip
            if collide and wanted and not entry & BRANCH_BITS:
                entry = _line_entry(held, s0, s1, wanted, wanted & 0, edges, collision_model)
        table0[here], table0[there] = entry, turned(entry)
    if boxes:
        entry = table0[here]
        kept = entry & mask[s0, held] & mask[s1, held]
        if not released[s0, mover] & BRANCH_BITS or not released[s1, mover] & BRANCH_BITS:
            kept &= 0
        arc = entry >> ARC_BITS & kept
        kept &= ~arc
        folds_at_both = (released[s0, mover] & released[s1, mover]) >> FOLDS_AT & 15
        if not (close[s0] or close[s1]):
            entry = entry & ~BRANCH_BITS | kept | arc
        elif entry & LINE:
            entry = _line_entry(held, s0, s1, kept | arc, entry, edges, obstacles)
        else:
            entry = _folded_entry(
                held, s0, s1, kept, arc, folds_at_both & 1 << (entry >> FOLD_BITS & 3),
                folds_at_both & 1 << (entry >> (FOLD_BITS + 2) & 3), edges, obstacles,
                not with_robot,
            )  # fmt: skip
        table[here], table[there] = entry, turned(entry)
    found: int = table[there] if back else table[here]
    return found


@kernel
def turned(entry: int) -> int:
    """The entry of the same step in the other direction."""
    if not entry & LINE:
        return entry
    pair = entry >> PAIR_BITS & 63
    return entry & ~(63 << PAIR_BITS) | ((pair & 7) << 3 | pair >> 3) << PAIR_BITS


@kernel
def _folded_entry(
    held: int, s0: int, s1: int, wanted: int, arc: int, line_folds: int, arc_folds: int,
    edges: tuple[Any, ...], collision_model: tuple[Any, ...], inside: bool,
) -> int:  # fmt: skip
    """The edge entry of a step on which the limb that moves stays folded.

    Args:
        held: The limb that holds.
        s0: Stance before the step.
        s1: Stance after it.
        wanted: Branches to check on the straight line.
        arc: Branches to check on the arc.
        line_folds: Folds to check on the straight line, as bits.
        arc_folds: Folds to check on the arc.
        edges: `PairGraph.edges`.
        collision_model: `CollisionModel.arrays`.
        inside: Whether the robot's shapes are compared with each other too. The limb that holds
            must then also be shown to keep its branch, and those of `wanted` that cannot be kept on
            the line are tried on the arc.
    """
    points, position, rotation = edges[0], edges[5], edges[6]
    mount_rotations, mount_positions, lengths, grips, tools, pivots = edges[8:14]
    determinant_floor, limits, full_turn = edges[14:17]
    collide, folds = edges[17][0], edges[17][7]
    point, mover = points[s0, held], 1 - held
    entry, folded = KNOWN, floats(6)
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
                    lengths, determinant_floor, limits, full_turn, rest,
                )  # fmt: skip
        if rest and collide:
            path = (position[s0], rotation[s0], position[s1], rotation[s1], kind, pivots[point])
            fold = folded_swing(
                mover, line_folds if kind == 0 else arc_folds, path, folds, mount_rotations,
                mount_positions, lengths, collision_model, inside, folded,
            )  # fmt: skip
            if fold < 0:
                continue
            rest = holding(
                held, rest, grips[point], tools[point], path, mover, folded, folded,
                mount_rotations, mount_positions, lengths, collision_model, inside, BOTH,
            )  # fmt: skip
            entry |= fold << (FOLD_BITS + 2 * kind)
        entry |= rest | (rest << ARC_BITS if kind == 1 else 0)
    return entry


@kernel
def _line_entry(
    held: int, s0: int, s1: int, wanted: int, before: int, edges: tuple[Any, ...],
    collision_model: tuple[Any, ...],
) -> int:  # fmt: skip
    """The edge entry of a step on which the limb that moves swings along a line.

    `wanted` are the branches to check. `before` is the entry in the world without obstacles, whose
    swing alone is checked, or 0. Other arguments as in `_folded_entry`.
    """
    points, position, rotation = edges[0], edges[5], edges[6]
    releasable = edges[17][2] if before else edges[18][5]
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
            mover, releasable[s, mover] & BRANCH_BITS, pivots[grasp], normals[grasp], rails[grasp],
            tool_length, lift, position[s], rotation[s],
            mount_rotations, mount_positions, lengths, limits, q[side],
        )  # fmt: skip
    count = pairs_by_travel(masks[0], q[0], masks[1], q[1], limits, order)
    for kind in range(2):
        rest = wanted
        if before:
            if (before >> ARC_BITS & BRANCH_BITS > 0) != (kind == 1):
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
                    on_arc = kept << ARC_BITS if kind == 1 else 0
                    entry: int = KNOWN | LINE | pair << PAIR_BITS | kept | on_arc
                    return entry
    return KNOWN


@kernel
def fill_row(held: int, s0: int, row: IntArray, out: IntArray, edges: tuple[Any, ...]) -> None:
    """Branches and flips of `edge_entry` from `s0` to each stance of `row`, into `out`."""
    for k in range(len(row)):
        out[k] = edge_entry(held, s0, row[k], edges) & BRANCH_BITS


@kernel
def pair_successors(
    s: int, mask0: int, mask1: int, check: bool, rows: IntArray, row_start: IntArray,
    limb: IntArray, stance: IntArray, masks: IntArray, edges: tuple[Any, ...],
) -> int:  # fmt: skip
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
def longest_step(
    start: int, stop: int, held: int, rows: IntArray, row_start: IntArray, position: Array,
    out: Array,
) -> None:  # fmt: skip
    """Largest squared base displacement within each row from `start` to `stop`, into `out` [m^2].

    Rows as in `PairGraph`, positions of stances, shape (n, 3) [m], `out` of points, shape (m,).
    """
    for point in range(start, stop):
        for i in range(row_start[held, point], row_start[held, point + 1]):
            for j in range(row_start[held, point], i):
                a, b = rows[held, i], rows[held, j]
                square = 0.0
                for axis in range(3):
                    square += (position[a, axis] - position[b, axis]) ** 2
                out[point] = max(out[point], square)


@kernel
def fill_points(
    start: int, stop: int, held: int, rows: IntArray, row_start: IntArray, edges: tuple[Any, ...]
) -> None:
    """Work out every step of the rows from `start` to `stop`."""
    for point in range(start, stop):
        for i in range(row_start[held, point], row_start[held, point + 1]):
            for j in range(row_start[held, point], i):
                edge_entry(held, rows[held, i], rows[held, j], edges)
