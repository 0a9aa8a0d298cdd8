"""Validators of goals, and of points that are given by id or by index."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arguments import Reader, WithError
from mlivr_gym.errors import GoalError, StanceError
from mlivr_gym.schema import FieldPath, ListOf, Numbers


def is_point_number(value: object) -> bool:
    """Return whether a value may be the index of a point."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _point(value: Any, place: FieldPath) -> str | int:
    """Return a point by id or index."""
    if not isinstance(value, str) and not is_point_number(value):
        raise place.refused(value, "the id of a point, or its index")
    point: str | int = value
    return point


GOAL = WithError(GoalError, Numbers((3,)))
"""A goal position [m]."""

STANCE = WithError(StanceError, ListOf(Reader(_point)))
"""Points by id or index, such as that of each limb."""
