"""An arm as compiled code reads it; what it can do stands in `families`."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.records import Record


class Arm(Record):
    """An arm of six joints of the form of the UR arms, see `ur`."""

    d1: float
    """Length in the standard DH convention [m], as are the next five."""
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float
    limits: Annotated[Array, (6, 2)]
    """Joint limits [rad]."""
    full_turn: bool
    """Whether every joint turns by 720 degrees or more, so that limits rule out no posture."""


class JointAxes(Record):
    """Where the joints of a limb are, in its base frame."""

    axis: Annotated[Array, (6, 3)]
    """Unit vectors along them."""
    point: Annotated[Array, (6, 3)]
    """A point on each [m]."""


def set_arm(arm: Arm, lengths: Array, limits: Array) -> None:
    """Fill `arm`.

    Args:
        arm: Filled.
        lengths: d1, a2, a3, d4, d5, d6 [m].
        limits: Joint limits [rad], shape (6, 2).
    """
    arm["d1"], arm["a2"], arm["a3"], arm["d4"], arm["d5"], arm["d6"] = lengths
    arm["limits"][:] = limits
    arm["full_turn"] = bool((limits[:, 1] - limits[:, 0] >= 4.0 * np.pi - 1e-9).all())
