"""Validators of values that only robots have."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.rigid import RigidBody
from mlivr_gym.schema import FieldPath, OrNone, Tuples, Validator, is_list
from mlivr_gym.values import MAX_ROBOT_LENGTH, MIN_SIZE, Triple

APART = (
    ("base", "upper_arm"),
    ("forearm", "wrist_2"),
    ("wrist_1", "wrist_3"),
    ("wrist_1", "gripper"),
)
"""Pairs of links that lie beside each other, by lengths that no joint angle changes."""

SMALLEST_BODY = 1e-3
"""Smallest edge of the body [m]: MuJoCo refuses the inertia of a smaller one."""

MOST_FOLDS = 4
"""Largest number of entries of `RobotSpec.folds`."""

MOST_POSES = 64
"""Largest number of candidate heights or rolls; the robots that ship have four and five."""

MASSES = (1e-3, 1e6)
"""Least and largest mass of a part [kg]: a gram, and twice the ISS."""

FARTHEST_TURN = 100.0
"""Largest joint limit or angle [rad], 16 turns; a UR joint has one in each direction."""

POSITION = Tuples((3,), most=MAX_ROBOT_LENGTH, unit="m")
"""Validator of a position [m]."""

LENGTH = Tuples((), 0.0, MAX_ROBOT_LENGTH, "m")
"""Validator of a length that may be 0 [m]."""

POSITIVE = Tuples((), MIN_SIZE, MAX_ROBOT_LENGTH, "m")
"""Validator of a length above 0 [m]."""

SIX_ANGLES = Tuples((6,), -FARTHEST_TURN, FARTHEST_TURN, "rad")
"""Validator of angles of six joints [rad]."""


@dataclass(frozen=True)
class OneOrList:
    """A single value of one kind, or a list of another."""

    one: Validator[Any]
    listed: Validator[Any]

    def read(self, value: object, place: FieldPath) -> Any:
        """Return what the kind of the value reads."""
        return (self.listed if is_list(value) else self.one).read(value, place)


EDGES = OneOrList(
    Tuples((), SMALLEST_BODY, MAX_ROBOT_LENGTH, "m"),
    Tuples((3,), SMALLEST_BODY, MAX_ROBOT_LENGTH, "m"),
)
"""Validator of the edge of a cube, or of the three edges of a box [m]."""


@dataclass(frozen=True)
class PairOf:
    """Validator of one of several pairs of names, in either order."""

    pairs: tuple[tuple[str, str], ...]
    """The pairs."""

    def read(self, value: object, place: FieldPath) -> tuple[str, str]:
        """Return the pair in the order in which it is listed."""
        given = value if isinstance(value, list | tuple) else ()
        for pair in self.pairs:
            if list(given) in (list(pair), list(pair[::-1])):
                return pair
        raise place.refused(value, "one of " + ", ".join(map(json.dumps, self.pairs)))


class Inertias(Tuples):
    """Validator of inertias xx, yy, zz, xy, xz, yz [kg m^2] that bodies can have."""

    def read(self, value: object, place: FieldPath) -> Any:
        """Return the numbers.

        Principal moments must be above 0, and no two of them together less than the third.
        """
        found = super().read(value, place)
        for k, inertia in enumerate(np.reshape(found, (-1, 6)).tolist()):
            moments = RigidBody(1.0, (0.0, 0.0, 0.0), inertia).principal_moments
            if moments[0] <= 0.0 or moments[0] + moments[1] < moments[2] * (1.0 - 1e-6):
                told = ", ".join(f"{moment:g}" for moment in moments)
                raise (place.entry(k) if len(self.shape) > 1 else place).fault(
                    f"has the principal moments {told}; they must be above 0, and two of them "
                    "together at least the third"
                )
        return found


GivenInertia = Annotated[tuple[float, ...] | None, OrNone(Inertias((6,), -1e6, 1e6, "kg m^2"))]
"""An inertia xx, yy, zz, xy, xz, yz [kg m^2], or None."""

GivenPosition = Annotated[Triple | None, OrNone(POSITION)]
"""A position [m], or None."""


def edges_of(size: float | Triple) -> Array:
    """Return the three edges of a cube or a box [m], shape (3,)."""
    return np.broadcast_to(np.asarray(size, dtype=np.float64), 3).copy()
