"""What the robot believes of the world: its map, what it has seen beside it, and what refused it.

Hits are the surface points that rays of the depth cameras measured. Those that no box of the map
explains are counted in a grid of cubes. Cubes with enough hits are obstacles, merged into boxes.
Counts are kept: what was seen lasts. Where the robot is at present there is nothing else, so cubes
that may be nearer to it than the clearance are left out as long as it is there.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.collisions.contacts import box_distances
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.simulation.disturbances import robot_body_ids
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.mesh_boxes import merged_cells

CUBE = 0.05
"""Edge of the cubes [m]."""

MARGIN = 0.01
"""Distance by which a sensed box extends beyond the hits in its cubes [m]."""

MIN_HITS = 3
"""Number of hits that make a cube an obstacle."""

EXPLAINED_DEVIATIONS = 5.0
"""Distance from a box of the map within which a hit belongs to it, in standard deviations."""

ROUNDING = 1e-4
"""Distance added to this for the rounding of numbers [m]."""

GRID_BORDER = 0.5
"""Distance by which the grid extends beyond the cabin [m]."""

CHECK_PERIOD = 0.1
"""Time between two configurations of a trajectory that are compared with sensed boxes [s]."""

SENSED = "sensed"
"""First part of the ids of boxes that were sensed."""


class Belief:
    """The stance graph of a robot whose map is incomplete, which grows by what is sensed.

    Attributes
    ----------
    graph
        The stance graph, whose obstacles and occupied points are those believed.
    refused
        Indices of the points that count as occupied after attempts to grasp them.
    """

    def __init__(self, graph: StanceGraph, noise: float) -> None:
        """Believe in the map and the obstacles of a graph.

        Parameters
        ----------
        graph
            The stance graph.
        noise
            Standard deviation of a measured distance [m].
        """
        self.graph, self.refused = graph, set[int]()
        self._tolerance = EXPLAINED_DEVIATIONS * noise + ROUNDING
        cabin = graph.grasp_map.cabin
        self._origin = cabin[0] - GRID_BORDER
        shape = np.ceil((cabin[1] - cabin[0] + 2.0 * GRID_BORDER) / CUBE).astype(np.int64)
        self._counts = np.zeros(shape, dtype=np.int32)
        self._low, self._high = np.full((*shape, 3), np.inf), np.full((*shape, 3), -np.inf)
        self._known_low, self._known_high = self._low.copy(), self._high.copy()
        self._cubes, self._fresh = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
        self._is_current = True
        boxes = (*graph.grasp_map.boxes, *graph.obstacles)
        self._known = sorted(boxes, key=lambda box: -float(np.prod(box.half)))

    def refuse(self, point: int) -> None:
        """Let a point count as occupied, since attempts to grasp it failed."""
        self.refused.add(point)
        self.graph.occupy([point])

    def add_hits(self, hits: Array, model: Any, data: Any) -> int:
        """Take in hits of rays; return the number of cubes that changed.

        The graph is as before until `update_graph`.

        Parameters
        ----------
        hits
            Measured positions of surfaces in the module frame [m], shape (k, 3).
        model, data
            The simulation, for the present configuration of the robot.
        """
        unexplained = hits[~self._explained(hits)]
        cells = np.floor((unexplained - self._origin) / CUBE).astype(np.int64)
        inside = ((cells >= 0) & (cells < self._counts.shape)).all(axis=1)
        where = tuple(cells[inside].T)
        np.add.at(self._counts, where, 1)
        np.minimum.at(self._low, where, unexplained[inside])
        np.maximum.at(self._high, where, unexplained[inside])
        grown = self._known_low[where] - self._low[where] > MARGIN
        grown |= self._high[where] - self._known_high[where] > MARGIN
        self._fresh[where] |= grown.any(axis=1)
        cubes = self._counts >= MIN_HITS
        if cubes.any():
            some = np.argwhere(cubes)
            centres = self._origin + CUBE * (some + 0.5)
            reach = 0.5 * np.sqrt(3.0) * CUBE + MARGIN + self.graph.settings.clearance
            cubes[tuple(some[self._close_to_robot(centres, reach, model, data)].T)] = False
        changed = int((cubes != self._cubes).sum())
        self._cubes = cubes
        self._is_current &= not changed and not (self._fresh & cubes).any()
        return changed

    def update_graph(self) -> None:
        """Replace the sensed boxes of the graph by those that are believed now."""
        if self._is_current:
            return
        graph, prefix = self.graph, f"{SENSED}/"
        before = [box.id for box in graph.obstacles if box.id.startswith(prefix)]
        graph.add_obstacles(self.boxes(), replaced=before)
        self._is_current = True
        self._mark_known(self._cubes)

    def _mark_known(self, cubes: BoolArray) -> None:
        """Mark the extents of cubes as known to the graph or to the step that is executed."""
        self._known_low[cubes], self._known_high[cubes] = self._low[cubes], self._high[cubes]
        self._fresh &= ~cubes

    def is_blocked(self, trajectory: Trajectory, first: int) -> bool:
        """Return whether the robot comes closer than the clearance to what is new after a sample.

        New is what was sensed since the last call or `update_graph`. The configurations of the
        trajectory are checked each `CHECK_PERIOD`.
        """
        graph, grasp_map = self.graph, self.graph.grasp_map
        last, stride = len(trajectory.times) - 1, max(round(CHECK_PERIOD / trajectory.period), 1)
        ahead = trajectory.at(np.append(np.arange(first, last, stride), last))
        reach = graph.robot.extent + graph.settings.clearance
        low, high = (
            ahead.base_positions.min(axis=0) - reach,
            ahead.base_positions.max(axis=0) + reach,
        )
        fresh = self._fresh & self._cubes
        self._mark_known(fresh)
        boxes = [
            box
            for box in self._boxes_of(fresh)
            if (
                np.abs(np.array(box.centre) - 0.5 * (low + high)) <= 0.5 * (high - low) + box.half
            ).all()
        ]
        if not boxes:
            return False
        aimed = trajectory.grasps[-1].tolist()
        grasps = [(i, grasp_map.positions[p], grasp_map.normals[p]) for i, p in enumerate(aimed)]
        clearance = graph.settings.clearance
        return any(
            distance < clearance
            for configuration in zip(
                ahead.base_positions, ahead.base_quaternions, ahead.joint_positions, strict=True
            )
            for *_, distance in box_distances(graph.robot, boxes, configuration, clearance, grasps)
        )

    def boxes(self) -> tuple[Box, ...]:
        """Return the boxes that were sensed."""
        return self._boxes_of(self._cubes)

    def _boxes_of(self, cubes: BoolArray) -> tuple[Box, ...]:
        """Return cubes merged into boxes, which contain the hits in them and `MARGIN`."""
        boxes = []
        for k, (first, last) in enumerate(merged_cells(cubes)):
            cells = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
            low = self._low[cells].min(axis=(0, 1, 2)) - MARGIN
            high = self._high[cells].max(axis=(0, 1, 2)) + MARGIN
            boxes.append(Box.between(f"{SENSED}/{k}", "obstacle", low, high))
        return tuple(boxes)

    def _explained(self, hits: Array) -> BoolArray:
        """Return which hits, shape (k, 3), lie on or in a known box."""
        unexplained = np.arange(len(hits))
        for box in self._known:
            local = (hits[unexplained] - np.array(box.centre)) @ np.array(box.rotation)
            excess = np.maximum(np.abs(local) - np.array(box.half), 0.0)
            on_box = np.einsum("ij,ij->i", excess, excess) <= self._tolerance**2
            unexplained = unexplained[~on_box]
        explained = np.ones(len(hits), dtype=np.bool_)
        explained[unexplained] = False
        return explained

    def _close_to_robot(self, centres: Array, reach: float, model: Any, data: Any) -> BoolArray:
        """Return which centres of cubes, shape (k, 3), lie within `reach` [m] of the robot."""
        close = np.zeros(len(centres), dtype=np.bool_)
        for geom in np.flatnonzero(np.isin(model.geom_bodyid, robot_body_ids(model))):
            local = (centres - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
            size = model.geom_size[geom]
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
                # Checks against boxes take the body for capsules that contain it.
                away = np.linalg.norm(np.maximum(np.abs(local) - size, 0.0), axis=1)
                away -= (np.sqrt(2.0) - 1.0) * float(size.max())
            else:  # a capsule along its z axis
                local[:, 2] -= np.clip(local[:, 2], -size[1], size[1])
                away = np.linalg.norm(local, axis=1) - size[0]
            close |= away <= reach
        return close
