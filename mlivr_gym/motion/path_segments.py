"""Path segments of a step: curves in the configuration space of the robot, without time.

A step consists of the departure, one or more segments of the swing, and the approach. Consecutive
lines of the swing that meet in a rounded corner form one segment; the robot is at rest at both ends
of every segment. A segment is sampled over its path parameter sigma, from 0 to 1, and
interpolated by a cubic spline, whose first and second derivatives by sigma give the velocities and
accelerations for any time scaling sigma(t), see `simulation.path_dynamics`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.motion.regrasp import RegraspPath

LINE_SAMPLES = 97
"""Number of samples on a departure, on an approach and on each line of a swing."""


@dataclass(frozen=True)
class PathSegment:
    """One segment of a step, sampled at K values of its path parameter.

    The derivatives of the base are its linear velocity in the world frame and its angular velocity
    in the body frame, the convention of MuJoCo's free joint.
    """

    phase: int
    """Index into `regrasp.PHASES`."""
    sigmas: Array
    """Path parameter sigma at the samples, from 0 to 1, shape (K,)."""
    base_positions: Array
    """Base positions in the world, shape (K, 3) [m]."""
    base_quaternions: Array
    """Base orientations in the world w, x, y, z, shape (K, 4)."""
    joints: Array
    """Joint angles, shape (K, N, 6) [rad]."""
    curve: scipy.interpolate.CubicSpline
    """Cubic spline through base position, accumulated base rotation and joint angles at the
    samples; its derivatives by sigma have shape (k, 6 + 6 N) [m, rad]."""

    @property
    def travel(self) -> float:
        """Largest travel of any joint along the segment [rad]."""
        return float(np.abs(np.diff(self.joints, axis=0)).sum(axis=0).max())


def path_segments(path: RegraspPath, nodes: int = LINE_SAMPLES) -> tuple[PathSegment, ...]:
    """Return the segments of a step in their order along the path.

    A departure, an approach and each line of the swing have a number of samples, `nodes`. Raises a
    `PlanError` if a support limb cannot follow the base.
    """
    sigma, limb = np.linspace(0.0, 1.0, nodes), path.regrasp.limb
    sigmas = [
        sigma, *(np.linspace(0.0, 1.0, lines * (nodes - 1) + 1) for lines in path.lines), sigma
    ]  # fmt: skip
    swings = [path.swing(segment, at) for segment, at in enumerate(sigmas[1:-1])]
    parts = [
        (np.zeros(nodes), path.departure(sigma)), *swings, (np.ones(nodes), path.approach(sigma))
    ]  # fmt: skip
    s = np.concatenate([s for s, _ in parts])
    joints = path.supports(s)
    joints[:, limb] = np.concatenate([moving for _, moving in parts])
    positions, rotations = path.base(s)
    turned = scipy.spatial.transform.Rotation.from_matrix(rotations)
    segments = []
    ends = np.cumsum([0, *map(len, sigmas)])
    for k, at in enumerate(sigmas):
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
    sigma: Array, positions: Array, turned: scipy.spatial.transform.Rotation, joints: Array
) -> scipy.interpolate.CubicSpline:
    """Return the cubic spline of base position, base rotation and joint angles over sigma.

    The base turns about one fixed axis on a base path, so the rotation is the sum of small rotation
    vectors in the body frame.
    """
    turns = (turned[:-1].inv() * turned[1:]).as_rotvec()
    angles = np.concatenate([np.zeros((1, 3)), np.cumsum(turns, axis=0)])
    return scipy.interpolate.CubicSpline(
        sigma, np.column_stack([positions, angles, joints.reshape(len(sigma), -1)])
    )
