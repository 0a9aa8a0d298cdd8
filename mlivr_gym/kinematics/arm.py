"""An arm as compiled code reads it; what it can do stands in `families`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

TURN = 2.0 * np.pi
"""A whole turn [rad]."""

LIMIT_TOLERANCE = 1e-6
"""How far a joint may pass its limits [rad].

Postures are rounded, and a joint often lies exactly on a half turn.
"""


class Arm(Record):
    """An arm of six joints of the form of the UR arms, see `ur`."""

    d1: float
    """Length in the standard DH convention [m], as are the next five."""
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float
    window: Annotated[Array, (6, 2)]
    """Least and largest angle of each joint of a limb that holds or is folded, see `in_window`
    [rad]."""


class FlangeAxis(NamedTuple):
    """Where a flange is but for its turn about its axis, in the limb base frame."""

    p: Triple
    """Its position [m]."""
    z: Triple
    """Its axis."""


class JointAxes(Record):
    """Where the joints of a limb are, in its base frame."""

    axis: Annotated[Array, (6, 3)]
    """Unit vectors along them."""
    point: Annotated[Array, (6, 3)]
    """A point on each [m]."""


@kernel
def in_window(angle: float, low: float) -> float:
    """The winding of a joint angle on which it lies in its window [rad].

    A window is less than a turn, so there is one winding at most: a posture of a limb that holds
    tells the joint angles, whatever way led there.

    Parameters
    ----------
    angle
        The angle [rad].
    low
        Where the window begins [rad]. Angles below it by `LIMIT_TOLERANCE` belong to it.
    """
    least = low - LIMIT_TOLERANCE
    winding: float = angle - TURN * np.floor((angle - least) / TURN)
    return winding


def set_arm(arm: Arm, lengths: Array, windows: Array) -> None:
    """Fill `arm`.

    Parameters
    ----------
    arm
        Filled.
    lengths
        d1, a2, a3, d4, d5, d6 [m].
    windows
        Least and largest angle of each joint [rad], at most a turn apart, shape (6, 2).
    """
    arm["d1"], arm["a2"], arm["a3"], arm["d4"], arm["d5"], arm["d6"] = lengths
    low, high = windows.T
    arm["window"][:, 0] = low
    arm["window"][:, 1] = np.minimum(high, low + TURN - 2.0 * LIMIT_TOLERANCE)
