"""The pieces of a step: curves in the robot's configurations, each run through from rest to rest.

A step departs, swings along the lines between its knots, and approaches. Lines that meet in a
rounded corner are one piece. A piece is the curve of one of these with its first and second
derivatives by the share of the piece, from 0 to 1. Dynamics along it are then a matter of the share
and of how fast it changes, see `simulation.path_dynamics`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.motion.regrasp import RegraspPath

LINE_SAMPLES = 97
"""Places at which a line, departure or approach is looked at."""


@dataclass(frozen=True)
class PathSegment:
    """One piece of a step at K places.

    Speeds of the base are linear in the world and angular in the base's axes, as those of MuJoCo's
    free joint.

    Attributes
    ----------
    phase
        Index into `regrasp.PHASES`.
    shares
        Shares of the piece, shape (K,).
    base_positions
        Shape (K, 3) [m].
    base_quaternions
        Shape (K, 4), w, x, y, z.
    joints
        Shape (K, N, 6) [rad].
    curve
        Base position, base rotation and joints through these places; its derivatives by the
        share are of shape (k, 6 + 6 N) [m, rad].
    """

    phase: int
    shares: Array
    base_positions: Array
    base_quaternions: Array
    joints: Array
    curve: scipy.interpolate.CubicSpline

    @property
    def travel(self) -> float:
        """Farthest travel of any joint [rad]."""
        return float(np.abs(np.diff(self.joints, axis=0)).sum(axis=0).max())


def path_segments(path: RegraspPath, nodes: int = LINE_SAMPLES) -> tuple[PathSegment, ...]:
    """The pieces of a step in their order.

    Parameters
    ----------
    path
        The step.
    nodes
        Places at which a line, departure or approach is looked at.

    Raises
    ------
    PlanError
        If a limb that holds cannot follow the base.
    """
    share, limb = np.linspace(0.0, 1.0, nodes), path.regrasp.limb
    shares = [
        share, *(np.linspace(0.0, 1.0, lines * (nodes - 1) + 1) for lines in path.lines), share
    ]  # fmt: skip
    swings = [path.swing(segment, at) for segment, at in enumerate(shares[1:-1])]
    parts = [
        (np.zeros(nodes), path.departure(share)), *swings, (np.ones(nodes), path.approach(share))
    ]  # fmt: skip
    u = np.concatenate([u for u, _ in parts])
    joints = path.supports(u)
    joints[:, limb] = np.concatenate([moving for _, moving in parts])
    positions, rotations = path.base(u)
    turned = scipy.spatial.transform.Rotation.from_matrix(rotations)
    segments = []
    ends = np.cumsum([0, *map(len, shares)])
    for k, at in enumerate(shares):
        here = slice(ends[k], ends[k + 1])
        segments.append(
            PathSegment(
                0 if k == 0 else 2 if k == len(parts) - 1 else 1,
                at,
                positions[here],
                turned[here].as_quat(scalar_first=True),
                joints[here],
                _curve(at, positions[here], turned[here], joints[here]),
            )
        )
    return tuple(segments)


def _curve(
    share: Array, positions: Array, turned: scipy.spatial.transform.Rotation, joints: Array
) -> scipy.interpolate.CubicSpline:
    """Base position, angle turned about each of the base's axes, and joints, by the share.

    On a base path the base turns about one axis, so small turns add up.
    """
    turns = (turned[:-1].inv() * turned[1:]).as_rotvec()
    angles = np.concatenate([np.zeros((1, 3)), np.cumsum(turns, axis=0)])
    return scipy.interpolate.CubicSpline(
        share, np.column_stack([positions, angles, joints.reshape(len(share), -1)])
    )
