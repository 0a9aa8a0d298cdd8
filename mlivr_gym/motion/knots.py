"""Knots of a joint path: curves that were checked, divided until lines between knots stay close.

How far a line is from its curve is measured at three places between its knots, by the joint angles
there: a turn of a joint moves nothing farther from its axis than the arm is long. By how much the
grippers of several support limbs slip on a line is measured in its middle by forward kinematics,
with half of `HOLD_TOLERANCE` allowed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.base_path import BasePath
from mlivr_gym.motion.joint_path import HOLD_TOLERANCE, JointPath
from mlivr_gym.motion.step_ends import StepEnds, joints_on_normal, support_joints
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.stances.stance_graph import StanceGraph

NORMAL_TOLERANCE = 2e-4
"""How far the gripper may be off the surface normal on departure and approach [m]."""

LIFT_SIGMAS: Array = np.linspace(0.0, 1.0, 13)
"""Path parameters of the knots of a departure and of an approach, as long as they are enough."""

SWING_TOLERANCE = 1e-3
"""How far a line may move any limb or the base off the curve of a swing that was checked [m]."""

SHARES: Array = np.array([0.0, 0.25, 0.5, 0.75])
"""Where from one knot to the next the line is compared with the curve."""

SAME_ANGLE = 1e-9
"""Angles that differ by less are equal [rad]."""

MOST_PIECES = 16
"""Most pieces into which an interval is divided at once."""

SHORTEST = 1e-4
"""An interval of the path parameter that is shorter is not divided."""

STEADY = 2.5
"""An interval is at most so much longer than its neighbours, for a spline that does not swing."""

JointCurve = Callable[[Array], Array]
"""Joint angles of all limbs, shape (k, N, 6) [rad], at k path parameters from 0 to 1."""


class SwingPart(NamedTuple):
    """Part of a swing between two points of rest."""

    breaks: Array
    """Path parameters between which it is smooth, from 0 to 1."""
    at: Callable[[Array], Array]
    """Base parameter and joint angles of the moving limb, shape (k, 7), at path parameters (k,)."""


def joint_path_along(
    graph: StanceGraph, ends: StepEnds, path: BasePath, swing: Sequence[SwingPart]
) -> JointPath:
    """Return the joint path of a step: departure, the parts of its swing, and approach.

    Raises a `PlanError` if a limb cannot follow on its branch.
    """
    limb, tail = ends.limb, support_joints(graph, ends, path, np.ones(1))
    rest = JointPath(
        graph.robot, limb, int(limb == 0), ends.positions[0], ends.rotations[0],
        ends.joints[None], np.zeros(1),
    )  # fmt: skip

    def departure(sigma: Array) -> Array:
        joints = np.tile(ends.joints, (len(sigma), 1, 1))
        joints[:, limb] = joints_on_normal(graph, ends, False, sigma)
        return joints

    def approach(sigma: Array) -> Array:
        joints = np.tile(tail[0], (len(sigma), 1, 1))
        joints[:, limb] = joints_on_normal(graph, ends, True, 1.0 - sigma[::-1])[::-1]
        return joints

    def swinging(part: SwingPart) -> JointCurve:
        def curve(sigma: Array) -> Array:
            rows = part.at(sigma)
            joints = support_joints(graph, ends, path, rows[:, 0])
            joints[:, limb] = rows[:, 1:]
            return joints

        return curve

    parts = [divided(departure, LIFT_SIGMAS, rest, NORMAL_TOLERANCE)]
    parts += [divided(swinging(part), part.breaks, rest, SWING_TOLERANCE) for part in swing]
    parts.append(divided(approach, LIFT_SIGMAS, rest, NORMAL_TOLERANCE))
    knots = np.concatenate([parts[0][1], *(knots[1:] for _, knots in parts[1:])])
    sigmas = np.concatenate([[0.0], *(k + sigmas[1:] for k, (sigmas, _) in enumerate(parts))])
    knots[0], knots[-1, limb] = ends.joints, ends.grasp_joints
    return replace(rest, knots=knots, sigmas=sigmas)


def divided(
    curve: JointCurve, sigmas: Array, rest: JointPath, tolerance: float
) -> tuple[Array, Array]:
    """Return path parameters and knots of a curve from which lines between them stay close.

    The path parameters given divide it into smooth parts. `rest` is the joint path of a robot that
    stays where the step begins, and `tolerance` how far lines may leave the curve [m].
    """
    radii, supports = lever_arms(rest.robot, rest.limb) / tolerance, list(rest.supports)
    while True:
        lengths = np.diff(sigmas)
        joints = curve(np.append(sigmas[:-1, None] + lengths[:, None] * SHARES, 1.0))
        knots = joints[::4]
        lines = knots[:-1, None] + SHARES[:, None, None] * np.diff(knots, axis=0)[:, None]
        gaps = np.abs(lines - joints[:-1].reshape(lines.shape))
        off = (gaps * radii).sum(axis=-1).max(axis=(1, 2))
        if gaps[:, :, supports].max() > SAME_ANGLE:  # the base moves
            off = np.maximum(off, rest.slips(lines[:, 2]) / (0.5 * HOLD_TOLERANCE))
        pieces = np.ceil(np.sqrt(off)).clip(1, MOST_PIECES).astype(np.int64)
        pieces[lengths < SHORTEST] = 1
        if pieces.max() == 1:
            break
        number = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        sigmas = np.repeat(sigmas[:-1], pieces) + number * np.repeat(lengths / pieces, pieces)
        sigmas = np.append(sigmas, 1.0)
    steady = steadied(sigmas)
    return steady, knots if len(steady) == len(sigmas) else curve(steady)


def steadied(sigmas: Array) -> Array:
    """Return path parameters with more between those that are far apart, see `STEADY`."""
    while True:
        lengths = np.diff(sigmas)
        beside = np.minimum(np.append(lengths[1:], np.inf), np.append(np.inf, lengths[:-1]))
        middles = (sigmas[:-1] + 0.5 * lengths)[lengths > STEADY * beside]
        if not len(middles):
            return sigmas
        sigmas = np.sort(np.append(sigmas, middles))


@lru_cache(maxsize=16)
def lever_arms(robot: RobotSpec, moving: int) -> Array:
    """Return how far a turn of each joint moves the robot at most, shape (N, 6) [m/rad].

    The moving limb's joints turn what lies between them and its gripper, those of support limbs the
    rest of the robot, as far away as its base.
    """
    out = np.empty((robot.limbs, 6))
    for limb, arm in enumerate(robot.every_limb):
        steps = np.array([np.linalg.norm(place) for place, _ in arm.link_offsets])
        if limb == moving:
            out[limb] = steps[::-1].cumsum()[::-1] - steps + robot.tool_length
        else:
            out[limb] = steps.cumsum() + np.linalg.norm(robot.mount_positions[limb])
    return out
