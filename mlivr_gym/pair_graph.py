"""Stance graph of two limbs: the whole feasible set at once.

The neighbours of a stance (a, b) are the other stances of row a (limb 0 holds) and of row b
(limb 1 holds), so no edge list is stored. What is stored, once known, is the set of branches the holding limb
can keep on a step: one entry for each ordered pair of stances of a row, filled on demand.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.base_path import ARC, STRAIGHT
from mlivr_gym.collision_kernels import CABIN, HANDRAIL, SELF
from mlivr_gym.compiled import in_parallel, kernel
from mlivr_gym.direct_kernels import TRIES, lifted_at, line_free, pairs_by_travel
from mlivr_gym.errors import StanceError
from mlivr_gym.grasp_kernels import place_branches
from mlivr_gym.grasp_map import GraspMap
from mlivr_gym.posture import Postures
from mlivr_gym.release_kernels import TOGETHER, carried, holding, release
from mlivr_gym.robot import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stance_graph import Array, IntArray, StanceGraph, State, Successors, Way
from mlivr_gym.transitions import hold_mask

KNOWN = 1 << 16
"""Bit of an edge entry: the entry is filled. Below it are the branches and flips on which the limb can hold."""
ARC_BITS, FOLD_BITS = 17, 33
"""First bits of the branches and flips that need the arc, and of the folds on the line and on the arc (2 bits each)."""
DIRECT, PAIR_BITS = 1 << 37, 38
"""Bit of an entry whose step only a direct swing makes, and first bits of its branches after and before the step (3 each)."""
REMOVED = {"self": SELF, "cabin": CABIN, "handrail": HANDRAIL}
"""Causes that keep a stance out of the graph."""
NO_POINTS: IntArray = np.zeros(0, dtype=np.int64)


@kernel
def settle(s, limb, edges):
    """Work out, once, on which branches a limb can let go at a stance: its answer of `release`, 0 if on none."""
    points, position, rotation, mask = edges[0], edges[5], edges[6], edges[7]
    mount_rotations, mount_positions, lengths, pivots, limits = edges[8], edges[9], edges[10], edges[13], edges[15]
    _, ready, released, normals, rails, tool_length, lift, folds, bodies = edges[17]
    overlay, _, near, mask0, ready0, released0, _, obstacles = edges[18]
    if ready[s, limb]:
        return
    point, other, grasp = points[s, limb], 1 - limb, points[s, 1 - limb]
    placed = np.empty((8, len(bodies[0][0]), 2, 3))
    own = len(mask) > 0  # a variable: with literals the kernels would be compiled once for each value
    for layer in range(2):
        if layer == 0:
            if ready0[s, limb]:
                continue
            wanted, before = mask0[s, limb], np.int64(-1)
            count = place_branches(
                other, mask0[s, other], pivots[grasp], normals[grasp], tool_length, position[s], rotation[s], mount_rotations,
                mount_positions, lengths, bodies[0], 0, placed,
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
                limb, wanted, pivots[point], normals[point], rails[point], tool_length, lift, position[s], rotation[s],
                placed[:count], folds, limits, mount_rotations, mount_positions, lengths,
                bodies if layer == 0 else obstacles, own if layer == 0 else not own, before,
            )  # fmt: skip
        if layer == 0:
            released0[s, limb], ready0[s, limb] = answer, True
        else:
            released[s, limb] = answer
    ready[s, limb] = True


@kernel
def edge_entry(held, s0, s1, edges):
    """Branches that limb `held` can keep on the step from stance `s0` to `s1`, looked up or worked out.

    The limb that moves must be on one of the branches on which it can let go, see `settle`, and lands on all on which it can
    let go again. Both directions of the step are entered.

    Args:
        held: The limb that holds.
        s0: Stance before the step.
        s1: Stance after it.
        edges: `PairGraph.edges`.

    Returns:
        The entry; see `KNOWN`, `ARC_BITS`, `FOLD_BITS`, `DIRECT` and `PAIR_BITS`.
    """
    points, local, degree, offset, table, _, _, mask = edges[:8]
    collide, released, bodies = edges[17][0], edges[17][2], edges[17][8]
    _, boxes, near, mask0, _, released0, table0, obstacles = edges[18]
    point, mover = points[s0, held], 1 - held
    here = offset[held, point] + local[held, s0] * degree[held, point] + local[held, s1]
    there = offset[held, point] + local[held, s1] * degree[held, point] + local[held, s0]
    if table[here] & KNOWN:
        return table[here]
    for limb in range(2):
        settle(s0, limb, edges)
        settle(s1, limb, edges)
    own = len(table) > 0
    if not table0[here] & KNOWN:
        wanted, entry = mask0[s0, held] & mask0[s1, held], np.int64(KNOWN)
        if released0[s0, mover] & 0xFFFF and released0[s1, mover] & 0xFFFF:
            together = (released0[s0, mover] & released0[s1, mover]) >> TOGETHER & 15
            # First what serves a limb that landed before the step and lets go after it, then what serves one of the two.
            both = wanted & released0[s0, held] & released0[s1, held]
            some = wanted & (released0[s0, held] | released0[s1, held]) & ~both
            for turn in range(3):
                now = both if turn == 0 else some if turn == 1 else wanted & ~(both | some)
                if now and not entry & 0xFFFF:
                    entry = _carry(held, s0, s1, now, now & 0, together, together, edges, bodies, own)
            if collide and wanted and not entry & 0xFFFF:
                entry = _direct(held, s0, s1, wanted, np.int64(0), edges, bodies)
        table0[here], table0[there] = entry, turned(entry)
    if boxes:
        entry = table0[here]
        left = entry & mask[s0, held] & mask[s1, held]
        if not released[s0, mover] & 0xFFFF or not released[s1, mover] & 0xFFFF:
            left &= 0
        arc = entry >> ARC_BITS & left
        left &= ~arc
        together = (released[s0, mover] & released[s1, mover]) >> TOGETHER & 15
        if not (near[s0] or near[s1]):
            entry = entry & ~np.int64(0xFFFF) | left | arc
        elif entry & DIRECT:
            entry = _direct(held, s0, s1, left | arc, entry, edges, obstacles)
        else:
            entry = _carry(
                held, s0, s1, left, arc, together & 1 << (entry >> FOLD_BITS & 3),
                together & 1 << (entry >> (FOLD_BITS + 2) & 3), edges, obstacles, not own,
            )  # fmt: skip
        table[here], table[there] = entry, turned(entry)
    return table[here]


@kernel
def turned(entry):
    """The entry of the same step in the other direction."""
    if not entry & DIRECT:
        return entry
    pair = entry >> PAIR_BITS & 63
    return entry & ~(np.int64(63) << PAIR_BITS) | ((pair & 7) << 3 | pair >> 3) << PAIR_BITS


@kernel
def _carry(held, s0, s1, wanted, arc, line_folds, arc_folds, edges, bodies, inside):
    """An edge entry from the branches to look at on the line and on the arc and the folds to look at.

    With `inside` the limb that holds must also be shown to keep its branch, and what the line leaves of `wanted` is
    tried on the arc.
    """
    points, position, rotation = edges[0], edges[5], edges[6]
    mount_rotations, mount_positions, lengths, grips, tools, pivots = edges[8:14]
    determinant_floor, limits, full_turn = edges[14:17]
    collide, normals, folds = edges[17][0], edges[17][3], edges[17][7]
    point, mover = points[s0, held], 1 - held
    entry, carry = np.int64(KNOWN), np.empty(6)
    for kind in range(2):
        rest = wanted if kind == 0 else arc
        if collide and not (line_folds if kind == 0 else arc_folds):
            continue
        if inside:
            rest = wanted & ~entry
            if rest:
                rest = hold_mask(
                    kind, pivots[point], grips[point], tools[point], position[s0], rotation[s0],
                    position[s1], rotation[s1], mount_rotations[held], mount_positions[held], lengths,
                    determinant_floor, limits, full_turn, rest,
                )  # fmt: skip
        if rest and collide:
            path = (position[s0], rotation[s0], position[s1], rotation[s1], kind, pivots[point])
            fold = carried(
                mover, line_folds if kind == 0 else arc_folds, path, folds, mount_rotations, mount_positions, lengths, bodies,
                inside, carry,
            )  # fmt: skip
            if fold < 0:
                continue
            rest = holding(
                held, rest, grips[point], tools[point], pivots[point], normals[point], path, mover, carry, carry,
                mount_rotations, mount_positions, lengths, bodies, inside,
            )  # fmt: skip
            entry |= np.int64(fold) << (FOLD_BITS + 2 * kind)
        entry |= rest | (rest << ARC_BITS if kind == 1 else 0)
    return entry


@kernel
def _direct(held, s0, s1, wanted, before, edges, bodies):
    """An entry for a direct swing, on the branches to look at.

    `before` is the entry in the world without obstacles, whose swing alone is looked at, or 0.
    """
    points, position, rotation, land = edges[0], edges[5], edges[6], edges[17][2] if before else edges[18][5]
    mount_rotations, mount_positions, lengths, grips, tools, pivots = edges[8:14]
    determinant_floor, limits, full_turn = edges[14:17]
    _, _, _, normals, rails, tool_length, lift, _, _ = edges[17]
    point, mover = points[s0, held], 1 - held
    q, end, order = np.empty((2, 8, 6)), np.empty(6), np.empty(64, np.int64)
    masks = np.empty(2, np.int64)
    for side in range(2):
        s = s1 if side else s0
        grasp = points[s, mover]
        masks[side] = lifted_at(
            mover, land[s, mover] & 0xFFFF, pivots[grasp], normals[grasp], rails[grasp], tool_length, lift, position[s], rotation[s],
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
                mover, start, q[1, pair & 7], path, limits, mount_rotations, mount_positions, lengths, bodies, before == 0, end
            ):  # fmt: skip
                left = holding(
                    held, rest, grips[point], tools[point], pivots[point], normals[point], path, mover, start, end,
                    mount_rotations, mount_positions, lengths, bodies, before == 0,
                )  # fmt: skip
                if left:
                    return KNOWN | DIRECT | np.int64(pair) << PAIR_BITS | left | (left << ARC_BITS if kind == 1 else 0)
    return np.int64(KNOWN)


@kernel
def fill_row(held, s0, row, out, edges):
    """Branches and flips of `edge_entry` from `s0` to each stance of `row`, into `out`; `edges` are its further arguments."""
    for k in range(len(row)):
        out[k] = edge_entry(held, s0, row[k], edges) & 0xFFFF


@kernel
def pair_successors(s, mask0, mask1, check, rows, row_start, limb, stance, masks, edges):
    """Steps that leave stance `s`: limb, stance reached and masks after the step, shape (k, 2); returns their number."""
    points, mask, released = edges[0], edges[7], edges[17][2]
    count = 0
    for moving in range(2):
        held = 1 - moving
        mine, own = (mask1, mask0) if held else (mask0, mask1)
        if check:
            settle(s, moving, edges)
            if not own & released[s, moving] & 0xFFFF:
                continue
        point = points[s, held]
        for k in range(row_start[held, point], row_start[held, point + 1]):
            s2 = rows[held, k]
            if s2 == s:
                continue
            after, landed = mine & mask[s2, held], mask[s2, moving]
            if check and after:
                after &= edge_entry(held, s, s2, edges)
                landed = released[s2, moving] & 0xFFFF
            if after and landed:
                limb[count], stance[count] = moving, s2
                masks[count, held], masks[count, moving] = after, landed
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
def _fill_points(start, stop, held, rows, row_start, edges):
    for point in range(start, stop):
        for i in range(row_start[held, point], row_start[held, point + 1]):
            for j in range(row_start[held, point], i):
                edge_entry(held, rows[held, i], rows[held, j], edges)


def fill_rows(graph: PairGraph, progress: Callable[[int, int], None] | None = None) -> None:
    """Check every step of a graph, once; `progress` is called with rows done and rows in all."""
    if graph.complete:
        return
    m = len(graph.grasp_map)
    chunk = max(1, m // 16)
    for held in range(2):
        for begin in range(0, m, chunk):
            in_parallel(
                min(chunk, m - begin), _fill_points, held, graph.rows, graph.row_start, graph.edges,
                first=begin, least=2,
            )  # fmt: skip
            if progress is not None:
                progress(held * m + min(begin + chunk, m), 2 * m)
    graph.complete = True


class PairGraph(StanceGraph):
    """All stances of a two-limb robot that are nodes, and the steps between them.

    Attributes:
        points: Point indices of each stance, shape (n, 2), in lexical order.
        position: Base positions [m], shape (n, 3).
        rotation: Base rotations, shape (n, 3, 3).
        w_m: Limb manipulability, shape (n, 2).
        w_b: Base manipulability, shape (n,).
        mask: Branches and flips each limb may hold on, shape (n, 2).
        rows: Stance indices sorted by the point of limb 0 and of limb 1, shape (2, n).
        row_start: Where the row of each point begins in `rows`, shape (2, m + 1).
        considered: Ordered pairs of points that were looked at.
        reachable: How many of them inverse kinematics can hold.
        removed: How many that meet the thresholds were left out because they touch something, by what they touch.
    """

    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Work out every stance."""
        super().__init__(grasp_map, robot, settings)
        postures = self.postures(self.pairs)
        node = self.is_node(postures)
        self.considered, self.reachable = len(self.pairs), int(postures.reachable.sum())
        self.removed = {name: int((postures.cause[~node] == cause).sum()) for name, cause in REMOVED.items()}
        self.points = np.ascontiguousarray(self.pairs[node])
        chosen = postures.take(node)
        self.position, self.rotation, self.w_m, self.w_b = (
            chosen.position,
            chosen.rotation,
            chosen.w_m,
            chosen.w_b,
        )
        self.branch, self.mask = chosen.branch, chosen.mask
        n, m = len(self.points), len(grasp_map)
        by_second = np.lexsort((self.points[:, 0], self.points[:, 1]))
        self.rows: IntArray = np.stack([np.arange(n), by_second]).astype(np.int64)
        ordered = np.take_along_axis(self.points.T, self.rows, axis=1)
        self.row_position: Array = self.position[self.rows]
        """Base positions in the order of `rows` [m], shape (2, n, 3)."""
        self.row_start: IntArray = np.stack([np.searchsorted(row, np.arange(m + 1)) for row in ordered])
        self.degree: IntArray = np.diff(self.row_start, axis=1)
        self.offset: IntArray = np.cumsum(self.degree.ravel() ** 2).reshape(2, m) - self.degree**2
        self.local: IntArray = np.empty((2, n), dtype=np.int64)
        for limb in range(2):
            self.local[limb, self.rows[limb]] = np.arange(n) - self.row_start[limb, ordered[limb]]
        self.table = np.zeros(int((self.degree**2).sum()) if settings.transitions else 1, dtype=np.int64)
        """Edge entries, zero where not known yet."""
        self.complete = False
        """Whether every edge entry is known."""
        self._keys = self.points[:, 0] * m + self.points[:, 1]
        known = np.full((n, 2), not settings.collisions)
        self._free = self.mask, known, self.mask * known, self.table
        self.edges = self._edges()
        """Arguments of `edge_entry`: the graph in the kernels' form."""

    def _edges(self) -> tuple[Any, ...]:
        """The kernels' arguments: masks, releases and entries with the present obstacles, and those without."""
        robot, solver, settings = self.robot, self.solver, self.settings
        mask0, ready0, released0, table0 = self._free
        self.mask, ready, released, self.table, near = mask0, ready0, released0, table0, np.zeros(0, dtype=np.bool_)
        overlay, boxes = bool(self.obstacles or self.occupied), False
        if overlay:
            near = self._near_obstacles()
            boxes = bool(near.any())
            self.mask, released, ready = mask0.copy(), released0.copy(), np.zeros_like(ready0)
            taken = np.zeros(len(self.grasp_map), dtype=np.bool_)
            taken[list(self.occupied)] = True
            gone = taken[self.points[:, 0]] | taken[self.points[:, 1]]
            self.mask[gone] = released[gone] = 0
            ready[gone] = True
            ready[~gone & ~near] = ready0[~gone & ~near]
            if boxes:
                self.table = np.zeros_like(table0)
                touching = near & self._within(self.robot.extent + self.settings.clearance)
                self.clear_of_obstacles(
                    np.flatnonzero(touching), self.points, self.position, self.rotation, self.branch, self.mask
                )
        return (
            self.points, self.local, self.degree, self.offset, self.table, self.position, self.rotation, self.mask,
            solver.mount_rotations, solver.mount_positions, solver.lengths, self.grips,
            solver.tools, solver.points, settings.path_floor * robot.characteristic_length**3, solver.limits, solver.full_turn,
            (
                settings.collisions, ready, released, solver.normals, solver.rails, robot.tool_length, robot.lift,
                solver.folds, solver.bodies.arrays,
            ),
            (overlay, boxes, near, mask0, ready0, released0, table0, self.hindrance.arrays),
        )  # fmt: skip

    def _near_obstacles(self) -> NDArray[np.bool_]:
        """Stances whose robot, on a step from or to them, may come near an obstacle, shape (n,)."""
        return self._within(self.robot.extent + self.settings.clearance + 0.8 * self.max_step)

    def _within(self, reach: float) -> NDArray[np.bool_]:
        """Stances whose base lies within `reach` [m] of an obstacle, shape (n,)."""
        near = np.zeros(len(self), dtype=np.bool_)
        for box in self.obstacles:
            low, high = box.bounds
            away = self.position - np.clip(self.position, low, high)
            near |= np.einsum("ij,ij->i", away, away) <= reach**2
        return near

    def _obstacles_changed(self) -> None:
        self.edges = self._edges()
        self.complete = False

    def __len__(self) -> int:
        """Number of stances."""
        return len(self.points)

    def no_stance(self) -> str:
        """Why a graph without stances has none."""
        if not self.reachable:
            return (
                f"no base pose at heights {self.robot.heights} m lets limbs mounted {self.robot.mount_radius:g} m "
                f"from the axis reach two points"
            )
        return (
            f"of {self.reachable} stances in reach none meets w_m >= {self.limb_threshold:g} and w_b >= "
            f"{self.base_threshold:g} with limbs that can depart at w_m >= {self.settings.path_floor:g}"
        )

    def find(self, stance: Sequence[int]) -> int:
        """Index of a stance given by point indices, or -1 if it is no node."""
        key = stance[0] * len(self.grasp_map) + stance[1]
        k = int(np.searchsorted(self._keys, key))
        return k if k < len(self._keys) and self._keys[k] == key else -1

    def state(self, stance: Sequence[str | int]) -> State:
        """The state of a robot that takes hold of a stance; see `StanceGraph.state`."""
        points = self.indices(stance)
        s = self.find(points)
        if s >= 0:
            if self.mask[s].all():
                return State(points, tuple(self.mask[s].tolist()))
            fault = self._fault(points, self.posture(points))
            raise StanceError(f"stance {self.ids(points)} cannot be held: {fault}")
        return super().state(points)

    def released(self, stance: tuple[int, ...], posture: Postures, limb: int) -> int:
        """On which branches a limb can let go of a stance; see `StanceGraph.released`."""
        s = self.find(stance)
        if s < 0:
            return super().released(stance, posture, limb)
        settle(s, limb, self.edges)
        return int(self.edges[17][2][s, limb])

    def way(
        self, before: Sequence[int], after: Sequence[int], limb: int, posture: Postures, masks: Sequence[int]
    ) -> Way:
        """How a step that is an edge is made; see `StanceGraph.way`."""
        if not self.settings.collisions:
            return super().way(before, after, limb, posture, masks)
        held = 1 - limb
        entry = int(edge_entry(held, self.find((before[0], before[1])), self.find((after[0], after[1])), self.edges))
        kind = ARC if entry >> ARC_BITS & masks[held] else STRAIGHT
        left = {held: entry & masks[held] & 0xFFFF}
        if entry & DIRECT:
            return Way(kind, -1, entry >> PAIR_BITS & 63, left)
        return Way(kind, entry >> (FOLD_BITS + 2 * kind) & 3, -1, left)

    def posture(self, stance: Sequence[int]) -> Postures:
        """Posture of one stance given by point indices, every array with a leading 1."""
        s = self.find((stance[0], stance[1]))
        if s < 0:
            return super().posture(stance)
        at = slice(s, s + 1)
        return Postures(
            self.position[at], self.rotation[at], self.w_m[at], self.w_b[at], self.branch[at], self.mask[at],
            np.zeros(1, dtype=np.int64),
        )  # fmt: skip

    def row(self, held: int, s: int) -> IntArray:
        """The other stances that limb `held` of stance `s` shares its point with."""
        point = self.points[s, held]
        row = self.rows[held, self.row_start[held, point] : self.row_start[held, point + 1]]
        return row[row != s]

    def edge_masks(self, held: int, s: int, row: IntArray) -> IntArray:
        """Branches that limb `held` can keep on the steps from `s` to each stance of `row`, joint limits included."""
        out = np.full(len(row), 0xFFFF, dtype=np.int64)
        if not self.settings.transitions:
            return out
        fill_row(held, s, row, out, self.edges)
        return out

    @contextmanager
    def without(self, steps: Collection[tuple[tuple[int, ...], tuple[int, ...]]]) -> Iterator[None]:
        """Take steps, given as pairs of stances, out of the graph for a while."""
        kept = []
        for before, after in steps:
            held = 0 if before[0] == after[0] else 1
            s0, s1, point = self.find(before), self.find(after), before[held]
            entry = self.offset[held, point] + self.local[held, s0] * self.degree[held, point] + self.local[held, s1]
            kept.append((entry, int(self.table[entry])))
            self.table[entry] = KNOWN
        try:
            yield
        finally:
            for entry, value in reversed(kept):
                self.table[entry] = value

    def successors(self, state: State) -> Successors:
        """All steps that leave a state."""
        s = self.find(state.stance)
        if s < 0:
            return Successors(NO_POINTS, NO_POINTS, np.zeros((0, 3)), np.zeros((0, 2), dtype=np.int64))
        size = int(self.degree[0, state.stance[0]] + self.degree[1, state.stance[1]])
        limb, stance = (np.empty(size, dtype=np.int64) for _ in range(2))
        masks = np.empty((size, 2), dtype=np.int64)
        count = pair_successors(
            s, state.masks[0], state.masks[1], self.settings.transitions, self.rows, self.row_start,
            limb, stance, masks, self.edges,
        )  # fmt: skip
        limb, stance = limb[:count], stance[:count]
        return Successors(limb, self.points[stance, limb], self.position[stance], masks[:count])

    @cached_property
    def max_step(self) -> float:
        """Largest base displacement of one step [m], over all pairs of stances that share a point."""
        out = np.zeros(len(self.grasp_map))
        for held in range(2):
            longest_step(0, len(out), held, self.rows, self.row_start, self.position, out)
        return max(float(np.sqrt(out.max())), 1e-9)

    @cached_property
    def components(self) -> tuple[int, NDArray[np.int32]]:
        """Number of connected parts of the graph before steps are checked, and the part of each stance, shape (n,)."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        m = len(self.grasp_map)
        links = coo_array((np.ones(len(self)), (self.points[:, 0], m + self.points[:, 1])), shape=(2 * m, 2 * m))
        _, label = connected_components(links, directed=False)
        parts, part = np.unique(label[self.points[:, 0]], return_inverse=True)
        return len(parts), part.astype(np.int32)
