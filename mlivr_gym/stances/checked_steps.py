"""The steps of a robot on a map as the world is now: what can be released, and what is an edge."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import StanceError
from mlivr_gym.postures.postures import FIELDS, Postures
from mlivr_gym.schema import Place, Whole
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

    def _know_released(self, stances: StanceSet, todo: IntArray) -> None:
        """Work out on which branches limbs can be released: rows and limbs, shape (k, 2)."""
        todo = todo[~stances.released["known"][todo[:, 0], todo[:, 1]]]
        self.checks.release(stances, todo, self.checks.world(self.obstacle_grid))

    def mask_after_grasp(self, state: State, limb: int) -> int:
        """Branches and flips on which a limb may be that has just grasped, in a state's posture."""
        Whole(0, self.limbs - 1).read(limb, Place("limb", StanceError))
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

    def _step_rows(self, state: State, points: IntArray) -> Any:
        """Rows of `Step` from a state to the stances after it, rows 1 to k of `points`."""
        steps = self.checks.steps(len(points) - 1)
        moves = points[1:] != points[0]
        steps["limb"], steps["after"] = moves.argmax(axis=1), np.arange(1, len(points))
        held = self.grasp_map.positions[points[1:]] * ~moves[..., None]
        steps["pivot"] = held.sum(axis=1) / (self.limbs - 1)
        steps["wanted"][:, : self.limbs] = state.masks
        return steps

    def masks_after(self, state: State, here: Postures, stances: IntArray, after: Postures) -> Any:
        """Masks of all limbs after steps that may leave a state, shape (k, N); 0 where none does.

        Args:
            state: The state before the steps.
            here: Its posture.
            stances: Point index of each limb after each step, shape (k, N).
            after: The postures after them.
        """
        masks: IntArray = after.mask.copy()
        if not self.settings.transitions or not len(stances):
            return masks
        points = np.concatenate([np.array([state.stance], dtype=np.int64), stances])
        found = self.checks.stances(points, join(here, after))
        steps, world = self._step_rows(state, points), self.checks.world(self.obstacle_grid)
        able = np.flatnonzero(self.checks.hold(steps, found, world))
        if self.settings.collisions:
            able = self._releasable_steps(state, found, steps, able)
        chosen = steps[able]
        self.checks.check(chosen, found, world)
        kept, rows, limb = chosen["kept"][:, : self.limbs], np.arange(len(able)), chosen["limb"]
        masks[:] = 0
        masks[able] = kept
        grasped = found.released["branches"] if self.settings.collisions else found.mask
        masks[able[rows], limb] = grasped[chosen["after"], limb] * kept.any(axis=1)
        return masks

    def _releasable_steps(
        self, state: State, stances: StanceSet, steps: Any, able: IntArray
    ) -> IntArray:
        """Which of some steps move a limb that can be released before and after, by index.

        What can be released at their stances is then known, for the limbs that hold too.
        """
        limb, after = steps["limb"], steps["after"]
        for first in (True, False):
            row = np.zeros_like(able) if first else after[able]
            self._know_released(stances, np.unique(np.stack([row, limb[able]], axis=1), axis=0))
            released = stances.released["branches"][row, limb[able]]
            if first:
                wanted = np.array(state.masks)[limb[able]]
                both = zip(wanted.tolist(), released.tolist(), strict=True)
                able = able[np.array([can_release(*pair) for pair in both], dtype=np.bool_)]
            else:
                able = able[released != 0]
        rows = np.unique(np.concatenate([[0], after[able]])) if len(able) else np.zeros(0, int)
        every = np.stack(np.meshgrid(rows, np.arange(self.limbs), indexing="ij"), axis=-1)
        self._know_released(stances, every.reshape(-1, 2))
        return able

    def edge(self, state: State, after: Sequence[int], posture: Postures) -> Edge:
        """The edge that a step is: its base path, its swing and the branches kept.

        Args:
            state: Stance before the step, and the branch and flip each limb is on, as masks.
            after: Point index of each limb after it.
            posture: Postures of the two stances.
        """
        points = np.array([state.stance, tuple(after)], dtype=np.int64)
        stances = self.checks.stances(points, posture)
        steps = self._step_rows(state, points)
        steps["given"] = True
        if self.settings.collisions:
            limb = int(steps["limb"][0])
            self._know_released(stances, np.array([[0, limb], [1, limb]]))
        self.checks.check(steps, stances, self.checks.world(self.obstacle_grid))
        return edge_of(steps[0])


def join(first: Postures, second: Postures) -> Postures:
    """Postures of two groups one after the other."""
    return Postures(
        *(np.concatenate([getattr(first, name), getattr(second, name)]) for name in FIELDS)
    )
