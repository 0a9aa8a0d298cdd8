"""States of a robot, and the steps that leave one."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.errors import StanceError, shortened


class State(NamedTuple):
    """A stance and, for each limb, the branches and flips that it may be on.

    A limb that holds keeps its branch, so every step takes branches away from the limbs that hold;
    a limb that grasps has all of them again, see `transitions.rule`.
    """

    stance: tuple[int, ...]
    """Point index of each limb."""
    masks: tuple[int, ...]
    """16-bit mask of each limb, bit `branch + 8 * flip`."""
    pose: tuple[float, ...] | None = None
    """Base pose x, y, z [m] and quaternion w, x, y, z of a robot that was put there by its user.

    None where the robot stands in the posture of its stance.
    """

    def stance_after(self, limb: int, point: int) -> tuple[int, ...]:
        """The stance after `limb` has moved to `point`."""
        return (*self.stance[:limb], point, *self.stance[limb + 1 :])


class Successors(NamedTuple):
    """The k steps that leave a state, ordered by limb and point."""

    limb: IntArray
    """Limb that moves, shape (k,)."""
    point: IntArray
    """Point it moves to, shape (k,)."""
    base_in_world: Array
    """Base position after the step [m], shape (k, 3)."""
    masks: IntArray
    """Masks of all limbs after the step, shape (k, N)."""

    def __bool__(self) -> bool:
        """Whether any step leaves the state."""
        return len(self.limb) > 0

    def find(self, limb: int, point: int) -> int:
        """Index of the step that moves `limb` to `point`, or -1."""
        found = np.flatnonzero((self.limb == limb) & (self.point == point))
        return int(found[0]) if len(found) else -1

    def after(self, before: State, k: int) -> State:
        """The state after step `k` from the state `before`, which these steps leave."""
        stance = before.stance_after(int(self.limb[k]), int(self.point[k]))
        return State(stance, tuple(self.masks[k].tolist()))

    def take(self, kept: IntArray) -> Successors:
        """Some of the steps, by index or truth value."""
        return Successors(
            self.limb[kept], self.point[kept], self.base_in_world[kept], self.masks[kept]
        )


def moving_limb(before: tuple[int, ...], after: tuple[int, ...]) -> int:
    """The limb that moves on a step from one stance to another, the first that differs."""
    return next(i for i, (a, b) in enumerate(zip(before, after, strict=True)) if a != b)


def check_integers(given: Any, count: int, most: int, what: str) -> None:
    """Refuse what is not one whole number a limb, from 0 to `most`.

    Compiled code looks things up by them.

    Raises
    ------
    StanceError
        naming what was given and what is taken.
    """
    if isinstance(given, (tuple, list, np.ndarray)) and len(given) == count:
        for k in given:
            if not isinstance(k, (int, np.integer)) or not 0 <= k <= most:
                break
        else:
            return
    raise StanceError(
        f"{what} {shortened(given)} must be {count} whole numbers from 0 to {most}, one a limb"
    )


def check_state(state: State, limbs: int, points: int) -> None:
    """Refuse a state of other limbs or points; see `check_integers`."""
    check_integers(state.stance, limbs, points - 1, "stance")
    check_integers(state.masks, limbs, ALL, "masks")
