"""Whether boxes lie where a robot moves along a trajectory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlivr_gym.collisions.contacts import box_distances, capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box

CHECK_PERIOD = 0.1
"""Time between two configurations of a trajectory that are compared with boxes [s]."""


class PathCheck:
    """The configurations of a trajectory, with bounds of each shape, to be compared with boxes.

    Attributes
    ----------
    trajectory
        The trajectory.
    """

    def __init__(self, graph: StanceGraph, shapes: LimbShapes, trajectory: Trajectory) -> None:
        """Place the robot each `CHECK_PERIOD`.

        Parameters
        ----------
        graph
            The stance graph.
        shapes
            Shapes of its robot.
        trajectory
            The trajectory.
        """
        self._graph, self.trajectory = graph, trajectory
        last, stride = len(trajectory.times) - 1, max(round(CHECK_PERIOD / trajectory.period), 1)
        self._samples = np.unique(np.append(np.arange(0, last, stride), last))
        at = trajectory.at(self._samples)
        rows = zip(at.base_positions, at.base_quaternions, at.joint_positions, strict=True)
        self._configurations = list(rows)
        body = np.linalg.norm(shapes.robot["half"])
        mounts = np.linalg.norm(shapes.mounts["ends"], axis=2) + shapes.mounts["radius"][:, None]
        radii = [shape.radii for shape in shapes.each]
        radii.append(np.array([max(body, mounts.max(initial=0.0))]))
        reach = np.concatenate(radii)[:, None] + graph.settings.clearance
        low, high = [], []
        for configuration in self._configurations:
            ends = capsule_ends(graph.robot, shapes, configuration)
            parts = [
                limb[: len(shape.radii)] for limb, shape in zip(ends, shapes.each, strict=True)
            ]
            axes = np.concatenate([*parts, np.tile(configuration[0], (1, 2, 1))])
            low.append(axes.min(axis=1) - reach)
            high.append(axes.max(axis=1) + reach)
        self._low, self._high = np.array(low), np.array(high)
        points = trajectory.grasps[-1].tolist()
        positions, normals = graph.grasp_map.positions, graph.grasp_map.normals
        self._grasps = [(limb, positions[p], normals[p]) for limb, p in enumerate(points)]

    def is_blocked(self, boxes: Sequence[Box], first: int) -> bool:
        """Return whether the robot comes closer than the clearance to a box after a sample.

        Parameters
        ----------
        boxes
            Axis-aligned boxes.
        first
            Index of the sample.
        """
        if not boxes:
            return False
        begin = int(np.searchsorted(self._samples, first))
        low, high = np.stack([box.bounds for box in boxes], axis=1)
        meets = (self._low[begin:, :, None] <= high).all(axis=3)
        meets &= (self._high[begin:, :, None] >= low).all(axis=3)
        graph, may_touch = self._graph, meets.any(axis=1)
        clearance = graph.settings.clearance
        return any(
            distance < clearance
            for k in np.flatnonzero(may_touch.any(axis=1))
            for *_, distance in box_distances(
                graph.robot, [boxes[b] for b in np.flatnonzero(may_touch[k]).tolist()],
                self._configurations[begin + k], clearance, self._grasps,
            )
        )  # fmt: skip
