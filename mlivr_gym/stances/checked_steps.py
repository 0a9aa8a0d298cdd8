"""The steps of a robot on a map as the world is now: what can be released, and what is an edge."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import StanceError
from mlivr_gym.postures.postures import FIELDS, Postures
from mlivr_gym.schema import FieldPath, Whole
from mlivr_gym.stances.obstacles import ChangingWorld
from mlivr_gym.transitions.edge import Edge, edge_of
from mlivr_gym.transitions.records import StanceSet
from mlivr_gym.transitions.rule import can_release
from mlivr_gym.transitions.state import State, moving_limb


class CheckedSteps(ChangingWorld):
    """Releases and steps between stances whose postures are given; nothing is remembered."""

    @abstractmethod
    def posture_of(self, state: State) -> Postures:
        """Posture in which a robot stands in a state: that of its stance, or the one given."""

    @property
    def limbs(self) -> int:
        """Number of limbs."""
        return self.robot.limbs

    def released(self, stance: tuple[int, ...], posture: Postures, limb: int) -> int:
        """On which branches a limb can be released at a stance, 0 if on none."""
        stances = self.checks.stances(np.array([stance]), posture)
        self._know_released(stances, np.array([[0, limb]]))
        return int(stances.released["branches"][0, limb])

    def all_released(self, points: IntArray, postures: Postures) -> Any:
        """Rows of `Release`: how each limb can be released at some stances, shape (k, N)."""
        stances = self.checks.stances(points, postures)
        self._know_released(stances, np.indices(points.shape).reshape(2, -1).T)
        return stances.released

    def _know_released(self, stances: StanceSet, todo: IntArray) -> None:
        """Work out on which branches limbs can be released: rows and limbs, shape (k, 2)."""
        todo = todo[~stances.released["known"][todo[:, 0], todo[:, 1]]]
        self.checks.release(stances, todo, self.checks.world(self.obstacle_grid))

    def mask_after_grasp(self, state: State, limb: int) -> int:
        """Branches and flips on which a limb may be that has just grasped, in a state's posture."""
        Whole(0, self.limbs - 1).read(limb, FieldPath("limb", StanceError))
        posture = self.posture_of(state)
        if not self.settings.transitions:
            return int(posture.mask[0, limb])
        return self.released(state.stance, posture, limb)

    def pivot(self, before: tuple[int, ...], after: tuple[int, ...]) -> Array:
        """Centre of a base path that is an arc: the centroid of the held points [m], shape (3,)."""
        limb = moving_limb(before, after)
        held = [point for i, point in enumerate(after) if i != limb]
        centre: Array = self.grasp_map.positions[held].mean(axis=0)
        return centre

    def step_rows(
        self, stances: StanceSet, before: IntArray, after: IntArray, masks: IntArray
    ) -> Any:
        """Rows of `Step` between some stances.

        Parameters
        ----------
        stances
            The stances.
        before
            Rows of the stances before the steps, shape (k,).
        after
            Rows of those after them, shape (k,).
        masks
            Branches and flips of each limb before them, shape (k, N).
        """
        steps, points = self.checks.steps(len(after)), stances.points
        moves = points[after] != points[before]
        steps["limb"], steps["before"], steps["after"] = moves.argmax(axis=1), before, after
        held = self.grasp_map.positions[points[after]] * ~moves[..., None]
        steps["pivot"] = held.sum(axis=1) / (self.limbs - 1)
        steps["wanted"][:, : self.limbs] = masks
        return steps

    def masks_after(
        self,
        states: Sequence[State],
        here: Postures,
        before: IntArray,
        stances: IntArray,
        after: Postures,
    ) -> Any:
        """Masks of all limbs after steps that may leave states, shape (k, N); 0 where none does.

        Parameters
        ----------
        states
            States before the steps.
        here
            Their postures.
        before
            Index of the state that each step leaves, shape (k,).
        stances
            Point index of each limb after each step, shape (k, N).
        after
            The postures after them.
        """
        if not self.settings.transitions or not len(stances):
            return after.mask.copy()
        points = np.concatenate([np.array([s.stance for s in states], dtype=np.int64), stances])
        found = self.checks.stances(points, join(here, after))
        masks = np.array([s.masks for s in states], dtype=np.int64)[before]
        steps = self.step_rows(found, before, np.arange(len(states), len(points)), masks)
        return self.masks_of_steps(steps, found)

    def masks_of_steps(self, steps: Any, stances: StanceSet) -> IntArray:
        """Masks of all limbs after steps, shape (k, N); 0 where there is none.

        Parameters
        ----------
        steps
            Rows of `Step`, shape (k,), between the stances, see `step_rows`.
        stances
            The stances; what can be released at them is remembered there.
        """
        world = self.checks.world(self.obstacle_grid)
        able = np.arange(len(steps))
        if not stances.released["known"].all():
            # To know what can be released takes longer than to know who can hold.
            able = np.flatnonzero(self.checks.hold(steps, stances, world))
        if self.settings.collisions:
            able = self._releasable_steps(stances, steps, able)
        chosen = steps[able]
        self.checks.check(chosen, stances, world)
        kept, rows, limb = chosen["kept"][:, : self.limbs], np.arange(len(able)), chosen["limb"]
        masks: IntArray = np.zeros((len(steps), self.limbs), dtype=np.int64)
        masks[able] = kept
        grasped = stances.released["branches"] if self.settings.collisions else stances.mask
        masks[able[rows], limb] = grasped[chosen["after"], limb] * kept.any(axis=1)
        return masks

    def _releasable_steps(self, stances: StanceSet, steps: Any, able: IntArray) -> IntArray:
        """Which of some steps move a limb that can be released before and after, by index.

        What can be released at their stances is then known of these limbs, and of the one that
        holds if there is one alone: the check of a step begins with what it can be released on.
        """
        for end in ("before", "after"):
            row, limb = steps[end][able], steps["limb"][able]
            self._know_released(stances, np.unique(np.stack([row, limb], axis=1), axis=0))
            released = stances.released["branches"][row, limb]
            if end == "before":
                both = zip(steps["wanted"][able, limb].tolist(), released.tolist(), strict=True)
                able = able[np.array([can_release(*pair) for pair in both], dtype=np.bool_)]
            else:
                able = able[released != 0]
        if self.limbs > 2:
            return able
        rows = np.unique(np.concatenate([steps["before"][able], steps["after"][able]]))
        every = np.stack(np.meshgrid(rows, np.arange(self.limbs), indexing="ij"), axis=-1)
        self._know_released(stances, every.reshape(-1, 2))
        return able

    def edge(self, state: State, after: Sequence[int], posture: Postures) -> Edge:
        """The edge that a step is: its base path, its swing and the branches kept.

        Parameters
        ----------
        state
            Stance before the step, and the branch and flip each limb is on, as masks.
        after
            Point index of each limb after it.
        posture
            Postures of the two stances.
        """
        points = np.array([state.stance, tuple(after)], dtype=np.int64)
        stances = self.checks.stances(points, posture)
        first, last = np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.int64)
        steps = self.step_rows(stances, first, last, np.array([state.masks]))
        steps["given"] = True
        if self.settings.collisions:
            limb = int(steps["limb"][0])
            self._know_released(stances, np.array([[0, limb], [1, limb]]))
        self.checks.check(steps, stances, self.checks.world(self.obstacle_grid))
        return edge_of(steps[0])


def join(*groups: Postures) -> Postures:
    """Postures of groups one after the other."""
    return Postures(*(np.concatenate([getattr(g, name) for g in groups]) for name in FIELDS))
