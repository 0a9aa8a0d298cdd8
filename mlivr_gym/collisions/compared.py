"""What is compared on an interval of a line in joint space (compiled)."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.collisions.placement import Shapes
from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, EVERY, below, has
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record, Rows
from mlivr_gym.robot.sizes import MOST_LIMBS

MOST_RESTING = BRANCHES * (MOST_LIMBS - 1)
"""Largest number of configurations of limbs at rest."""


class Compared(Record):
    """What is compared on a line."""

    boxes: int
    """Set of limbs that are compared with boxes."""
    holding: int
    """Set of limbs that hold: their capsules on the flange axis stand still and are not compared
    with boxes, since this was done where the stance was checked."""
    base: bool
    """Whether the body and what is fixed to it is compared with boxes."""
    itself: int
    """Set of limbs that are compared with themselves and the body."""
    first: int
    """Limb that is compared with `second`, or with the limbs at rest."""
    second: int
    """Limb that the first one is compared with, -1 for none."""
    resting: bool
    """Whether the first limb is compared with the limbs at rest."""
    placed: int
    """Set of limbs that are placed even if nothing is compared with them."""


class RestingLimbs(Record):
    """Configurations of limbs at rest."""

    count: int
    """Number of configurations."""
    limb: Annotated[IntArray, (MOST_RESTING,), np.int64]
    """Limb of each configuration."""
    shapes: Annotated[Rows[Shapes], (MOST_RESTING,)]
    """Capsules of each configuration in the body frame."""


class LineInterval(Record):
    """An interval of a line that is still to be checked, with the comparisons that remain."""

    middle: float
    """Its middle, as a fraction of the line."""
    half: float
    """Half its length; 0 if its middle alone is compared."""
    number: int
    """Number of the interval: 1 for the whole line, 2 n and 2 n + 1 for the halves of n."""
    boxes: Annotated[IntArray, (MOST_LIMBS,), np.int64]
    """For each limb, set of capsules to compare with boxes."""
    itself: Annotated[IntArray, (MOST_LIMBS,), np.int64]
    """For each limb, set of pairs of its capsules to compare."""
    body: Annotated[IntArray, (MOST_LIMBS,), np.int64]
    """For each limb, set of capsules to compare with the body."""
    limbs: int
    """Set of capsules of the first limb to compare with the second, or of limbs at rest."""
    base: bool
    """Whether the base is to be compared with boxes."""


@kernel
def begin_comparing(robot: RobotModel, compared: Compared, interval: LineInterval) -> None:
    """Set an interval to the whole line, with everything to be compared."""
    interval.middle = interval.half = 0.5
    interval.number = 1
    for i in range(robot.limb_count):
        interval.boxes[i] = interval.itself[i] = interval.body[i] = EMPTY
        if has(compared.boxes, i):
            interval.boxes[i] = EVERY
            if has(compared.holding, i):
                interval.boxes[i] = below(robot.limbs[i].first_on_axis)
        if has(compared.itself, i):
            interval.itself[i] = interval.body[i] = EVERY
    interval.base = compared.base
    interval.limbs = EVERY if compared.resting or compared.second >= 0 else EMPTY


@kernel
def copy_pending(first: LineInterval, second: LineInterval) -> None:
    """Give the second interval the comparisons that remain for the first."""
    for i in range(MOST_LIMBS):
        second.boxes[i], second.itself[i] = first.boxes[i], first.itself[i]
        second.body[i] = first.body[i]
    second.limbs, second.base = first.limbs, first.base
