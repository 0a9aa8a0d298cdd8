"""Thresholds and switches of the stance graph."""

from __future__ import annotations

from dataclasses import dataclass

from mlivr_gym.errors import MlivrError, SettingError, shortened
from mlivr_gym.schema import FieldPath, Flag, Maybe, Struct, Tuples
from mlivr_gym.values import LONGEST_ROBOT

GRAPH_RULES = 3
"""Number of the rules by which postures and steps are chosen; 1 was version 0.1.0.

Raised whenever the same map and robot give other postures or steps: plans, checkpoints, data sets,
test sets and tables of other rules do not fit and are refused.
"""

LIMB_THRESHOLD = 0.1
"""The paper's least limb manipulability."""

BASE_THRESHOLD = 0.001
"""The paper's least base manipulability, for two limbs."""

PATH_FLOOR = 0.03
"""Least limb manipulability of a holding limb between two stances."""

CLEARANCE = 0.02
"""Least distance between shapes [m]."""


def base_threshold(limbs: int) -> float:
    """Default threshold of `w_b`.

    `||qdot||` is shared among more joints as N grows, so it falls as `N^-3`.
    """
    return BASE_THRESHOLD * (2.0 / limbs) ** 3


def check_rules(
    what: str, found: object, remedy: str, error: type[MlivrError] = MlivrError
) -> None:
    """Refuse what was made by other rules of the stance graph.

    Parameters
    ----------
    what
        What it is, the first words of the message.
    found
        The number it carries; None if it carries none, as in version 0.1.0.
    remedy
        What to do, the last words of the message.
    error
        Class of the error.

    Raises
    ------
    MlivrError
        One of class `error`, if the number is not `GRAPH_RULES`.
    """
    found = 1 if found is None else found
    if found != GRAPH_RULES:
        raise error(
            f"{what} was made by rules {shortened(found)} of the stance graph, and this version "
            f"has rules {GRAPH_RULES}: {remedy}"
        )


@dataclass(frozen=True)
class Settings:
    """What makes a stance a node and a step an edge.

    Attributes
    ----------
    manipulability
        Whether stances must meet both thresholds. Without them two things still
        leave stances out: where steps are checked `path_floor`, and everywhere the robot's
        `span` (`PairGraph.no_departure`, `PairGraph.beyond_span`).
    transitions
        Whether a step must be shown to be possible without the holding limbs letting
        go.
    limb_threshold
        Least `w_m` of each limb.
    base_threshold
        Least `w_b`; by default `0.001 (2/N)^3`.
    path_floor
        Least `w_m` of a holding limb between stances, and of a limb that departs from
        one; it holds whether there are thresholds or not, since the proof that a limb stays on
        its branch needs it.
    collisions
        Whether stances and steps must touch nothing.
    clearance
        Least distance between any two shapes that are checked [m].
    """

    manipulability: bool = True
    transitions: bool = True
    limb_threshold: float = LIMB_THRESHOLD
    base_threshold: float | None = None
    path_floor: float = PATH_FLOOR
    collisions: bool = True
    clearance: float = CLEARANCE

    def __post_init__(self) -> None:
        """Check switches and thresholds."""
        SETTINGS.check(self, FieldPath("", SettingError))

    def thresholds(self, limbs: int) -> tuple[float, float]:
        """Least `w_m` and `w_b` that a stance of `limbs` limbs must reach.

        Zeros without manipulability.
        """
        if not self.manipulability:
            return 0.0, 0.0
        w_b = base_threshold(limbs) if self.base_threshold is None else self.base_threshold
        return self.limb_threshold, w_b


THRESHOLD = Tuples((), 0.0)
"""A manipulability."""

SETTINGS = Struct(
    Settings,
    {
        "manipulability": Flag(),
        "transitions": Flag(),
        "limb_threshold": THRESHOLD,
        "base_threshold": Maybe(THRESHOLD),
        "path_floor": THRESHOLD,
        "collisions": Flag(),
        "clearance": Tuples((), 0.0, LONGEST_ROBOT, "m"),
    },
)
"""Fields of `Settings`."""
