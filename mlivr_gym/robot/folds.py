"""Base poses and folded configurations of the default robot, and the order of rolls."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

HEIGHTS = (0.60, 0.65, 0.70, 0.75)
"""Candidate heights of the base of a robot with limbs as long as the UR5e [m]."""

SPAN = 2.4
"""Largest distance of two points that such a robot holds [m]."""

CHARACTERISTIC_LENGTH = 0.87
"""Length that makes distances and angles of such a limb comparable [m]."""

FOLDS = (
    (-0.6, np.pi, 2.4, 0.0, -0.75),
    (0.3, np.pi, 0.0, -1.6, 0.75),
    (2.19, -0.15, 1.83, 0.7, -0.38),
)
"""Joints 1 to 5 [rad] of a UR limb folded beside the body, on the side away from the surface.

They were chosen from postures that keep clear of the body: each in turn adds the largest number of
steps of the JEM over which a limb can fold, stay folded and unfold.
"""


def geometric_order(rolls: Iterable[float]) -> tuple[float, ...]:
    """Return rolls [rad] sorted by size, the positive one of two opposite rolls first.

    This order is the last rule by which a posture is chosen. A roll is counted about the line to
    the grasp of one limb, with two limbs of limb 0, so the side of a wall that is preferred changes
    with the limb that holds either point: no side of the module is favoured.
    """

    def key(roll: float) -> tuple[float, bool]:
        turn = float(np.angle(np.exp(1j * roll)))
        return round(abs(turn), 9), turn < 0.0

    return tuple(sorted(rolls, key=key))
