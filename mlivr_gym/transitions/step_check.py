"""How one step of a stance graph is made, for any number of limbs.

The steps of two limbs are worked out row by row in `pair_kernels`; here is the same for one step at
a time, which graphs of more limbs and plans ask for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.collisions.collision_model import CollisionModel
from mlivr_gym.collisions.swept_hold import BOTH, MOVER, STANDING
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT
from mlivr_gym.kinematics.holding import hold_mask
from mlivr_gym.postures.solver import Postures, PostureSolver
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.transitions.grasp_poses import place_branches
from mlivr_gym.transitions.line_swings import TRIES, lifted_at, line_free, pairs_by_travel
from mlivr_gym.transitions.release import TOGETHER, carried, holding, release, together_apart
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


class State(NamedTuple):
    """A stance and, for each limb, the branches and flips it may still be on.

    A limb that holds keeps its branch, so every step takes branches away from the limbs that hold;
    a limb that lands has all of them again.
    """

    stance: tuple[int, ...]
    """Point index of each limb."""
    masks: tuple[int, ...]
    """16-bit mask of each limb, bit `branch + 8 * flip`."""
    pose: tuple[float, ...] | None = None
    """Base pose x, y, z [m] and quaternion w, x, y, z of a robot that does not stand in the stance's own posture."""


@dataclass(frozen=True)
class Transition:
    """What one step leaves.

    Attributes:
        pivot: Centre of a base path that is an arc: the centroid of the held points [m], shape
            (3,).
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
    kept: dict[int, int]
    """Branches on which the limbs that hold can do so."""


class StepChecks(ABC):
    """What the steps of a robot on a map are checked for; `StanceGraph` adds the stances."""

    grasp_map: GraspMap
    robot: RobotSpec
    settings: Settings
    solver: PostureSolver
    """What works postures out."""
    obstacles: tuple[Box, ...]
    """What stands in the way at present, besides the map's own boxes."""
    obstacle_model: CollisionModel
    """The obstacles in the form the compiled checks read."""

    @property
    def limbs(self) -> int:
        """Number of limbs."""
        return self.robot.limbs

    @abstractmethod
    def posture(self, stance: Sequence[int]) -> Postures:
        """Posture of one stance given by point indices, every array with a leading 1."""

    @abstractmethod
    def posture_of(self, state: State) -> Postures:
        """Posture in which a robot stands in a state: that of its stance, or one of its own."""

    @property
    def checks(self) -> list[tuple[tuple[Any, ...], bool]]:
        """What motions are checked against: bodies, and whether with the robot's own shapes."""
        if not self.settings.collisions:
            return []
        found = [(self.solver.collision_model.arrays, True)]
        return [*found, (self.obstacle_model.arrays, False)] if self.obstacles else found

    def transition(
        self, state: State, after: Sequence[int], posture: Postures
    ) -> Transition | None:
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
            # What holding limbs cannot follow need not be looked at for collisions, which takes
            # longer.
            if not any(
                self._holds(k, pivot, held, after, posture, before, masks) for k in (STRAIGHT, ARC)
            ):
                return None
            ends = (
                (state.stance, posture.take(slice(0, 1))),
                (tuple(after), posture.take(slice(1, 2))),
            )
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
                kept = (
                    {} if gained else self._holds(kind, pivot, held, after, posture, wanted, masks)
                )
                if kept:
                    between = (state.stance[limb], after[limb]), (first & 0xFFFF, masks[limb])
                    kept = self._direct(kind, pivot, limb, after, posture, kept, *between).kept
                    gained = kept if all(kept.values()) else {}
        if not gained:
            return None
        return Transition(pivot, tuple(gained.get(i, masks[i]) for i in range(self.limbs)))

    def _stages(
        self, before: list[int], held: list[int], ends: tuple[tuple[tuple[int, ...], Postures], ...]
    ) -> list[list[int]]:
        """Branches of the limbs that hold in the order in which they are looked at.

        First those on which a limb could let go before the step and after it, as one must that
        landed just before or moves just after; for one limb that holds then the others. For more
        the pairs of branches would be too many.
        """
        both, some, rest = (list(before) for _ in range(3))
        for i in held:
            first, second = (self.released(*end, i) & 0xFFFF for end in ends)
            both[i] &= first & second
            some[i] &= (first | second) & ~(first & second)
            rest[i] &= ~(first | second)
        return [both, some, rest] if len(held) == 1 else [both]

    def _gained(
        self, limb: int, held: list[int], pivot: Array, after: Sequence[int], posture: Postures,
        before: list[int],
        masks: list[int], together: int,
    ) -> dict[int, int]:  # fmt: skip
        """Branches left to the limbs that hold while `limb` is carried folded, empty if one has none."""
        gained = dict.fromkeys(held, 0)
        for kind in (STRAIGHT, ARC):
            wanted = [b & ~gained.get(i, 0) for i, b in enumerate(before)]
            kept = self._holds(kind, pivot, held, after, posture, wanted, masks)
            if self.settings.collisions and kept:
                kept = self._carry(kind, pivot, limb, after, posture, kept, together).kept
            if len(held) == 1:
                # One limb may take some branches along the line and others along the arc.
                gained[held[0]] |= kept.get(held[0], 0)
            elif kept and all(kept.values()):
                return kept
        return gained if all(gained.values()) else {}

    def _holds(
        self, kind: int, pivot: Array, held: list[int], after: Sequence[int], posture: Postures,
        before: Sequence[int],
        masks: Sequence[int],
    ) -> dict[int, int]:  # fmt: skip
        """Branches on which each limb that holds can follow a base path, none at all if one limb cannot."""
        kept: dict[int, int] = {}
        for i in held:
            kept[i] = self.hold(kind, pivot, after[i], i, posture, before[i] & masks[i])
            if not kept[i]:
                return {}
        return kept

    def way(
        self,
        before: Sequence[int],
        after: Sequence[int],
        limb: int,
        posture: Postures,
        masks: Sequence[int],
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
            kept = {i: self.hold(kind, pivot, after[i], i, posture, int(masks[i])) for i in held}
            if all(kept.values()):
                if not self.settings.collisions:
                    return Way(kind, -1, -1, kept)
                chances.append((kind, kept))
        first = self.released(tuple(before), posture.take(slice(0, 1)), limb)
        second = self.released(tuple(after), posture.take(slice(1, 2)), limb)
        together = (first & second) >> TOGETHER & 15
        for kind, kept in chances:
            found = self._carry(kind, pivot, limb, after, posture, dict(kept), together)
            if all(found.kept.values()):
                return found
        between = (before[limb], after[limb]), (first & 0xFFFF, second & 0xFFFF)
        for kind, kept in chances:
            found = self._direct(kind, pivot, limb, after, posture, dict(kept), *between)
            if all(found.kept.values()):
                return found
        return Way(ARC, -1, -1, {})

    def released(self, stance: tuple[int, ...], posture: Postures, limb: int) -> int:
        """On which branches a limb can let go of a stance, see `release_kernels.release`; 0 if on none."""
        solver, robot, limbs = self.solver, self.robot, self.limbs
        here = (
            np.ascontiguousarray(posture.position[0]),
            np.ascontiguousarray(posture.rotation[0]),
        )
        mounts = (solver.mount_rotations, solver.mount_positions, solver.lengths)
        answer, wanted, point = -1, int(posture.mask[0, limb]), stance[limb]
        if not self.settings.collisions:
            return wanted
        for collision_model, inside in self.checks:
            placed, count = np.empty((8 * (limbs - 1), len(solver.shapes), 2, 3)), 0
            for other in range(limbs):
                if inside and other != limb:
                    grasp = stance[other]
                    count = place_branches(
                        other, int(posture.mask[0, other]), solver.points[grasp],
                        solver.normals[grasp], robot.tool_length,
                        *here, *mounts, collision_model[0], count, placed,
                    )  # fmt: skip
            answer = int(
                release(
                    limb, wanted, solver.points[point], solver.normals[point], solver.rails[point],
                    robot.tool_length,
                    robot.lift, *here, placed[:count], solver.folds, solver.limits, *mounts, collision_model,
                    inside, answer,
                )
            )  # fmt: skip
            wanted = answer & 0xFFFF
            if not wanted:
                return 0
        return answer

    def landed(self, state: State, limb: int) -> int:
        """Branches and flips on which a limb may be that has just taken hold where the robot stands in `state`."""
        posture = self.posture_of(state)
        if not self.settings.transitions:
            return int(posture.mask[0, limb])
        return self.released(state.stance, posture, limb) & 0xFFFF

    def _carry(
        self,
        kind: int,
        pivot: Array,
        limb: int,
        after: Sequence[int],
        posture: Postures,
        kept: dict[int, int],
        together: int,
    ) -> Way:
        """The first fold in which `limb` can be carried along a base path, and the branches left to the limbs that hold."""
        solver, path, swing = self.solver, _path(kind, pivot, posture), np.empty(6)
        mounts = (solver.mount_rotations, solver.mount_positions, solver.lengths)
        fold = -1
        for collision_model, inside in self.checks:
            fold = (
                int(
                    carried(
                        limb, together, path, solver.folds, *mounts, collision_model, inside, swing
                    )
                )
                if together
                else -1
            )
            if fold < 0:
                return Way(kind, -1, -1, dict.fromkeys(kept, 0))
            # Another fold might serve the next world; the first must serve all.
            together = 1 << fold
        return Way(kind, fold, -1, self._hold_apart(limb, after, path, (swing, swing), kept, BOTH))

    def _direct(
        self,
        kind: int,
        pivot: Array,
        limb: int,
        after: Sequence[int],
        posture: Postures,
        kept: dict[int, int],
        points: tuple[int, int],
        masks: tuple[int, int],
    ) -> Way:
        """The first pair of branches between which `limb` can swing directly, and the branches left to those that hold."""
        solver, robot, path = self.solver, self.robot, _path(kind, pivot, posture)
        mounts = (solver.mount_rotations, solver.mount_positions, solver.lengths)
        q, order, end = np.empty((2, 8, 6)), np.empty(64, dtype=np.int64), np.empty(6)
        there = [
            lifted_at(
                limb, mask, solver.points[p], solver.normals[p], solver.rails[p], robot.tool_length,
                robot.lift, path[2 * k],
                path[2 * k + 1], *mounts, solver.limits, angles,
            )
            for k, (p, mask, angles) in enumerate(zip(points, masks, q, strict=True))
        ]  # fmt: skip
        count = pairs_by_travel(there[0], q[0], there[1], q[1], solver.limits, order)
        standing: dict[int, int] | None = None
        for pair in order[: min(count, TRIES)].tolist():
            start, goal = q[0, pair >> 3], q[1, pair & 7]
            if not all(
                line_free(
                    limb, start, goal, path, solver.limits, *mounts, collision_model, inside, end
                )
                for collision_model, inside in self.checks
            ):
                continue
            if standing is None:
                # Whether the limbs that hold can stay does not depend on the swing, but for the
                # limb that makes it.
                standing = self._hold_apart(limb, after, path, (start, end), kept, STANDING)
                if not all(standing.values()):
                    break
            found = self._hold_apart(limb, after, path, (start, end), standing, MOVER)
            if all(found.values()):
                return Way(kind, -1, pair, found)
        return Way(kind, -1, -1, dict.fromkeys(kept, 0))

    def _hold_apart(
        self, limb: int, after: Sequence[int], path: tuple[Any, ...], swing: tuple[Array, Array],
        kept: dict[int, int], parts: int
    ) -> dict[int, int]:  # fmt: skip
        """Those of the branches in `kept` on which limbs can hold while `limb` swings, no two of them near each other.

        If one limb has none the rest is not looked at. `parts` as in `hold_kernels.hold_free`.
        """
        solver, kept = self.solver, dict(kept)
        mounts = (solver.mount_rotations, solver.mount_positions, solver.lengths)
        for collision_model, inside in self.checks:
            for i, mask in kept.items():
                point = after[i]
                kept[i] = int(
                    holding(
                        i, mask, solver.flanges[point], solver.tools[point], path, limb, *swing,
                        *mounts, collision_model, inside, parts
                    )
                )  # fmt: skip
                if not kept[i]:
                    return kept
            for i, j in combinations(kept, 2) if inside and parts & STANDING else ():
                a, b = after[i], after[j]
                first, second = together_apart(
                    i, j, kept[i], kept[j], solver.flanges[a], solver.tools[a], solver.flanges[b],
                    solver.tools[b],
                    path, *mounts, collision_model,
                )  # fmt: skip
                kept[i], kept[j] = int(first), int(second)
                if not (first and second):
                    return kept
        return kept

    def hold(
        self, kind: int, pivot: Array, point: int, limb: int, posture: Postures, mask: int
    ) -> int:
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
                solver.flanges[point],
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
    return (
        posture.position[0],
        posture.rotation[0],
        posture.position[1],
        posture.rotation[1],
        kind,
        pivot,
    )
