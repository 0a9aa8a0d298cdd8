"""The order of candidate rolls of the base."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


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
