"""The releases and steps of a robot on a map, among the present obstacles."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.errors import StanceError
from mlivr_gym.postures.postures import FIELDS, Postures
from mlivr_gym.schema import FieldPath, Integer
from mlivr_gym.stances.obstacles import ChangingWorld
from mlivr_gym.transitions.edge import Edge, edge_of
from mlivr_gym.transitions.records import StanceArrays
from mlivr_gym.transitions.state import State, Successors

Pieces = Callable[[str, int], Iterable[slice]]
"""A function that divides a number of items of some kind into pieces, to work on them in turn."""


def at_once(kind: str, count: int) -> Iterable[slice]:
    """Return one piece with all items."""
    return (slice(count),)


class CheckedSteps(ChangingWorld):
    """Releases and steps between stances whose postures are given; results are not stored."""

    @abstractmethod
    def posture_of(self, state: State) -> Postures:
        """Return the posture of a state: that of its stance, or the pose that a user gave."""

    @abstractmethod
    def neighbouring_nodes(
        self, stance: tuple[int, ...], pieces: Pieces = at_once
    ) -> tuple[IntArray, Postures]:
        """Return the nodes in which one limb holds another point, shape (k, N), and their postures.

        They are in the order of limbs and points; steps to them are not checked.
        """

    @property
    def limbs(self) -> int:
        """Number of limbs."""
        return self.robot.limbs

    def releasable_branches(self, stance: tuple[int, ...], posture: Postures, limb: int) -> int:
        """Return the branches on which a limb can be released at a stance, 0 if none."""
        stances = self.checks.stances(np.array([stance]), posture)
        self._check_releases(stances, np.array([[0, limb]]))
        return int(stances.releases["branches"][0, limb])

    def all_releases(self, points: IntArray, postures: Postures) -> Any:
        """Return the releases of all limbs at stances: rows of `ReleaseRecord`, shape (k, N)."""
        stances = self.checks.stances(points, postures)
        self._check_releases(stances, np.indices(points.shape).reshape(2, -1).T)
        return stances.releases

    def _check_releases(self, stances: StanceArrays, todo: IntArray) -> None:
        """Compute releases that are not known: rows and limbs, shape (k, 2)."""
        todo = todo[~stances.releases["known"][todo[:, 0], todo[:, 1]]]
        self.checks.release(stances, todo, self.checks.world(self.obstacle_grid))

    def branch_set_after_grasp(self, state: State, limb: int) -> int:
        """Return the branches and flips that a limb may be on after it has grasped."""
        Integer(0, self.limbs - 1).read(limb, FieldPath("limb", StanceError))
        posture = self.posture_of(state)
        if not self.settings.transitions:
            return int(posture.branch_sets[0, limb])
        return self.releasable_branches(state.stance, posture, limb)

    def branch_sets_after(
        self,
        states: Sequence[State],
        here: Postures,
        before: IntArray,
        stances: IntArray,
        after: Postures,
    ) -> Any:
        """Return the branch sets after steps from states, shape (k, N); 0 without a step.

        Step k leaves the state of index `before[k]`, with the posture of that index in `here`, and
        leads to stance k with posture k of `after`.
        """
        if not self.settings.transitions or not len(stances):
            return after.branch_sets.copy()
        points = np.concatenate([np.array([s.stance for s in states], dtype=np.int64), stances])
        found = self.checks.stances(points, join(here, after))
        branch_sets = np.array([s.branch_sets for s in states], dtype=np.int64)[before]
        steps = self.checks.steps(found, before, np.arange(len(states), len(points)))
        return self.branch_sets_of_steps(steps, found, branch_sets)

    def successors_by_pieces(self, state: State, pieces: Pieces) -> Successors:
        """Return all steps that leave a state, checked piece by piece."""
        stances, postures = self.neighbouring_nodes(state.stance, pieces)
        here, found = self.posture_of(state), [postures.branch_sets[:0]]
        for piece in pieces("steps", len(stances)):
            after, first = stances[piece], np.zeros(len(stances[piece]), dtype=np.int64)
            found.append(self.branch_sets_after([state], here, first, after, postures.take(piece)))
        branch_sets = np.concatenate(found)
        kept = branch_sets.all(axis=1)
        limb = (stances[kept] != state.stance).argmax(axis=1)
        point, position = stances[kept, limb], postures.base_position[kept]
        return Successors(limb, point, position, branch_sets[kept])

    def branch_sets_of_steps(self, steps: Any, stances: StanceArrays, before: IntArray) -> IntArray:
        """Return the branch sets of all limbs after steps, shape (k, N); 0 for what is no step.

        The steps are those of `StepChecks.steps`, the branch sets before them have shape (k, N);
        stances receive the releases that are computed.
        """
        world = self.checks.world(self.obstacle_grid)
        able = np.arange(len(steps))
        if not stances.releases["known"].all():
            # Releases take longer to compute than whether the support limbs can follow.
            able = np.flatnonzero(self.checks.can_follow(steps, stances, world))
        if self.settings.collisions:
            able = self._releasable_steps(stances, steps, able, before)
        chosen = steps[able]
        self.checks.check(chosen, stances, world)
        kept, limb = chosen["kept"][:, : self.limbs] & before[able], chosen["limb"]
        branch_sets: IntArray = np.zeros((len(steps), self.limbs), dtype=np.int64)
        branch_sets[able] = kept
        grasped = stances.releases["branches"] if self.settings.collisions else stances.branch_sets
        branch_sets[able, limb] = grasped[chosen["after"], limb]
        branch_sets[~branch_sets.all(axis=1)] = 0
        return branch_sets

    def _releasable_steps(
        self, stances: StanceArrays, steps: Any, able: IntArray, before: IntArray
    ) -> IntArray:
        """Return the indices of steps whose limb can be released before and after them.

        The releases of these limbs are then known. Branch sets before steps have shape (k, N).
        """
        for end in ("before", "after"):
            row, limb = steps[end][able], steps["limb"][able]
            if not stances.releases["known"][row, limb].all():
                self._check_releases(stances, np.unique(np.stack([row, limb], axis=1), axis=0))
            branches = stances.releases["branches"][row, limb]
            if end == "before":
                able = able[before[able, limb] & branches != 0]
            else:
                able = able[branches != 0]
        return able

    def edge(self, state: State, after: Sequence[int], posture: Postures) -> Edge:
        """Return the edge of a step on which supports keep the branches of a state at most.

        `posture` has the postures of both stances.
        """
        points = np.array([state.stance, tuple(after)], dtype=np.int64)
        stances = self.checks.stances(points, posture)
        steps = self.checks.steps(stances, np.zeros(1, np.int64), np.ones(1, np.int64))
        limb = int(steps["limb"][0])
        if self.settings.collisions:
            self._check_releases(stances, np.array([[0, limb], [1, limb]]))
        branch_sets = np.tile(np.array(state.branch_sets, dtype=np.int64), (2, 1))
        stances = stances._replace(branch_sets=branch_sets)
        self.checks.check(steps, stances, self.checks.world(self.obstacle_grid))
        return edge_of(steps[0])


def join(*groups: Postures) -> Postures:
    """Return the postures of several groups in order."""
    return Postures(*(np.concatenate([getattr(g, name) for g in groups]) for name in FIELDS))
