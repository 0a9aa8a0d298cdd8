"""Rewards of single and vector environments: objects that are called with an action's outcome.

Any callable that takes a `StepOutcome` is a reward. A `Cost` stands for `CostReward` of it, the
names `"steps"` and `"base"` for those of the costs of these names.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arguments import Reader
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.motion.plan_parts import CUSTOM
from mlivr_gym.planners.costs import CUSTOM_COST, Cost
from mlivr_gym.schema import NAME, Choice, FieldPath, Fields


class StepOutcome(NamedTuple):
    """Outcome of an action: numbers, or arrays of shape (k,) for k sub-environments."""

    displacement: float | Array
    """Base displacement [m].

    If the grasp failed it counts twice, there and back. If a step failed in simulation it is the
    distance by which the base had moved by then. If the action was invalid it is 0.
    """
    distance_before: float | Array
    """Distance of the base from the goal before the action [m]."""
    distance_after: float | Array
    """Distance of the base from the goal after the action [m]."""
    success: bool | BoolArray
    """Whether the base is in the goal region after the action."""
    valid: bool | BoolArray
    """Whether the action was valid."""
    max_displacement: float
    """Upper bound of the base displacement of one step [m]."""
    stance: tuple[int, ...] | NDArray[Any]
    """Points that the limbs hold if the action succeeds, shape (N,) or (k, N); any if invalid."""
    point: int | NDArray[Any]
    """Point that the action grasps."""


class Reward(Protocol):
    """Interface of a reward.

    Examples
    --------
    A reward for progress towards the goal, which charges each action a centimetre:

    >>> import gymnasium
    >>> def progress(outcome):
    ...     return outcome.distance_before - outcome.distance_after - 0.01
    >>> env = gymnasium.make("mlivr_gym:MLIVR-JEM-v0", reward=progress)
    >>> observation, info = env.reset(seed=0)
    >>> before = np.linalg.norm(observation["goal"] - info["base_position"])
    >>> action = env.action_space.sample(info["action_mask"])
    >>> observation, reward, terminated, truncated, info = env.step(action)
    >>> after = np.linalg.norm(observation["goal"] - info["base_position"])
    >>> bool(np.isclose(reward, before - after - 0.01))
    True
    """

    def __call__(self, outcome: StepOutcome) -> float | Array:
        """Return the reward of a step, a number, or an array of shape (k,) as in the outcome.

        In the vector environment the outcome has the sub-environments that took an action, and not
        those that were just reset.
        """


@dataclass(frozen=True)
class CostReward:
    """Reward of minus the cost of the action.

    A failed grasp costs its step and the base displacement there and back, an invalid action a step
    without a price whose displacement is its upper bound.
    """

    cost: Cost
    """The cost."""

    def __call__(self, outcome: StepOutcome) -> float | Array:
        """Return minus the cost."""
        metres, most = outcome.displacement, outcome.max_displacement
        if not isinstance(outcome.valid, bool):
            metres = np.where(outcome.valid, metres, most)
        elif not outcome.valid:  # of one step `where` takes ten times as long
            metres = most
        costs = self.cost.base_weight * metres + self.cost.step_weight
        if self.cost.prices is not None:
            stances = np.reshape(outcome.stance, (np.size(metres), -1))
            prices = self.cost.prices_of(stances, np.atleast_1d(outcome.point))
            costs = costs + outcome.valid * prices.reshape(np.shape(metres))
        return -costs

    def to_dict(self) -> dict[str, Any]:
        """Return plain data from which `REWARD` builds this reward."""
        return self.cost.to_dict()


REWARDS = {name: CostReward(Cost.named(name)) for name in ("steps", "base")}
"""Rewards by name."""


def _read_reward(given: Any, path: FieldPath) -> Reward:
    """Return a reward that is given as itself, by name or as plain data; refuse a class."""
    name = given.get("kind") if isinstance(given, dict) else given
    if isinstance(name, str) and name == CUSTOM:
        custom = Fields({"kind": NAME}, CUSTOM_COST).read(given, path)
        return CostReward(Cost.custom(**{key: custom[key] for key in CUSTOM_COST if key in custom}))
    if isinstance(name, str):
        return REWARDS[Choice(tuple(REWARDS)).read(name, path)]
    if isinstance(given, Cost):
        return CostReward(given)
    if isinstance(given, dict | type) or not callable(given):
        raise path.refused(given, f"one of {', '.join(map(repr, REWARDS))}, a Cost or a Reward")
    reward: Reward = given
    return reward


REWARD = Reader(_read_reward)
"""Validator of a reward, given as itself, by name, or as plain data (`to_dict`)."""


class TotalReward(NamedTuple):
    """The whole reward: that of a step, a bonus for success, and potential-based shaping.

    Shaping adds `discount * phi(after) - phi(before)`, where `phi` is minus the distance to the
    goal [m], and 0 in the goal region (Ng, Harada and Russell, 1999).
    """

    step_reward: Reward
    """Reward of a step alone, as the argument `reward` of the environment."""
    success_bonus: float
    """Number that is added for an action after which the base is in the goal region."""
    shaping: bool
    """Whether shaping is added."""
    discount: float
    """Discount of the shaping, which must be the agent's for the optimal policy to stay."""
    tolerance: float
    """Radius of the goal region [m]."""

    @property
    def cost(self) -> Cost:
        """The cost whose negative is the reward of a step.

        Raises a `SettingError` if that is an object of the user, whose cost is not known.
        """
        if isinstance(self.step_reward, CostReward):
            return self.step_reward.cost
        given = shortened(self.step_reward)
        raise SettingError(f"reward is {given}; 'steps', 'base' or a Cost is needed here")

    def check_fits(self, points: int) -> None:
        """Raise a `SettingError` unless its prices, if any, are those of as many points."""
        if isinstance(self.step_reward, CostReward):
            self.step_reward.cost.check_fits(points)

    def __call__(self, outcome: StepOutcome) -> float | Array:
        """Return the reward of a step, a number, or an array of shape (k,) as in the outcome."""
        total: Any = self.step_reward(outcome) + self.success_bonus * outcome.success
        if self.shaping:
            before, after = (
                self._potential(outcome.distance_before),
                self._potential(outcome.distance_after),
            )
            total = total + (self.discount * after - before)
        found: float | Array = total
        return found

    def _potential(self, distance: float | Array) -> float | Array:
        """Return the potential phi at a distance from the goal."""
        is_outside: Any = distance > self.tolerance
        potential: float | Array = -distance * is_outside
        return potential
