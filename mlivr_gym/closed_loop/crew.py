"""Crew members who cross the cabin, and how near the robot comes to them.

A crew member is two capsules: the body, which floats along its axis, and the elbows, across it. It
moves on a line at constant speed and does not evade the robot. The robot is told where crew members
are and how they move; seeing them is not simulated, and they are no part of the physics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.schema import Numbers, Tuples
from mlivr_gym.simulation.parameter_set import ParameterSet
from mlivr_gym.values import MAX_LENGTH, MAX_POINTS, Triple

LEAST_DISTANCE = 0.1
"""Distance that the robot keeps from crew members [m]."""

ALLOWANCE = 0.1
"""Distance that is added for what happens between the compared times, and for tracking errors [m].

In the time between two of them, `path_check.CHECK_PERIOD`, a crew member moves at most so far.
"""

KEPT = LEAST_DISTANCE + ALLOWANCE
"""Distance that the robot is to keep by prediction [m]."""

ARM_RADIUS = 0.06
"""Radius of the capsule from elbow to elbow [m]."""

ARM_LENGTH = 0.2
"""Distance of an elbow from the middle, relative to the height."""

PLACE = Tuples((3,), most=MAX_LENGTH, unit="m")
"""A position in the cabin."""

_AROUND = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class CrewMember(ParameterSet):
    """A crew member who crosses the cabin on a line.

    Examples
    --------
    >>> crew = CrewMember((3.5, -3.0, 0.0), (3.5, 3.0, 0.0), speed=0.5, begin=2.0)
    >>> crew.middles(np.array([0.0, 8.0]))[1].tolist()
    [3.5, 0.0, 0.0]
    """

    label: ClassVar[str] = "crew member"

    start: Annotated[Triple, PLACE]
    """Where its middle is before [m]."""
    end: Annotated[Triple, PLACE]
    """Where its middle is after [m]."""
    speed: Annotated[float, Tuples((), 1e-3, 1.0, "m/s")] = 0.5
    """Speed [m/s]."""
    begin: Annotated[float, Tuples((), 0.0, 1e6, "s")] = 0.0
    """Time at which it departs [s]."""
    height: Annotated[float, Tuples((), 0.1, 3.0, "m")] = 1.8
    """Length of the body from head to feet [m]."""
    radius: Annotated[float, Tuples((), 0.01, 1.0, "m")] = 0.25
    """Radius of the body [m]."""

    @checked({"times": Numbers((None,), rows=(0, MAX_POINTS))})
    def middles(self, times: Array) -> Array:
        """Return where its middle is at k times, shape (k, 3) [m]."""
        line = np.array(self.end) - self.start
        gone = self.speed * np.maximum(times - self.begin, 0.0)
        share = np.minimum(gone / max(float(np.linalg.norm(line)), 1e-9), 1.0)
        middles: Array = np.array(self.start) + share[:, None] * line
        return middles

    @property
    def arrival(self) -> float:
        """Time at which it arrives [s]."""
        length = float(np.linalg.norm(np.array(self.end) - self.start))
        return self.begin + length / self.speed

    @property
    def capsules(self) -> tuple[Array, Array]:
        """Ends of the axes relative to the middle, shape (2, 2, 3) [m], and radii, shape (2,)."""
        line = np.array(self.end) - self.start
        length = float(np.linalg.norm(line))
        along = line / length if length > 0.0 else _AROUND
        across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        across /= np.linalg.norm(across)
        axes = np.stack(
            [(0.5 * self.height - self.radius) * along, ARM_LENGTH * self.height * across]
        )
        return np.stack([-axes, axes], axis=1), np.array([self.radius, ARM_RADIUS])


def distance_from_crew(
    axes: Array, radii: Array, crew: Sequence[CrewMember], times: Array
) -> Array:
    """Return the distance of a robot from the closest crew member at k times [s], shape (k,) [m].

    The ends of the axes of the robot's c capsules have shape (k, c, 2, 3) [m], their radii (c,)
    [m].
    """
    closest = np.full(len(times), np.inf)
    for member in crew:
        ends, thickness = member.capsules
        there = member.middles(times)[:, None, None] + ends  # (k, 2, 2, 3)
        apart = segment_distances(axes[:, :, None], there[:, None])
        gaps = apart - radii[:, None] - thickness
        closest = np.minimum(closest, gaps.min(axis=(1, 2)))
    return closest


def segment_distances(first: Array, second: Array) -> Array:
    """Return the distances of segments (Ericson, Real-Time Collision Detection, 2005, 5.1.9).

    Their ends have shapes (..., 2, 3) that can be broadcast [m].
    """
    p, q = first[..., 0, :], second[..., 0, :]
    u, v = first[..., 1, :] - p, second[..., 1, :] - q
    a, b, e = (np.sum(x * y, axis=-1) for x, y in ((u, u), (u, v), (v, v)))
    c, f = np.sum(u * (p - q), axis=-1), np.sum(v * (p - q), axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.nan_to_num(np.clip((b * f - c * e) / (a * e - b * b), 0.0, 1.0))
        t = np.clip(np.nan_to_num((b * s + f) / e), 0.0, 1.0)
        s = np.clip(np.nan_to_num((b * t - c) / a), 0.0, 1.0)
    gap = p + s[..., None] * u - q - t[..., None] * v
    distances: Array = np.linalg.norm(gap, axis=-1)
    return distances
