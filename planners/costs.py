"""Costs of a step, and estimates of the cost from a base position to the goal.

The paper minimises either the base displacement or the number of steps. The weighted cost adds a
price in metres for each regrasp to the displacement, so that both are traded against each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mlivr_gym.arguments import Validators, checked
from mlivr_gym.arrays import Array
from mlivr_gym.compiled.records import Record
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.plan_parts import COSTS
from mlivr_gym.schema import Choice, OrNone, Tuples

HIGHEST_PRICE = 1e6
"""Largest price of a regrasp [m]; above it base displacements would be lost in rounding."""

COST_KINDS: Validators = {
    "cost": Choice(COSTS),
    "regrasp_price": OrNone(Tuples((), 0.0, HIGHEST_PRICE)),
}
"""Validators of the arguments that name a cost."""

HEURISTICS = ("relaxed", "consistent", "paper", "zero")
"""Names of the heuristics; `"relaxed"` is the relaxed cost-to-go, see `lower_bounds`."""


TYPICAL_ADVANCE, DISTANCE_INFLATION = 0.3, 3.0
"""Base displacement of a typical step of three or four limbs [m], and the factor by which
`Cost.inadmissible_estimate` overestimates; see `experiments/many_limbs.py`."""

MOVE_PRICE_RATIO, MOVES_PER_METRE, MOVE_INFLATION = 0.6, 2.0, 2.0
"""Constants of `Cost.inadmissible_estimate` where the fewest moves are known: minimum price of a
move in prices of a metre [m], moves that a metre counts for [1/m], and the factor by which the
estimate is inflated."""


@dataclass(frozen=True)
class Cost:
    """The cost `base_weight * displacement + step_weight` of one step.

    Examples
    --------
    >>> from mlivr_gym.planners import Cost
    >>> Cost.named("weighted", regrasp_price=0.3)
    Cost(name='weighted', base_weight=1.0, step_weight=0.3)
    """

    name: str = "base"
    """`"base"`, `"steps"` or `"weighted"`."""
    base_weight: float = 1.0
    """Weight of the base displacement [1/m]."""
    step_weight: float = 0.0
    """Charge for each step."""

    @classmethod
    @checked(COST_KINDS)
    def named(cls, cost: str, regrasp_price: float | None = None) -> Cost:
        """Return the cost of that name.

        The price of a regrasp [m] is charged by `"weighted"` alone, in addition to the displacement
        [m]. Raises a `SettingError` if the name is unknown, or if the price is missing, given with
        another cost, negative or above `HIGHEST_PRICE`.
        """
        if (cost == "weighted") != (regrasp_price is not None):
            raise SettingError(
                f"regrasp_price is {regrasp_price!r}; it goes with cost 'weighted' and only with it"
            )
        if regrasp_price is not None:
            return cls(cost, 1.0, regrasp_price)
        return cls(cost, float(cost == "base"), float(cost == "steps"))

    def of_path(self, positions: Array) -> float:
        """Return the cost of a path over base positions [m], shape (k + 1, 3)."""
        spent = 0.0
        for shift in np.linalg.norm(np.diff(positions, axis=0), axis=1).tolist():
            spent += self.base_weight * shift + self.step_weight
        return spent

    def heuristic(
        self, name: str, distance: Array, tolerance: float, max_displacement: float
    ) -> Array:
        """Estimate the cost from base positions to the goal by their distance to it.

        With the goal region a ball of radius `tolerance`, `"consistent"` is `base_weight * d_r +
        step_weight * ceil(d_r / max_displacement)` with `d_r = max(0, d - tolerance)`: an
        admissible and consistent lower bound. `"paper"` uses the distance `d` to the centre of the
        ball and `d / max_displacement`, which may overestimate.

        Distances to the goal [m] and estimates, in the unit of the cost, have the same shape.
        `max_displacement` is an upper bound of the base displacement of one step [m].
        """
        if name == "zero":
            return np.zeros_like(distance)
        if name == "paper":
            return self.base_weight * distance + self.step_weight * distance / max_displacement
        remaining = np.maximum(distance - tolerance, 0.0)
        return self.base_weight * remaining + self.step_weight * np.ceil(
            remaining / max_displacement - 1e-9
        )

    def inadmissible_estimate(self, distance: Array, moves: Array | None = None) -> Array:
        """Estimate the cost to the goal by an inflated guess, which leads to a first plan.

        It is no lower bound: it orders a queue of an anytime search and proves nothing.

        Distances to the goal [m], fewest moves to it, if they are known, and estimates, in the unit
        of the cost, have the same shape.
        """
        if moves is None:
            return (
                DISTANCE_INFLATION
                * distance
                * (self.base_weight + self.step_weight / TYPICAL_ADVANCE)
            )
        price = max(self.step_weight, MOVE_PRICE_RATIO * self.base_weight)
        return MOVE_INFLATION * (
            price * moves + (self.base_weight + MOVES_PER_METRE * price) * distance
        )


class CostWeights(Record):
    """The two weights of a cost, for compiled searches."""

    base: float
    """Weight of the base displacement [1/m]."""
    step: float
    """Charge for each step."""


def cost_weights(cost: Cost) -> CostWeights:
    """Return the weights of a cost as a record for compiled searches."""
    out: CostWeights = CostWeights.row()
    out["base"], out["step"] = cost.base_weight, cost.step_weight
    return out
