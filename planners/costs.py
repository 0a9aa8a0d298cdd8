"""Costs of a step, and estimates of the cost from a base position to the goal.

The paper minimises either the base displacement or the number of steps. The weighted cost adds a
price in metres for each regrasp to the displacement, so that both are traded against each other. A
cost of the user's own adds prices of the stances and points that steps lead to.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arguments import NOT_NEGATIVE, Reader, Validators, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.motion.plan_parts import COSTS, CUSTOM
from mlivr_gym.schema import Choice, FieldPath, ListOf, OrNone, Tuples
from mlivr_gym.values import MAX_POINTS

HIGHEST_PRICE = 1e6
"""Largest price of a regrasp [m]; above it base displacements would be lost in rounding."""

Prices = Callable[[NDArray[Any], NDArray[Any]], Any]
"""Function of prices: from stances, indices of points of shape (k, N), and the point that the last
step to each of them grasps, shape (k,), to the prices of these steps, shape (k,)."""


@dataclass(frozen=True, eq=False)
class PointPrices:
    """Prices of grasping each of m points."""

    values: Array
    """The prices, shape (m,)."""

    def __call__(self, stances: NDArray[Any], points: NDArray[Any]) -> Array:
        """Return the prices of some points, shape (k,); see `Prices`."""
        found: Array = self.values[points]
        return found


def _read_prices(given: Any, path: FieldPath) -> Prices | None:
    """Return prices that are given as a function, as numbers for all points, or as None."""
    if given is None or callable(given):
        found: Prices | None = given
        return found
    return PointPrices(np.array(POINT_PRICES.read(given, path)))


POINT_PRICES = ListOf(Tuples((), 0.0, HIGHEST_PRICE), 1, MAX_POINTS)
"""Validator of a price for each point."""

PRICES = Reader(_read_prices)
"""Validator of prices."""


CUSTOM_COST: Validators = {
    "base_weight": NOT_NEGATIVE,
    "step_weight": NOT_NEGATIVE,
    "prices": PRICES,
}
"""Validators of the arguments of `Cost.custom`."""


def _read_cost(given: Any, path: FieldPath) -> Any:
    """Return a cost, given as itself or by its name."""
    if callable(given):
        raise path.refused(given, "the name of a cost, or a Cost, see Cost.custom")
    return given if isinstance(given, Cost) else Choice(COSTS).read(given, path)


COST_KINDS: Validators = {
    "cost": Reader(_read_cost),
    "regrasp_price": OrNone(Tuples((), 0.0, HIGHEST_PRICE)),
}
"""Validators of the arguments that name a cost."""

COST_FIELDS: dict[str, Any] = {**CUSTOM_COST, "name": Choice((*COSTS, CUSTOM))}
"""Validators of the fields of a `Cost`."""

HEURISTICS = ("relaxed", "consistent", "paper", "zero")
"""Names of the heuristics; `"relaxed"` is the relaxed cost-to-go, see `lower_bounds`."""


TYPICAL_ADVANCE, DISTANCE_INFLATION = 0.3, 3.0
"""Base displacement of a typical step of three or four limbs [m], and the factor by which
`Cost.inadmissible_estimate` overestimates; see `experiments/many_limbs.py`."""


@dataclass(frozen=True)
class Cost:
    """The cost `base_weight * displacement + step_weight + price` of one step.

    Planner, environment (as its `reward`) and expert take the same object.

    Examples
    --------
    >>> from mlivr_gym.planners import Cost
    >>> Cost.named("weighted", regrasp_price=0.3)
    Cost(name='weighted', base_weight=1.0, step_weight=0.3, prices=None)

    A cost by which each grasp of a point of the deck costs half a metre more:

    >>> from mlivr_gym import jem_map
    >>> on_deck = np.array([face == "deck" for face in jem_map().faces])
    >>> cost = Cost.custom(base_weight=1.0, prices=0.5 * on_deck)
    """

    name: str = "base"
    """`"base"`, `"steps"`, `"weighted"` or `"custom"`."""
    base_weight: float = 1.0
    """Weight of the base displacement [1/m]."""
    step_weight: float = 0.0
    """Charge for each step."""
    prices: Prices | None = None
    """Prices of steps by the stance and point that they lead to, None for no prices."""

    def __post_init__(self) -> None:
        """Check the fields, and name a cost that is none of those with a name."""
        for field, kind in COST_FIELDS.items():
            given = kind.read(getattr(self, field), FieldPath(field, SettingError))
            object.__setattr__(self, field, given)
        named = {"base": (1.0, 0.0), "steps": (0.0, 1.0)}
        weights = self.base_weight, self.step_weight
        if self.prices is not None or named.get(self.name, weights) != weights:
            object.__setattr__(self, "name", CUSTOM)

    def check_fits(self, points: int) -> None:
        """Raise a `SettingError` unless an array of prices has a number for each point of a map."""
        if isinstance(self.prices, PointPrices) and len(self.prices.values) != points:
            raise SettingError(
                f"prices has {len(self.prices.values)} numbers; the map has {points} points"
            )

    @classmethod
    @checked(COST_KINDS)
    def named(cls, cost: str | Cost, regrasp_price: float | None = None) -> Cost:
        """Return the cost of that name; a `Cost` is returned as it is.

        The price of a regrasp [m] is charged by `"weighted"` alone, in addition to the displacement
        [m]. Raises a `SettingError` if the name is unknown, or if the price is missing, given with
        another cost, negative or above `HIGHEST_PRICE`.
        """
        if (cost == "weighted") != (regrasp_price is not None):
            raise SettingError(
                f"regrasp_price is {regrasp_price!r}; it goes with cost 'weighted' and only with it"
            )
        if isinstance(cost, Cost):
            return cost
        if regrasp_price is not None:
            return cls(cost, 1.0, regrasp_price)
        return cls(cost, float(cost == "base"), float(cost == "steps"))

    @classmethod
    @checked(CUSTOM_COST)
    def custom(
        cls,
        base_weight: float = 0.0,
        step_weight: float = 0.0,
        prices: Sequence[float] | Array | Prices | None = None,
    ) -> Cost:
        """Return a cost of the user's own.

        `prices` are an array with a number for each of m points of a map, charged when a limb
        grasps the point, or a function: from stances after steps, indices of points (k, N), and
        the points that are grasped, (k,), to prices (k,). For limbs that are alike it must not
        depend on their order. Plans have minimum cost since no number is negative. Raises a
        `SettingError` if a number cannot be used, or both weights are 0.
        """
        if not base_weight + step_weight > 0.0:
            raise SettingError("base_weight and step_weight are both 0; one must be above 0")
        assert prices is None or callable(prices)  # it was read
        return cls(CUSTOM, base_weight, step_weight, prices)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data from which `rewards.REWARD` builds the reward of this cost."""
        if self.name in ("base", "steps"):
            return {"kind": self.name}
        prices: Any = self.prices
        if isinstance(prices, PointPrices):
            prices = prices.values.tolist()
        weights = {"base_weight": self.base_weight, "step_weight": self.step_weight}
        return {"kind": CUSTOM, **weights, "prices": prices}

    @property
    def counts_steps(self) -> bool:
        """Whether all steps cost the same."""
        return self.base_weight == 0.0 and self.prices is None

    def prices_of(self, stances: Any, points: Any) -> Array:
        """Return the prices of steps to stances (k, N), of which a limb grasps a point each, (k,).

        Raises a `SettingError` if the function of the user returns none that can be used.
        """
        points = np.asarray(points, dtype=np.int64)
        if self.prices is None or not len(points):
            return np.zeros(len(points))
        stances = np.asarray(stances, dtype=np.int64).reshape(len(points), -1)
        prices = np.asarray(self.prices(stances, points), dtype=np.float64)
        if prices.shape != points.shape or not ((prices >= 0.0) & (prices <= HIGHEST_PRICE)).all():
            raise SettingError(
                f"the prices of a cost are {shortened(prices)}; they must be numbers from 0 to "
                f"{HIGHEST_PRICE:g}, shape {points.shape}"
            )
        return prices

    def of_steps(self, displacement: Array, stances: Any, points: Any) -> Array:
        """Return the costs of steps with base displacements [m]; arguments of `prices_of`, (k,)."""
        costs: Array = self.base_weight * displacement + self.step_weight
        return costs if self.prices is None else costs + self.prices_of(stances, points)

    def of_path(self, positions: Array, stances: Sequence[tuple[int, ...]]) -> float:
        """Return the cost of a path over base positions [m], shape (k + 1, 3), and stances."""
        spent, held = 0.0, np.array(stances, dtype=np.int64)
        shifts = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        for cost in self.of_steps(shifts, held[1:], moved_points(held[:-1], held[1:])).tolist():
            spent += cost
        return spent

    def of_nodes(self, points: NDArray[Any]) -> Array:
        """Return the prices of steps to nodes with points (n, N) by the limb that moves, (n, N)."""
        return np.stack([self.prices_of(points, one) for one in points.T], axis=1)

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

    def inadmissible_estimate(self, distance: Array) -> Array:
        """Estimate the cost to the goal by an inflated guess, which leads to a first plan.

        It is no lower bound: it orders a queue of an anytime search and proves nothing.

        Distances to the goal [m] and estimates, in the unit of the cost, have the same shape.
        """
        per_metre = self.base_weight + self.step_weight / TYPICAL_ADVANCE
        return DISTANCE_INFLATION * distance * per_metre


class CostWeights(NamedTuple):
    """A cost as compiled searches over a table read it."""

    base: float
    """Weight of the base displacement [1/m]."""
    step: float
    """Charge for each step."""
    prices: Array
    """Price of a step to each node by the limb that moves, shape (n, N), or (0, N) for none."""


def cost_weights(cost: Cost, points: NDArray[Any]) -> CostWeights:
    """Return a cost for compiled searches over nodes with some points, shape (n, N)."""
    priced = points[:0] if cost.prices is None else points
    return CostWeights(cost.base_weight, cost.step_weight, cost.of_nodes(priced))


def moved_points(before: NDArray[Any], after: NDArray[Any]) -> NDArray[Any]:
    """Return the point that each of k steps grasps, from stances before and after it, (k, N)."""
    moved = np.argmax(before != after, axis=1)[:, None]
    return np.asarray(np.take_along_axis(after, moved, axis=1)[:, 0])
