"""States of a robot, and the steps that leave a state."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.errors import StanceError, shortened


class State(NamedTuple):
    """A stance with its label, for each limb the set of branches and flips that it may be on.

    A support limb stays on its branch, so every step can only remove branches of support limbs; a
    limb that grasps has all branches on which it can be released, see `transitions.rule`.
    """

    stance: tuple[int, ...]
    """Point index of each limb."""
    branch_sets: tuple[int, ...]
    """Branch set of each limb, 16 bits, bit `branch + 8 * flip`."""
    pose: tuple[float, ...] | None = None
    """Base pose x, y, z [m] and quaternion w, x, y, z that a user gave; None for that of the
    posture."""

    @checked(late=True)
    def stance_after(self, limb: int, point: int) -> tuple[int, ...]:
        """Return the stance after `limb` has moved to `point`."""
        return (*self.stance[:limb], point, *self.stance[limb + 1 :])


class Successors(NamedTuple):
    """The k steps that leave a state, ordered by limb and point."""

    limb: IntArray
    """Limb that moves, shape (k,)."""
    point: IntArray
    """Point that it moves to, shape (k,)."""
    base_position: Array
    """Base position after each step [m], shape (k, 3)."""
    branch_sets: IntArray
    """Branch sets of all limbs after each step, shape (k, N)."""

    def __bool__(self) -> bool:
        """Return whether any step leaves the state."""
        return len(self.limb) > 0

    @checked(late=True)
    def find(self, limb: int, point: int) -> int:
        """Return the index of the step that moves `limb` to `point`, -1 if there is none."""
        found = np.flatnonzero((self.limb == limb) & (self.point == point))
        return int(found[0]) if len(found) else -1

    @checked(late=True)
    def after(self, before: State, k: int) -> State:
        """Return the state after step `k` from the state `before`, which these steps leave."""
        try:
            stance = before.stance_after(int(self.limb[k]), int(self.point[k]))
        except (IndexError, TypeError):
            raise StanceError(
                f"before {shortened(before)} has no step {shortened(k)} of the {len(self.limb)}"
            ) from None
        return State(stance, tuple(self.branch_sets[k].tolist()))

    def stances(self, before: State) -> IntArray:
        """Return the stances after the steps from the state `before`, shape (k, N)."""
        found = np.tile(np.array(before.stance, dtype=np.int64), (len(self.limb), 1))
        found[np.arange(len(self.limb)), self.limb] = self.point
        return found

    @checked(late=True)
    def take(self, kept: IntArray) -> Successors:
        """Return some of the steps, given by index or truth value."""
        rows = np.asarray(kept)
        try:
            return Successors(
                self.limb[rows], self.point[rows], self.base_position[rows], self.branch_sets[rows]
            )
        except IndexError:
            raise StanceError(
                f"kept {shortened(kept)} must be numbers of some of the {len(self.limb)} steps"
            ) from None


def moving_limb(before: tuple[int, ...], after: tuple[int, ...]) -> int:
    """Return the limb that moves on a step between two stances, the first that differs."""
    return next(i for i, (a, b) in enumerate(zip(before, after, strict=True)) if a != b)


def check_integers(given: Any, count: int, most: int, what: str) -> None:
    """Check that a value is one whole number for each limb, from 0 to `most`.

    Compiled code uses these numbers as indices.

    Raises
    ------
    StanceError
        Which names the value and what is valid.
    """
    rows = isinstance(given, (tuple, list)) or (isinstance(given, np.ndarray) and given.ndim > 0)
    if rows and len(given) == count:
        for k in given:
            if (type(k) is not int and not isinstance(k, np.integer)) or not 0 <= k <= most:
                break
        else:
            return
    raise StanceError(
        f"{what} {shortened(given)} must be {count} whole numbers from 0 to {most}, one a limb"
    )


def check_state(state: State, limbs: int, points: int) -> None:
    """Check that a state is one of some number of limbs and points, see `check_integers`."""
    if not isinstance(state, State):
        raise StanceError(f"state {shortened(state)} must be a State")
    check_integers(state.stance, limbs, points - 1, "stance")
    check_integers(state.branch_sets, limbs, ALL, "branch sets")
