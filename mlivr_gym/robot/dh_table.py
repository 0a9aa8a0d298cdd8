"""Links of an arm by the table of Denavit and Hartenberg that its maker publishes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mlivr_gym.errors import RobotError
from mlivr_gym.robot.rigid import quaternion_of, rigid
from mlivr_gym.values import MIN_SIZE, Triple, as_triple


def ur_dh(
    d1: float = 0.1625,
    a2: float = -0.425,
    a3: float = -0.3922,
    d4: float = 0.1333,
    d5: float = 0.0997,
    d6: float = 0.0996,
) -> tuple[Triple, ...]:
    """Return the DH table of an arm of UR, see `frames_of_dh`; by default the maker's UR5e [m]."""
    right = 0.5 * np.pi
    return (
        (d1, 0.0, right), (0.0, a2, 0.0), (0.0, a3, 0.0), (d4, 0.0, right), (d5, 0.0, -right),
        (d6, 0.0, 0.0),
    )  # fmt: skip


def frames_of_dh(rows: Sequence[Triple]) -> tuple[tuple[Triple, ...], tuple[Any, ...]]:
    """Return origins and quaternions of the links of a DH table, as `Limb` has them.

    Rows are d, a [m] and alpha [rad] of the standard convention `Rz(theta) Tz(d) Tx(a) Rx(alpha)`;
    the last one may not lead off the last axis. The frame of a link has its origin where the row
    of its joint leaves the axis.
    """
    step, steps = np.eye(4), []
    for d, a, alpha in rows:
        steps.append(step @ rigid(np.eye(3), (0.0, 0.0, d)))
        turned = np.array([[1, 0, 0], [0, np.cos(alpha), -np.sin(alpha)],
                           [0, np.sin(alpha), np.cos(alpha)]])  # fmt: skip
        step = rigid(np.round(turned, 15), (a, 0.0, 0.0))
    if abs(rows[-1][1]) > MIN_SIZE:
        raise RobotError(f"a of the last row is {rows[-1][1]:g} m; the flange lies on its axis")
    steps[-1] = steps[-1] @ step
    places = tuple(as_triple(step[:3, 3] + 0.0) for step in steps)
    return places, tuple(map(tuple, quaternion_of(np.array(steps)[:, :3, :3]).tolist()))
