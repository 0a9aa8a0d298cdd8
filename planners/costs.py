"""Costs of a step.

The paper has two: the base displacement, and one for each step. Their weighted sum charges a price
in metres for every regrasp, so that steps can be bought with translation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mlivr_gym.arguments import Kinds, checked
from mlivr_gym.arrays import Array
from mlivr_gym.compiled.records import Record
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.plan_parts import COSTS
from mlivr_gym.schema import Choice, Maybe, Tuples

HIGHEST_PRICE = 1e6
"""Largest price of a regrasp [m]; above it displacements are lost in rounding."""

COST_KINDS: Kinds = {"cost": Choice(COSTS), "regrasp_price": Maybe(Tuples((), 0.0, HIGHEST_PRICE))}
"""Kinds of what names a cost."""

HEURISTICS = ("consistent", "paper", "zero", "cost_to_go")
"""Names of the heuristics; `cost_to_go` is the exact one without step checks."""


STRIDE, EAGERNESS = 0.3, 3.0
"""Advance of a typical step of many limbs [m], and how much a first plan is preferred to a good
one: factors of `Cost.promise`, see `experiments/many_limbs.py`."""

MOVE, PER_METRE, HASTE = 0.6, 2.0, 2.0
"""Where the fewest moves to the goal are known: least price of a move by that of a metre, what a
metre counts in moves, and how much a first plan is preferred to a good one."""


@dataclass(frozen=True)
class Cost:
    """Cost `base_weight * displacement + step_weight` of one step.

    Attributes
    ----------
    name
        One of `motion.plan_parts.COSTS`.
    base_weight
        Weight of the base displacement [1/m].
    step_weight
        Charge for each step.
    """

    name: str = "base"
    base_weight: float = 1.0
    step_weight: float = 0.0

    @classmethod
    @checked(COST_KINDS)
    def named(cls, cost: str, regrasp_price: float | None = None) -> Cost:
        """A cost by name.

        Parameters
        ----------
        cost
            `"base"` [m], `"steps"`, or `"weighted"` [m].
        regrasp_price
            Metres charged for a regrasp; only for `"weighted"`.

        Raises
        ------
        SettingError
            If the name is unknown or the price is missing, misplaced, below zero or
            too high.
        """
        if (cost == "weighted") != (regrasp_price is not None):
            raise SettingError(
                f"regrasp_price is {regrasp_price!r}; it goes with cost 'weighted' and only with it"
            )
        if regrasp_price is not None:
            return cls(cost, 1.0, regrasp_price)
        return cls(cost, float(cost == "base"), float(cost == "steps"))

    def heuristic(self, name: str, distance: Array, tolerance: float, max_step: float) -> Array:
        """Estimate of the cost from base positions to the goal.

        `"consistent"` uses `max(0, d - tolerance)` and `ceil(max(0, d - tolerance) / max_step)`,
        which never overestimate since the goal is a ball. `"paper"` uses `d` and `d / max_step`,
        which may.

        Parameters
        ----------
        name
            `"consistent"`, `"paper"` or `"zero"`.
        distance
            Distances to the goal [m], any shape.
        tolerance
            Radius of the goal region [m].
        max_step
            Bound of one step's base displacement [m].
        """
        if name == "zero":
            return np.zeros_like(distance)
        if name == "paper":
            return self.base_weight * distance + self.step_weight * distance / max_step
        short = np.maximum(distance - tolerance, 0.0)
        return self.base_weight * short + self.step_weight * np.ceil(short / max_step - 1e-9)

    def promise(self, distance: Array, moves: Array | None = None) -> Array:
        """Guess of the cost from base positions to the goal, no bound: it leads to a first plan.

        Parameters
        ----------
        distance
            Distances to the goal [m], any shape.
        moves
            Fewest moves to it, where that is known.
        """
        if moves is None:
            return EAGERNESS * distance * (self.base_weight + self.step_weight / STRIDE)
        price = max(self.step_weight, MOVE * self.base_weight)
        return HASTE * (price * moves + (self.base_weight + PER_METRE * price) * distance)


class Weights(Record):
    """What compiled searches charge for a step."""

    base: float
    """Weight of the base displacement [1/m]."""
    step: float
    """Charge for each step."""


def weights_of(cost: Cost) -> Weights:
    """A cost as compiled searches read it."""
    out: Weights = Weights.row()
    out["base"], out["step"] = cost.base_weight, cost.step_weight
    return out
