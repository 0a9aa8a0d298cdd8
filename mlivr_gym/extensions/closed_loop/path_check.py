"""Whether boxes lie where a robot moves along a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.collisions import Configuration, LimbShapes, box_distances, capsule_ends
from mlivr_gym.motion import Trajectory
from mlivr_gym.robot import RobotSpec
from mlivr_gym.stances import StanceGraph
from mlivr_gym.world import Box

CHECK_PERIOD = 0.1
"""Time between two configurations of a trajectory that are compared with boxes [s]."""

HORIZON = 1.0
"""Time for which a robot is assumed to stay as far from its trajectory as it is [s]."""

TOUCH = 0.001
"""Distance from a box that counts as a touch [m]."""

LARGEST_DEVIATION = 0.05
"""Largest distance from its trajectory that is assumed of any part of a robot [m]."""


class PathCheck:
    """The configurations of a trajectory, with bounds of each shape, to be compared with boxes.

    `times` are those of the n configurations, from 0, shape (n,) [s]. In each of them `axes` has
    the ends of the axes of the robot's capsules, see `robot_axes`, and `radii` has their radii.
    """

    def __init__(self, graph: StanceGraph, shapes: LimbShapes, trajectory: Trajectory) -> None:
        """Place the robot of a graph, with its shapes, each `CHECK_PERIOD` of a trajectory."""
        self._graph, self.trajectory = graph, trajectory
        last, stride = len(trajectory.times) - 1, max(round(CHECK_PERIOD / trajectory.period), 1)
        self._samples = np.unique(np.append(np.arange(0, last, stride), last))
        at = trajectory.at(self._samples)
        rows = zip(at.base_positions, at.base_quaternions, at.joint_positions, strict=True)
        self._configurations = list(rows)
        self.times = trajectory.period * self._samples
        self.axes = np.array([robot_axes(graph.robot, shapes, c) for c in self._configurations])
        self.radii = robot_radii(shapes)
        reach = self.radii[:, None] + graph.settings.clearance
        self._low, self._high = self.axes.min(axis=2) - reach, self.axes.max(axis=2) + reach
        points = trajectory.grasps[-1].tolist()
        positions, normals = graph.grasp_map.positions, graph.grasp_map.normals
        self._grasps = [(limb, positions[p], normals[p]) for limb, p in enumerate(points)]

    def is_blocked(self, boxes: Sequence[Box], first: int) -> bool:
        """Return whether the robot comes too close to an axis-aligned box after sample `first`."""
        begin = int(np.searchsorted(self._samples, first))
        clearance = self._graph.settings.clearance
        return self._comes_closer(boxes, begin, self._configurations[begin:], 0.0, clearance)

    def _comes_closer(
        self,
        boxes: Sequence[Box],
        begin: int,
        configurations: Sequence[Configuration],
        deviation: float,
        distance: float,
    ) -> bool:
        """Return whether the robot is closer than a distance [m] to a box in some configurations.

        They are those of the trajectory from index `begin` on, up to a deviation [m].
        """
        if not boxes:
            return False
        low, high = np.stack([box.bounds for box in boxes], axis=1)
        rows = slice(begin, begin + len(configurations))
        meets = (self._low[rows, :, None] - deviation <= high).all(axis=3)
        meets &= (self._high[rows, :, None] + deviation >= low).all(axis=3)
        may_touch = meets.any(axis=1)
        return any(
            pair[2] < distance
            for k in np.flatnonzero(may_touch.any(axis=1)).tolist()
            for pair in box_distances(
                self._graph.robot, [boxes[b] for b in np.flatnonzero(may_touch[k]).tolist()],
                configurations[k], distance, self._grasps,
            )
        )  # fmt: skip

    def bounds_ahead(self, first: int) -> tuple[Array, Array]:
        """Return the corners of a box about the robot during the `HORIZON` after a sample [m]."""
        ahead = self._ahead(first)
        low, high = self._low[ahead].min(axis=(0, 1)), self._high[ahead].max(axis=(0, 1))
        return low - LARGEST_DEVIATION, high + LARGEST_DEVIATION

    def will_touch(self, boxes: Sequence[Box], first: int, present: Configuration) -> bool:
        """Return whether the robot soon touches a box if it stays as far from the trajectory.

        It is in its `present` configuration, in place of that of the sample `first`.
        """
        at, (position, quaternion, joints) = self.trajectory.at(np.array([first])), present
        shift, bend = position - at.base_positions[0], joints - at.joint_positions[0]
        turn = _rotation(quaternion) * _rotation(at.base_quaternions[0]).inv()
        ahead = self._ahead(first)
        displaced = [
            (p + shift, (turn * _rotation(q)).as_quat(scalar_first=True), j + bend)
            for p, q, j in self._configurations[ahead]
        ]
        return self._comes_closer(boxes, ahead.start, displaced, LARGEST_DEVIATION, TOUCH)

    def _ahead(self, first: int) -> slice:
        """Return the range of the configurations during the `HORIZON` after a sample."""
        begin = int(np.searchsorted(self._samples, first))
        return slice(begin, begin + round(HORIZON / CHECK_PERIOD) + 1)


def _rotation(quaternion: Array) -> Rotation:
    """Return the rotation of a quaternion w, x, y, z."""
    return Rotation.from_quat(quaternion, scalar_first=True)


def robot_axes(robot: RobotSpec, shapes: LimbShapes, configuration: Configuration) -> Array:
    """Return the ends of the axes of capsules that contain a robot, shape (c, 2, 3) [m].

    These are the moving capsules limb by limb, then those fixed to the body and about it.
    """
    ends, (position, quaternion, _) = capsule_ends(robot, shapes, configuration), configuration
    base = _rotation(quaternion).as_matrix()
    parts = [limb[: len(shape.radii)] for limb, shape in zip(ends, shapes.each, strict=True)]
    return np.concatenate([*parts, position + _base_capsules(shapes)["ends"] @ base.T])


def robot_radii(shapes: LimbShapes) -> Array:
    """Return the radii of the capsules of `robot_axes`, shape (c,) [m]."""
    return np.concatenate(
        [*(shape.radii for shape in shapes.each), _base_capsules(shapes)["radius"]]
    )


def _base_capsules(shapes: LimbShapes) -> Any:
    """Return the capsules that move with the base, records of `BodyCapsule`."""
    return shapes.robot["base_capsules"][: shapes.robot["base_capsule_count"]]
