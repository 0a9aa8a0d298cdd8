"""Rewards: objects that say what a step is worth, for the single and the vector environment.

A reward is anything that can be called with a `StepOutcome`. `"steps"` and `"base"` are short for
`StepReward()` and `BaseReward()`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from mlivr_gym.arguments import Via
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.schema import Choice, FieldPath


class StepOutcome(NamedTuple):
    """What a step did: numbers for one environment, arrays of shape (k,) for k copies."""

    displacement: float | Array
    """Base displacement [m].

    There and back where a grasp failed; the largest of any step where the action was masked out.
    """
    before: float | Array
    """Distance of the base from the goal before the step [m]."""
    after: float | Array
    """Distance of the base from the goal after the step [m]."""
    success: bool | BoolArray
    """Whether the base is in the goal region after the step."""
    legal: bool | BoolArray
    """Whether the action was allowed by the mask."""


class Reward(Protocol):
    """What a step is worth."""

    def __call__(self, outcome: StepOutcome) -> float | Array:
        """Reward of a step, a number or shape (k,) as the outcome is; -0.0 and 0.0 are the same."""


@dataclass(frozen=True)
class StepReward:
    """-1 for each step."""

    def __call__(self, outcome: StepOutcome) -> float | Array:
        """See `Reward`."""
        return -1.0

    def to_dict(self) -> dict[str, Any]:
        """Plain data that `REWARD` takes."""
        return {"kind": "steps"}


@dataclass(frozen=True)
class BaseReward:
    """Minus the base displacement [m]."""

    def __call__(self, outcome: StepOutcome) -> float | Array:
        """See `Reward`."""
        return -outcome.displacement

    def to_dict(self) -> dict[str, Any]:
        """Plain data that `REWARD` takes."""
        return {"kind": "base"}


REWARDS: dict[str, type[StepReward] | type[BaseReward]] = {"steps": StepReward, "base": BaseReward}
"""The rewards by name."""


def _read_reward(given: Any, place: FieldPath) -> Reward:
    """A reward by name, from plain data, or as it is; a class of them is none."""
    name = given.get("kind") if isinstance(given, dict) else given
    if isinstance(name, str):
        return REWARDS[Choice(tuple(REWARDS)).read(name, place)]()
    if isinstance(given, dict | type) or not callable(given):
        raise place.refused(given, f"one of {', '.join(map(repr, REWARDS))} or a Reward")
    reward: Reward = given
    return reward


REWARD = Via(_read_reward)
"""A reward by name, from plain data (`to_dict`), or as it is."""


class TaskReward(NamedTuple):
    """The whole reward: that of a step, a bonus for success, and potential-based shaping.

    With shaping `discount * phi(after) - phi(before)` is added, where `phi` is minus the distance
    to the goal [m], 0 in the goal region (Ng, Harada and Russell, 1999).
    """

    reward: Reward
    """What a step is worth."""
    success_bonus: float
    """Added on reaching the goal."""
    shaping: bool
    """Whether to add the shaping."""
    discount: float
    """Discount of the shaping."""
    tolerance: float
    """Radius of the goal region [m]."""

    def __call__(self, outcome: StepOutcome) -> float | Array:
        """Reward of a step, a number or shape (k,) as the outcome is."""
        total: Any = self.reward(outcome) + self.success_bonus * outcome.success
        if self.shaping:
            before, after = self._potential(outcome.before), self._potential(outcome.after)
            total = total + (self.discount * after - before)
        found: float | Array = total
        return found

    def _potential(self, distance: float | Array) -> float | Array:
        inside: Any = distance > self.tolerance
        potential: float | Array = -distance * inside
        return potential
