"""The stance graph: which stances a robot can hold on a map, and which steps join them.

`stance_graph(...)` is the way in. For two limbs it returns a `PairGraph`, which holds the whole feasible
set; for more a `LazyGraph`, which works neighbours out when they are asked for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mlivr_gym.base_path import ARC, STRAIGHT, follow
from mlivr_gym.bodies import Bodies
from mlivr_gym.clear_kernels import clear_of_world, hands_clear
from mlivr_gym.compiled import in_parallel, is_cached, second_process
from mlivr_gym.direct_kernels import TRIES, lifted_at, line_free, pairs_by_travel
from mlivr_gym.distance_kernels import CABIN, HANDRAIL, OBSTACLE, SELF, UNDECIDED
from mlivr_gym.errors import RobotError, SettingError, ShapeError, StanceError
from mlivr_gym.grasp_kernels import place_branches
from mlivr_gym.grasp_map import GraspMap, jem_map
from mlivr_gym.posture import FIELDS, Postures, PostureSolver
from mlivr_gym.posture_kernels import solve_geometries
from mlivr_gym.release_kernels import TOGETHER, carried, holding, release, together_apart
from mlivr_gym.robot import RobotSpec, robot_spec
from mlivr_gym.settings import Settings
from mlivr_gym.shapes import Box
from mlivr_gym.transitions import hold_mask, quaternion

if TYPE_CHECKING:
    from mlivr_gym.lazy_graph import LazyGraph
    from mlivr_gym.pair_graph import PairGraph

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


TOUCHED = {
    UNDECIDED: "something", SELF: "the robot itself", CABIN: "the cabin", HANDRAIL: "a handrail", OBSTACLE: "an obstacle",
}  # fmt: skip
"""What a cause of a collision is called in a sentence."""


class State(NamedTuple):
    """A stance and, for each limb, the branches and flips it may still be on.

    A limb that holds keeps its branch, so every step takes branches away from the limbs that hold;
    a limb that lands has all of them again.
    """

    stance: tuple[int, ...]
    """Point index of each limb."""
    masks: tuple[int, ...]
    """16-bit mask of each limb, bit `branch + 8 * flip`."""


class Successors(NamedTuple):
    """The k steps that leave a state, ordered by limb and point."""

    limb: IntArray
    """Limb that moves, shape (k,)."""
    point: IntArray
    """Point it moves to, shape (k,)."""
    position: Array
    """Base position after the step [m], shape (k, 3)."""
    masks: IntArray
    """Masks of all limbs after the step, shape (k, N)."""


@dataclass(frozen=True)
class Transition:
    """What one step leaves.

    Attributes:
        pivot: Centre of a base path that is an arc: the centroid of the held points [m], shape (3,).
        masks: Branches left to each limb after the step.
    """

    pivot: Array
    masks: tuple[int, ...]


class Way(NamedTuple):
    """How a step is made."""

    kind: int
    """Kind of the base path."""
    fold: int
    """Fold in which the limb can be carried, -1 without collisions or if it swings directly."""
    pair: int
    """Branches between which the limb can swing directly, `8 * before + after`, or -1."""
    left: dict[int, int]
    """Branches on which the limbs that hold can do so."""


class StanceGraph(ABC):
    """Stances and steps of one robot on one map under one set of thresholds."""

    solver_class: type[PostureSolver] = PostureSolver
    """What works postures out."""

    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Prepare the solver and the pairs of points close enough to be held at once."""
        self.grasp_map, self.robot, self.settings = grasp_map, robot, settings
        self.solver = self.solver_class(grasp_map, robot, settings)
        self.limb_threshold, self.base_threshold = settings.thresholds(robot.limbs)
        positions = grasp_map.positions
        pairs = cKDTree(positions).query_pairs(robot.span + 1e-9, output_type="ndarray").astype(np.int64)
        distance = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
        pairs = pairs[distance >= robot.grasp_separation - 1e-9]
        both = np.concatenate([pairs, pairs[:, ::-1]])
        self.pairs: IntArray = both[np.lexsort((both[:, 1], both[:, 0]))]
        """Ordered pairs of points that may be held at once, shape (p, 2)."""
        self.partner_start: IntArray = np.searchsorted(self.pairs[:, 0], np.arange(len(grasp_map) + 1))
        self.grips: Array = positions + robot.tool_length * grasp_map.normals
        """Flange position at each grasp [m], shape (m, 3)."""
        self.obstacles: tuple[Box, ...] = ()
        """What stands in the way at present, besides the map's own boxes."""
        self.occupied: frozenset[int] = frozenset()
        """Points that may not be grasped at present, by index."""
        self.version = 0
        """Number of changes of obstacles and occupied points."""
        self.hindrance = Bodies(self.solver.shapes, (), settings.clearance)
        """The obstacles in the form the compiled checks read."""

    @property
    def limbs(self) -> int:
        """Number of limbs."""
        return self.robot.limbs

    @property
    def checks(self) -> list[tuple[tuple[Any, ...], bool]]:
        """What motions are checked against: bodies, and whether with the robot's own shapes."""
        if not self.settings.collisions:
            return []
        found = [(self.solver.bodies.arrays, True)]
        return [*found, (self.hindrance.arrays, False)] if self.obstacles else found

    def add_obstacles(self, boxes: Sequence[Box]) -> None:
        """Put boxes into the world: they take away the stances and steps that touch them.

        Nothing is worked out again but what lies near, and that when it is asked for. Stances keep their postures.

        Raises:
            ShapeError: If a box of that id is there already.
            SettingError: If collisions are not checked.
        """
        if boxes and not self.settings.collisions:
            raise SettingError("obstacles need collisions=True; this stance graph does not look at collisions")
        ids = [box.id for box in self.obstacles]
        for box in boxes:
            if box.id in ids:
                raise ShapeError(f"obstacle {box.id!r} is there already")
            ids.append(box.id)
        if boxes:
            self._set_obstacles((*self.obstacles, *boxes), self.occupied)

    def remove_obstacles(self, ids: Sequence[str] | None = None) -> None:
        """Take boxes out of the world again, by default all.

        Raises:
            ShapeError: If there is no box of an id.
        """
        there = [box.id for box in self.obstacles]
        for name in ids or ():
            if name not in there:
                raise ShapeError(f"no obstacle {name!r}; there are {', '.join(map(repr, there)) or 'none'}")
        left = tuple(box for box in self.obstacles if ids is not None and box.id not in ids)
        self._set_obstacles(left, self.occupied)

    def occupy(self, points: Sequence[str | int]) -> None:
        """Make points unavailable: no limb may take hold of them until they are vacated."""
        self._set_obstacles(self.obstacles, self.occupied | {self.grasp_map.index(point) for point in points})

    def vacate(self, points: Sequence[str | int] | None = None) -> None:
        """Make points available again, by default all."""
        gone = self.occupied if points is None else {self.grasp_map.index(point) for point in points}
        self._set_obstacles(self.obstacles, self.occupied - gone)

    def _set_obstacles(self, boxes: tuple[Box, ...], occupied: frozenset[int]) -> None:
        if boxes != self.obstacles:
            self.hindrance = Bodies(self.solver.shapes, boxes, self.settings.clearance)
        self.obstacles, self.occupied = boxes, frozenset(occupied)
        self.version += 1
        self._obstacles_changed()

    @abstractmethod
    def _obstacles_changed(self) -> None:
        """Forget what no longer holds."""

    def partners(self, point: int) -> IntArray:
        """Points that may be held together with `point`."""
        return self.pairs[self.partner_start[point] : self.partner_start[point + 1], 1]

    def indices(self, stance: Sequence[str | int]) -> tuple[int, ...]:
        """Point indices of a stance given by ids or indices.

        Raises:
            StanceError: If the number of points, an id, or the points' distance is wrong.
        """
        if isinstance(stance, str) or len(stance) != self.limbs:
            raise StanceError(
                f"stance {stance!r} must name {self.limbs} points, one for each limb of {self.robot.name!r}"
            )
        points = tuple(self.grasp_map.index(point) for point in stance)
        for i, a in enumerate(points):
            for b in points[i + 1 :]:
                distance = float(np.linalg.norm(self.grasp_map.positions[a] - self.grasp_map.positions[b]))
                names = f"{self.grasp_map.ids[a]!r} and {self.grasp_map.ids[b]!r}"
                if distance < self.robot.grasp_separation - 1e-9:
                    raise StanceError(
                        f"points {names} are {distance:.3f} m apart; two grippers need "
                        f"{self.robot.grasp_separation:g} m"
                    )
                if distance > self.robot.span + 1e-9:
                    raise StanceError(
                        f"points {names} are {distance:.3f} m apart; robot {self.robot.name!r} spans "
                        f"{self.robot.span:g} m"
                    )
        return points

    def ids(self, stance: Sequence[int]) -> tuple[str, ...]:
        """Point ids of a stance."""
        return tuple(self.grasp_map.ids[p] for p in stance)

    def postures(self, stances: IntArray) -> Postures:
        """Postures of stances, shape (k, N), feasible or not."""
        return self.solver.solve(np.asarray(stances, dtype=np.int64).reshape(-1, self.limbs))

    def posture(self, stance: Sequence[int]) -> Postures:
        """Posture of one stance given by point indices, every array with a leading 1."""
        return self.postures(np.array([stance], dtype=np.int64))

    def is_node(self, postures: Postures) -> NDArray[np.bool_]:
        """Which of some stances are nodes of the graph, shape (k,)."""
        node: NDArray[np.bool_] = np.all(postures.mask > 0, axis=1)
        return node

    def state(self, stance: Sequence[str | int]) -> State:
        """The state of a robot that takes hold of a stance.

        Raises:
            StanceError: If the stance cannot be held; the message says why.
        """
        points = self.indices(stance)
        posture = self.posture(points)
        if not self.is_node(posture)[0]:
            raise StanceError(f"stance {self.ids(points)} cannot be held: {self._fault(points, posture)}")
        return State(points, tuple(int(m) for m in posture.mask[0]))

    def _fault(self, points: tuple[int, ...], posture: Postures) -> str:
        taken = [self.grasp_map.ids[p] for p in points if p in self.occupied]
        if taken:
            return f"point {taken[0]!r} is occupied"
        cause = int(posture.cause[0])
        if cause:
            return f"every posture that meets the thresholds touches {TOUCHED[cause]}"
        w_m, w_b = posture.w_m[0], float(posture.w_b[0])
        if not posture.reachable[0]:
            return "the points are out of reach from every base pose tried"
        low = int(np.argmin(w_m))
        if w_m[low] < self.limb_threshold:
            return f"limb manipulability {w_m[low]:.4f} of limb {low} is below the threshold {self.limb_threshold:g}"
        if w_b < self.base_threshold:
            return f"base manipulability {w_b:.6f} is below the threshold {self.base_threshold:g}"
        return (
            f"a limb could not depart along the surface normal with limb manipulability above "
            f"{self.settings.path_floor:g} and inside its joint limits"
        )

    def configuration(self, state: State) -> tuple[Array, Array, Array]:
        """A configuration of a state: base position [m], base quaternion w, x, y, z, joint angles (N, 6) [rad].

        Each limb is on the first branch and flip that its mask allows, with angles in (-pi, pi].
        """
        posture = self.posture(state.stance)
        here = (posture.position[0], posture.rotation[0])
        joints = np.full((self.limbs, 6), np.nan)
        for i, point in enumerate(state.stance):
            bit = (state.masks[i] & -state.masks[i]).bit_length() - 1
            branch = bit & 7 if self.settings.transitions else int(posture.branch[0, i])
            follow(
                self.grips[point], self.solver.tools[point], *here, *here, STRAIGHT, here[0],
                self.solver.mount_rotations[i], self.solver.mount_positions[i], self.solver.lengths, branch, 0,
                joints[i], np.full(6, np.nan), np.full(6, np.inf), np.full(6, -np.inf),
            )  # fmt: skip
            if self.settings.transitions and bit >= 8:
                joints[i, 5] += np.pi
        return here[0], quaternion(here[1]), joints

    @abstractmethod
    def successors(self, state: State) -> Successors:
        """All steps that leave a state."""

    @property
    @abstractmethod
    def max_step(self) -> float:
        """An upper bound of the base displacement of one step [m]."""

    def transition(self, state: State, after: Sequence[int], posture: Postures) -> Transition | None:
        """The base path from a state to a neighbouring stance, or None if the step cannot be carried out.

        Args:
            state: Where the step departs.
            after: Point index of each limb after the step.
            posture: Postures of the two stances, in this order.
        """
        limb = next(i for i in range(self.limbs) if state.stance[i] != after[i])
        held = [i for i in range(self.limbs) if i != limb]
        pivot = self.grasp_map.positions[[after[i] for i in held]].mean(axis=0)
        masks = [int(m) for m in posture.mask[1]]
        if not self.settings.transitions:
            return Transition(pivot, tuple(masks))
        before = [int(m) for m in state.masks]
        if not self.settings.collisions:
            gained = self._gained(limb, held, pivot, after, posture, before, masks, 0)
        else:
            # What holding limbs cannot follow need not be looked at for collisions, which takes longer.
            if not any(self._holds(k, pivot, held, after, posture, before, masks) for k in (STRAIGHT, ARC)):
                return None
            ends = (state.stance, posture.take(slice(0, 1))), (tuple(after), posture.take(slice(1, 2)))
            first, second = (self.released(*end, limb) for end in ends)
            masks[limb] = second & 0xFFFF
            if not before[limb] & first & 0xFFFF or not masks[limb]:
                return None
            stages = self._stages(before, held, ends)
            gained = {}
            for some in stages:
                if all(some[i] for i in held):
                    together = (first & second) >> TOGETHER & 15
                    gained = self._gained(limb, held, pivot, after, posture, some, masks, together)
                if gained:
                    break
            wanted = before if self.limbs == 2 else stages[0]
            for kind in (STRAIGHT, ARC):
                left = {} if gained else self._holds(kind, pivot, held, after, posture, wanted, masks)
                if left:
                    between = (state.stance[limb], after[limb]), (first & 0xFFFF, masks[limb])
                    left = self._direct(kind, pivot, limb, after, posture, left, *between).left
                    gained = left if all(left.values()) else {}
        if not gained:
            return None
        return Transition(pivot, tuple(gained.get(i, masks[i]) for i in range(self.limbs)))

    def _stages(
        self, before: list[int], held: list[int], ends: tuple[tuple[tuple[int, ...], Postures], ...]
    ) -> list[list[int]]:
        """Branches of the limbs that hold in the order in which they are looked at.

        First those on which a limb could let go before the step and after it, as one must that landed just before or moves just
        after; for one limb that holds then the others. For more the pairs of branches would be too many.
        """
        both, some, rest = (list(before) for _ in range(3))
        for i in held:
            first, second = (self.released(*end, i) & 0xFFFF for end in ends)
            both[i] &= first & second
            some[i] &= (first | second) & ~(first & second)
            rest[i] &= ~(first | second)
        return [both, some, rest] if len(held) == 1 else [both]

    def _gained(
        self, limb: int, held: list[int], pivot: Array, after: Sequence[int], posture: Postures, before: list[int],
        masks: list[int], together: int,
    ) -> dict[int, int]:  # fmt: skip
        """Branches left to the limbs that hold while `limb` is carried folded, empty if one has none."""
        gained = dict.fromkeys(held, 0)
        for kind in (STRAIGHT, ARC):
            wanted = [b & ~gained.get(i, 0) for i, b in enumerate(before)]
            left = self._holds(kind, pivot, held, after, posture, wanted, masks)
            if self.settings.collisions and left:
                left = self._carry(kind, pivot, limb, after, posture, left, together).left
            if len(held) == 1:
                # One limb may take some branches along the line and others along the arc.
                gained[held[0]] |= left.get(held[0], 0)
            elif left and all(left.values()):
                return left
        return gained if all(gained.values()) else {}

    def _holds(
        self, kind: int, pivot: Array, held: list[int], after: Sequence[int], posture: Postures, before: Sequence[int],
        masks: Sequence[int],
    ) -> dict[int, int]:  # fmt: skip
        """Branches on which each limb that holds can follow a base path, none at all if one limb cannot."""
        left: dict[int, int] = {}
        for i in held:
            left[i] = self.hold(kind, pivot, after[i], i, posture, before[i] & masks[i])
            if not left[i]:
                return {}
        return left

    def way(
        self, before: Sequence[int], after: Sequence[int], limb: int, posture: Postures, masks: Sequence[int]
    ) -> Way:
        """How a step that is an edge is made.

        Args:
            before: Point index of each limb before the step.
            after: And after it.
            limb: The limb that moves.
            posture: Postures of the two stances.
            masks: The branch and flip each limb is on, as a mask.
        """
        held = [i for i in range(self.limbs) if i != limb]
        pivot = self.grasp_map.positions[[after[i] for i in held]].mean(axis=0)
        chances = []
        for kind in (STRAIGHT, ARC):
            left = {i: self.hold(kind, pivot, after[i], i, posture, int(masks[i])) for i in held}
            if all(left.values()):
                if not self.settings.collisions:
                    return Way(kind, -1, -1, left)
                chances.append((kind, left))
        first = self.released(tuple(before), posture.take(slice(0, 1)), limb)
        second = self.released(tuple(after), posture.take(slice(1, 2)), limb)
        together = (first & second) >> TOGETHER & 15
        for kind, left in chances:
            found = self._carry(kind, pivot, limb, after, posture, dict(left), together)
            if all(found.left.values()):
                return found
        between = (before[limb], after[limb]), (first & 0xFFFF, second & 0xFFFF)
        for kind, left in chances:
            found = self._direct(kind, pivot, limb, after, posture, dict(left), *between)
            if all(found.left.values()):
                return found
        return Way(ARC, -1, -1, {})

    def released(self, stance: tuple[int, ...], posture: Postures, limb: int) -> int:
        """On which branches a limb can let go of a stance, see `release_kernels.release`; 0 if on none."""
        solver, robot, limbs = self.solver, self.robot, self.limbs
        here = (np.ascontiguousarray(posture.position[0]), np.ascontiguousarray(posture.rotation[0]))
        mounts = (solver.mount_rotations, solver.mount_positions, solver.lengths)
        answer, wanted, point = -1, int(posture.mask[0, limb]), stance[limb]
        if not self.settings.collisions:
            return wanted
        for bodies, inside in self.checks:
            placed, count = np.empty((8 * (limbs - 1), len(solver.shapes), 2, 3)), 0
            for other in range(limbs):
                if inside and other != limb:
                    grasp = stance[other]
                    count = place_branches(
                        other, int(posture.mask[0, other]), solver.points[grasp], solver.normals[grasp], robot.tool_length,
                        *here, *mounts, bodies[0], count, placed,
                    )  # fmt: skip
            answer = int(
                release(
                    limb, wanted, solver.points[point], solver.normals[point], solver.rails[point], robot.tool_length,
                    robot.lift, *here, placed[:count], solver.folds, solver.limits, *mounts, bodies, inside, answer,
                )
            )  # fmt: skip
            wanted = answer & 0xFFFF
            if not wanted:
                return 0
        return answer

    def landed(self, stance: tuple[int, ...], limb: int) -> int:
        """Branches and flips on which a limb may be that has just taken hold."""
        posture = self.posture(stance)
        if not self.settings.transitions:
            return int(posture.mask[0, limb])
        return self.released(stance, posture, limb) & 0xFFFF

    def _carry(
        self,
        kind: int,
        pivot: Array,
        limb: int,
        after: Sequence[int],
        posture: Postures,
        left: dict[int, int],
        together: int,
    ) -> Way:
        """The first fold in which `limb` can be carried along a base path, and the branches left to the limbs that hold."""
        solver, path, swing = self.solver, _path(kind, pivot, posture), np.empty(6)
        mounts = (solver.mount_rotations, solver.mount_positions, solver.lengths)
        fold = -1
        for bodies, inside in self.checks:
            fold = int(carried(limb, together, path, solver.folds, *mounts, bodies, inside, swing)) if together else -1
            if fold < 0:
                return Way(kind, -1, -1, dict.fromkeys(left, 0))
            # Another fold might serve the next world; the first must serve all.
            together = 1 << fold
            self._hold_apart(limb, after, path, (swing, swing), left, bodies, inside)
        return Way(kind, fold, -1, left)

    def _direct(
        self,
        kind: int,
        pivot: Array,
        limb: int,
        after: Sequence[int],
        posture: Postures,
        left: dict[int, int],
        points: tuple[int, int],
        masks: tuple[int, int],
    ) -> Way:
        """The first pair of branches between which `limb` can swing directly, and the branches left to those that hold."""
        solver, robot, path = self.solver, self.robot, _path(kind, pivot, posture)
        mounts = (solver.mount_rotations, solver.mount_positions, solver.lengths)
        q, order, end = np.empty((2, 8, 6)), np.empty(64, dtype=np.int64), np.empty(6)
        there = [
            lifted_at(
                limb, mask, solver.points[p], solver.normals[p], solver.rails[p], robot.tool_length, robot.lift, path[2 * k],
                path[2 * k + 1], *mounts, solver.limits, angles,
            )
            for k, (p, mask, angles) in enumerate(zip(points, masks, q, strict=True))
        ]  # fmt: skip
        count = pairs_by_travel(there[0], q[0], there[1], q[1], solver.limits, order)
        for pair in order[: min(count, TRIES)].tolist():
            start, found = q[0, pair >> 3], dict(left)
            for bodies, inside in self.checks:
                goal = q[1, pair & 7]
                if not line_free(limb, start, goal, path, solver.limits, *mounts, bodies, inside, end):
                    break
                self._hold_apart(limb, after, path, (start, end), found, bodies, inside)
            else:
                if all(found.values()):
                    return Way(kind, -1, pair, found)
        return Way(kind, -1, -1, dict.fromkeys(left, 0))

    def _hold_apart(
        self, limb: int, after: Sequence[int], path: tuple[Any, ...], swing: tuple[Array, Array], left: dict[int, int],
        bodies: tuple[Any, ...], inside: bool,
    ) -> None:  # fmt: skip
        """Take from `left` the branches on which a limb cannot hold while `limb` swings, or two limbs come near each other."""
        solver = self.solver
        mounts = (solver.mount_rotations, solver.mount_positions, solver.lengths)
        for i, mask in left.items():
            point = after[i]
            left[i] = int(
                holding(
                    i, mask, self.grips[point], solver.tools[point], path, limb, *swing, *mounts, bodies, inside
                )
            )  # fmt: skip
        for i, j in combinations(left, 2) if inside else ():
            a, b = after[i], after[j]
            first, second = together_apart(
                i, j, left[i], left[j], self.grips[a], solver.tools[a], self.grips[b], solver.tools[b], path, *mounts, bodies,
            )  # fmt: skip
            left[i], left[j] = int(first), int(second)

    def clear_of_obstacles(
        self, chosen: IntArray, points: IntArray, position: Array, rotation: Array, branch: IntArray, mask: IntArray
    ) -> None:
        """Take the branches that touch an obstacle out of the masks of some stances.

        Args:
            chosen: Indices of the stances to look at.
            points: Point indices of all, shape (k, N).
            position: Base positions [m], shape (k, 3).
            rotation: Base rotations, shape (k, 3, 3).
            branch: The postures' own branches, shape (k, N).
            mask: Branches and flips of each limb, shape (k, N), changed.
        """
        solver, bodies = self.solver, self.hindrance.arrays
        in_parallel(
            len(chosen), clear_of_world, chosen, points, solver.points, solver.normals, self.robot.tool_length, position,
            rotation, branch, mask, True, solver.mount_rotations, solver.mount_positions, solver.lengths, bodies,
            np.zeros(len(points), dtype=np.int64),
        )  # fmt: skip
        hands = np.zeros(len(self.grasp_map), dtype=np.int64)
        hands_clear(solver.points, solver.normals, self.robot.tool_length, solver.lengths, bodies, hands)
        mask[(hands[points] > 0).any(axis=1)] = 0

    def hold(self, kind: int, pivot: Array, point: int, limb: int, posture: Postures, mask: int) -> int:
        """Those of the branches and flips in `mask` on which a limb can hold along a base path.

        Args:
            kind: `STRAIGHT` or `ARC`.
            pivot: Centre of the arc [m], shape (3,).
            point: Point index that the limb holds.
            limb: The limb.
            posture: Postures at both ends of the path.
            mask: 16-bit mask.
        """
        solver, robot = self.solver, self.robot
        return int(
            hold_mask(
                kind,
                pivot,
                self.grips[point],
                solver.tools[point],
                posture.position[0],
                posture.rotation[0],
                posture.position[1],
                posture.rotation[1],
                solver.mount_rotations[limb],
                solver.mount_positions[limb],
                solver.lengths,
                self.settings.path_floor * robot.characteristic_length**3,
                solver.limits,
                solver.full_turn,
                mask,
            )  # fmt: skip
        )


def _path(kind: int, pivot: Array, posture: Postures) -> tuple[Any, ...]:
    """A base path between two postures as the kernels take it."""
    return (posture.position[0], posture.rotation[0], posture.position[1], posture.rotation[1], kind, pivot)


def join(first: Postures, second: Postures) -> Postures:
    """Postures of two groups one after the other."""
    return Postures(*(np.concatenate([getattr(first, name), getattr(second, name)]) for name in FIELDS))


def stance_graph(
    grasp_map: GraspMap | None = None, robot: str | RobotSpec = "mlivr2", settings: Settings | None = None
) -> PairGraph | LazyGraph:
    """Stance graph of a robot on a map.

    Args:
        grasp_map: By default the measured JEM.
        robot: Name, path of a JSON file, or description.
        settings: Thresholds and switches; by default the paper's, with steps checked.

    Raises:
        RobotError: If the robot cannot hold any stance on the map.

    Example:
        >>> graph = stance_graph()
        >>> len(graph.grasp_map)
        331
    """
    from mlivr_gym.lazy_graph import LazyGraph
    from mlivr_gym.pair_graph import PairGraph

    grasp_map, robot, settings = grasp_map or jem_map(), robot_spec(robot), settings or Settings()
    if robot.limbs > 2:
        return LazyGraph(grasp_map, robot, settings)
    with second_process("mlivr_gym.planner_kernels", not is_cached(solve_geometries)):
        graph = PairGraph(grasp_map, robot, settings)
    if not len(graph):
        raise RobotError(f"robot {robot.name!r} cannot hold any stance on map {grasp_map.name!r}: {graph.no_stance()}")
    return graph
