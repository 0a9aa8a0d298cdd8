"""How one step of a stance graph is checked, for any number of limbs.

The steps of two limbs are worked out row by row in `stances.pair_steps`; here is the same for one
step at a time, which graphs of more limbs and plans ask for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.collision_model import CollisionModel
from mlivr_gym.collisions.swept_hold import BOTH, MOVER, STANDING
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT
from mlivr_gym.kinematics.holding import hold_mask
from mlivr_gym.postures.solver import Postures, PostureSolver
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.transitions.candidate import Candidate, Edge
from mlivr_gym.transitions.grasp_poses import place_branches
from mlivr_gym.transitions.line_swings import TRIES, lifted_at, line_free, pairs_by_travel
from mlivr_gym.transitions.release import FOLDS_AT, both_apart, folded_swing, holding, release
from mlivr_gym.transitions.rule import BRANCH_BITS, can_release, mask_of_grasp
from mlivr_gym.transitions.state import State, moving_limb
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap


class StepChecks(ABC):
    """What the steps of a robot on a map are checked for; `StanceGraph` adds the stances."""

    grasp_map: GraspMap
    robot: RobotSpec
    settings: Settings
    solver: PostureSolver
    """What works postures out."""
    obstacles: tuple[Box, ...]
    """Boxes in the world at present besides those of the map."""
    obstacle_model: CollisionModel
    """The robot among the obstacles, as the compiled checks read it."""

    @property
    def limbs(self) -> int:
        """Number of limbs."""
        return self.robot.limbs

    @abstractmethod
    def posture(self, stance: Sequence[int]) -> Postures:
        """Posture of one stance given by point indices, every array with a leading 1."""

    @abstractmethod
    def posture_of(self, state: State) -> Postures:
        """Posture in which a robot stands in a state: that of its stance, or the one given."""

    @property
    def checks(self) -> list[tuple[tuple[Any, ...], bool]]:
        """What motions are checked against: collision models, and whether with the robot itself."""
        if not self.settings.collisions:
            return []
        models = [(self.solver.collision_model.arrays, True)]
        return [*models, (self.obstacle_model.arrays, False)] if self.obstacles else models

    @property
    def _mounts(self) -> tuple[Array, Array, Array]:
        """Where the limbs are mounted on the base and how long their links are, for the kernels."""
        return self.solver.mount_rotations, self.solver.mount_positions, self.solver.lengths

    def candidate(
        self, before: tuple[int, ...], after: tuple[int, ...], posture: Postures
    ) -> Candidate:
        """The step between two neighbouring stances, whose postures are given in this order."""
        limb = moving_limb(before, after)
        held = tuple(i for i in range(self.limbs) if i != limb)
        pivot = self.grasp_map.positions[[after[i] for i in held]].mean(axis=0)
        return Candidate(limb, before, after, posture, pivot, held)

    def transition(self, state: State, after: Sequence[int], posture: Postures) -> State | None:
        """The state after a step, or None if no such step leaves the state.

        Args:
            state: The state before the step.
            after: Point index of each limb after the step.
            posture: Postures of the two stances, in this order.
        """
        step = self.candidate(state.stance, tuple(after), posture)
        masks = [int(m) for m in posture.mask[1]]
        if not self.settings.transitions:
            return State(step.after, tuple(masks))
        before = [int(m) for m in state.masks]
        if not self.settings.collisions:
            kept = self._kept_folded(step, before, masks, 0)
        else:
            kept = self._kept(step, before, masks)
        if not kept:
            return None
        return State(step.after, tuple(kept.get(i, masks[i]) for i in range(self.limbs)))

    def _kept(self, step: Candidate, before: list[int], masks: list[int]) -> dict[int, int]:
        """Branches that the limbs that hold keep, none if no such step leaves the state.

        Collisions are checked. `masks` are those at the stance after the step; that of the limb
        that moves is set to those on which it can be released there.
        """
        # What holding limbs cannot follow need not be checked for collisions, which takes longer.
        if not any(self._holds(step, k, before, masks) for k in (STRAIGHT, ARC)):
            return {}
        limb = step.limb
        first, second = (self.released(*end, limb) for end in step.ends)
        masks[limb] = mask_of_grasp(second)
        if not can_release(before[limb], first) or not masks[limb]:
            return {}
        stages = self._stages(step, before)
        for some in stages:
            if all(some[i] for i in step.held):
                kept = self._kept_folded(step, some, masks, (first & second) >> FOLDS_AT & 15)
                if kept:
                    return kept
        wanted, kept = before if self.limbs == 2 else stages[0], {}
        for kind in (STRAIGHT, ARC):
            holding_limbs = {} if kept else self._holds(step, kind, wanted, masks)
            if holding_limbs:
                line = self._line(step, kind, holding_limbs, (mask_of_grasp(first), masks[limb]))
                kept = line.kept if all(line.kept.values()) else {}
        return kept

    def _stages(self, step: Candidate, before: list[int]) -> list[list[int]]:
        """Branches of the limbs that hold in the order in which they are checked.

        First those on which a limb can be released before the step and after it, as one must be
        that grasped just before or moves just after; for one limb that holds then the others. For
        more the pairs of branches would be too many.
        """
        both, some, rest = (list(before) for _ in range(3))
        for i in step.held:
            first, second = (mask_of_grasp(self.released(*end, i)) for end in step.ends)
            both[i] &= first & second
            some[i] &= (first | second) & ~(first & second)
            rest[i] &= ~(first | second)
        return [both, some, rest] if len(step.held) == 1 else [both]

    def _kept_folded(
        self, step: Candidate, before: list[int], masks: list[int], folds: int
    ) -> dict[int, int]:
        """Branches that limbs that hold keep while the other moves folded, none if one has none.

        Args:
            step: The step.
            before: Branches of each limb to check.
            masks: Branches of each limb at the stance after the step.
            folds: Folds that the limb that moves can take at both stances, as bits.
        """
        held, found = step.held, dict.fromkeys(step.held, 0)
        for kind in (STRAIGHT, ARC):
            wanted = [b & ~found.get(i, 0) for i, b in enumerate(before)]
            kept = self._holds(step, kind, wanted, masks)
            if self.settings.collisions and kept:
                kept = self._folded(step, kind, kept, folds).kept
            if len(held) == 1:
                # One limb may take some branches along the line and others along the arc.
                found[held[0]] |= kept.get(held[0], 0)
            elif kept and all(kept.values()):
                return kept
        return found if all(found.values()) else {}

    def _holds(
        self, step: Candidate, kind: int, before: Sequence[int], masks: Sequence[int]
    ) -> dict[int, int]:
        """Branches on which each limb that holds can follow a base path, none if one cannot."""
        kept: dict[int, int] = {}
        for i in step.held:
            kept[i] = self.hold(step, kind, i, before[i] & masks[i])
            if not kept[i]:
                return {}
        return kept

    def edge(self, state: State, after: Sequence[int], posture: Postures) -> Edge:
        """The edge that a step is: its base path, its swing and the branches kept.

        Args:
            state: Stance before the step, and the branch and flip each limb is on, as masks.
            after: Point index of each limb after it.
            posture: Postures of the two stances.
        """
        step = self.candidate(state.stance, tuple(after), posture)
        paths: list[tuple[int, dict[int, int]]] = []
        for kind in (STRAIGHT, ARC):
            kept = {i: self.hold(step, kind, i, int(state.masks[i])) for i in step.held}
            if all(kept.values()):
                if not self.settings.collisions:
                    return Edge(kind, -1, -1, kept)
                paths.append((kind, kept))
        first, second = (self.released(*end, step.limb) for end in step.ends)
        for kind, kept in paths:
            found = self._folded(step, kind, kept, (first & second) >> FOLDS_AT & 15)
            if all(found.kept.values()):
                return found
        for kind, kept in paths:
            found = self._line(step, kind, kept, (mask_of_grasp(first), mask_of_grasp(second)))
            if all(found.kept.values()):
                return found
        return Edge(ARC, -1, -1, {})

    def released(self, stance: tuple[int, ...], posture: Postures, limb: int) -> int:
        """On which branches a limb can be released at a stance, 0 if on none; see `release`."""
        solver, robot, limbs = self.solver, self.robot, self.limbs
        here = (
            np.ascontiguousarray(posture.base_position[0]),
            np.ascontiguousarray(posture.base_rotation[0]),
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
                    robot.tool_length, robot.lift, *here, placed[:count], solver.folds,
                    solver.limits, *mounts, collision_model, inside, answer,
                )
            )  # fmt: skip
            wanted = answer & BRANCH_BITS
            if not wanted:
                return 0
        return answer

    def mask_after_grasp(self, state: State, limb: int) -> int:
        """Branches and flips on which a limb may be that has just grasped, in a state's posture."""
        posture = self.posture_of(state)
        if not self.settings.transitions:
            return int(posture.mask[0, limb])
        return int(mask_of_grasp(self.released(state.stance, posture, limb)))

    def _folded(self, step: Candidate, kind: int, kept: dict[int, int], folds: int) -> Edge:
        """The edge on which the limb moves in the first fold in which it can, of those in `folds`.

        `kept` are the branches of the limbs that hold that are checked; none is kept if there is no
        such fold.
        """
        path, swing = step.path(kind), np.empty(6)
        fold = -1
        for collision_model, inside in self.checks:
            fold = (
                int(
                    folded_swing(
                        step.limb, folds, path, self.solver.folds, *self._mounts, collision_model,
                        inside, swing,
                    )
                )
                if folds
                else -1
            )  # fmt: skip
            if fold < 0:
                return Edge(kind, -1, -1, dict.fromkeys(kept, 0))
            # Another fold might serve the next world; the first must serve all.
            folds = 1 << fold
        return Edge(kind, fold, -1, self._hold_apart(step, path, (swing, swing), kept, BOTH))

    def _line(
        self, step: Candidate, kind: int, kept: dict[int, int], masks: tuple[int, int]
    ) -> Edge:
        """The edge on which the limb swings along a line, on the first pair of branches that can.

        Args:
            step: The step.
            kind: Kind of the base path.
            kept: Branches of the limbs that hold that are checked; none is kept if no pair can.
            masks: Branches on which the limb that moves can be released before the step and after.
        """
        solver, robot, path = self.solver, self.robot, step.path(kind)
        q, order, end = np.empty((2, 8, 6)), np.empty(64, dtype=np.int64), np.empty(6)
        points = step.before[step.limb], step.after[step.limb]
        there = [
            lifted_at(
                step.limb, mask, solver.points[p], solver.normals[p], solver.rails[p],
                robot.tool_length, robot.lift, path[2 * k], path[2 * k + 1], *self._mounts,
                solver.limits, angles,
            )
            for k, (p, mask, angles) in enumerate(zip(points, masks, q, strict=True))
        ]  # fmt: skip
        count = pairs_by_travel(there[0], q[0], there[1], q[1], solver.limits, order)
        standing: dict[int, int] | None = None
        for pair in order[: min(count, TRIES)].tolist():
            start, goal = q[0, pair >> 3], q[1, pair & 7]
            if not all(
                line_free(
                    step.limb, start, goal, path, solver.limits, *self._mounts, collision_model,
                    inside, end,
                )
                for collision_model, inside in self.checks
            ):  # fmt: skip
                continue
            if standing is None:
                # Whether the limbs that hold can stay does not depend on the swing, but for the
                # limb that makes it.
                standing = self._hold_apart(step, path, (start, end), kept, STANDING)
                if not all(standing.values()):
                    break
            found = self._hold_apart(step, path, (start, end), standing, MOVER)
            if all(found.values()):
                return Edge(kind, -1, pair, found)
        return Edge(kind, -1, -1, dict.fromkeys(kept, 0))

    def _hold_apart(
        self, step: Candidate, path: tuple[Any, ...], swing: tuple[Array, Array],
        kept: dict[int, int], parts: int,
    ) -> dict[int, int]:  # fmt: skip
        """Those of the branches in `kept` on which limbs hold clear of each other and of the swing.

        If one limb has none the others are not checked.

        Args:
            step: The step.
            path: The base path, see `Candidate.path`.
            swing: Joint angles of the limb that moves at both ends [rad].
            kept: Branches of each limb that holds.
            parts: As in `swept_hold.hold_free`.
        """
        solver, kept = self.solver, dict(kept)
        for collision_model, inside in self.checks:
            for i, mask in kept.items():
                point = step.after[i]
                kept[i] = int(
                    holding(
                        i, mask, solver.flanges_in_world[point], solver.flange_axes_in_world[point],
                        path, step.limb,
                        *swing, *self._mounts, collision_model, inside, parts,
                    )
                )  # fmt: skip
                if not kept[i]:
                    return kept
            for i, j in combinations(kept, 2) if inside and parts & STANDING else ():
                a, b = step.after[i], step.after[j]
                first, second = both_apart(
                    i, j, kept[i], kept[j], solver.flanges_in_world[a],
                    solver.flange_axes_in_world[a],
                    solver.flanges_in_world[b], solver.flange_axes_in_world[b], path, *self._mounts,
                    collision_model,
                )  # fmt: skip
                kept[i], kept[j] = int(first), int(second)
                if not (first and second):
                    return kept
        return kept

    def hold(self, step: Candidate, kind: int, limb: int, mask: int) -> int:
        """Those of the branches and flips in `mask` on which a limb can hold along a base path."""
        solver, point = self.solver, step.after[limb]
        t0, r0, t1, r1, _, pivot = step.path(kind)
        floor = self.settings.path_floor * self.robot.characteristic_length**3
        return int(
            hold_mask(
                kind, pivot, solver.flanges_in_world[point], solver.flange_axes_in_world[point], t0,
                r0, t1, r1,
                solver.mount_rotations[limb], solver.mount_positions[limb], solver.lengths,
                floor, solver.limits, solver.full_turn, mask,
            )
        )  # fmt: skip
