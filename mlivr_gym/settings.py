"""Thresholds of manipulability and clearance, and switches of the checks of a stance graph."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from mlivr_gym.arguments import checked
from mlivr_gym.errors import MlivrError, SettingError, shortened
from mlivr_gym.schema import FieldPath, Flag, Integer, OrNone, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH

GRAPH_RULES = 6
"""Version of the rules by which postures and steps are chosen; version 0.1.0 had rules 1.

The number is raised whenever the same map and robot give other postures or steps. Plans,
checkpoints, data sets, test sets and tables of other rules are refused.
"""

LIMBS = Integer(2, 1000)
"""Validator of a number of limbs."""

LIMB_THRESHOLD = 0.1
"""Threshold of the limb manipulability w_m, from the paper."""

BASE_THRESHOLD = 0.001
"""Threshold of the base manipulability w_b for two limbs, from the paper."""

PATH_FLOOR = 0.03
"""Minimum limb manipulability of a support limb between two stances."""

CLEARANCE = 0.02
"""Minimum distance between two shapes [m]."""


@checked({"limbs": LIMBS})
def base_threshold(limbs: int) -> float:
    """Return the default threshold of w_b for a number of limbs N, `0.001 (2/N)^3`.

    The norm of the joint rates is shared among more joints as N grows, so w_b of equally good
    postures falls as `N^-3`.
    """
    return BASE_THRESHOLD * (2.0 / limbs) ** 3


def check_rules(
    what: str, found: object, remedy: str, error: type[MlivrError] = MlivrError
) -> None:
    """Check that something was made by the present rules of the stance graph.

    `what` is what was made, the first words of the message, and `found` the number of rules that it
    carries, None if it carries none, as in version 0.1.0. `remedy` is what the user should do, the
    last words. Raises an error of the given type if the number is not `GRAPH_RULES`.
    """
    found = 1 if found is None else found
    if found != GRAPH_RULES:
        raise error(
            f"{what} was made by rules {shortened(found)} of the stance graph, and this version "
            f"has rules {GRAPH_RULES}: {remedy}"
        )


@dataclass(frozen=True)
class Settings:
    """Conditions under which a stance is a node and a step is an edge of the stance graph.

    Examples
    --------
    >>> Settings(clearance=0.03).limb_threshold
    0.1
    """

    manipulability: Annotated[bool, Flag()] = True
    """Whether stances must meet both thresholds of manipulability. Without them, stances are still
    excluded by `path_floor` if steps are checked, and always by the span of the robot
    (`graph_table.COUNTS`, `point_pairs.count_farther`)."""
    transitions: Annotated[bool, Flag()] = True
    """Whether a step is an edge only if the support limbs are shown to hold all along it."""
    limb_threshold: Annotated[float, THRESHOLD] = LIMB_THRESHOLD
    """Threshold of w_m of each limb."""
    base_threshold: Annotated[float | None, OrNone(THRESHOLD)] = None
    """Threshold of w_b; by default `0.001 (2/N)^3`."""
    path_floor: Annotated[float, THRESHOLD] = PATH_FLOOR
    """Minimum w_m of a support limb between stances, and of a limb that departs from a point. It
    applies with and without thresholds, since the proof that a limb stays on its branch needs
    it."""
    collisions: Annotated[bool, Flag()] = True
    """Whether stances and steps must keep the clearance."""
    clearance: Annotated[float, Tuples((), 0.0, MAX_ROBOT_LENGTH, "m")] = CLEARANCE
    """Minimum distance between any two shapes that are compared [m]."""

    def __post_init__(self) -> None:
        """Check and convert all fields."""
        SETTINGS.check(self, FieldPath("", SettingError))

    @checked({"limbs": LIMBS})
    def thresholds(self, limbs: int) -> tuple[float, float]:
        """Return the thresholds of w_m and w_b for a stance of `limbs` limbs.

        Both are zero if `manipulability` is False.
        """
        if not self.manipulability:
            return 0.0, 0.0
        w_b = base_threshold(limbs) if self.base_threshold is None else self.base_threshold
        return self.limb_threshold, w_b


THRESHOLD = Tuples((), 0.0)
"""Validator of a threshold of manipulability."""

SETTINGS = Struct.of(Settings)
"""Validator of each field of `Settings`."""
