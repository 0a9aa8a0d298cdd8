"""What the robot believes of the world: its map, boxes about what it saw, and what refused it.

Hits that no known box explains are counted in a grid of cubes. A cube with enough of them is an
obstacle, and cubes beside each other are merged into boxes. Where the robot is there is nothing
else, so cubes that may be nearer to it than the clearance are left out as long as it is there.

The graph is told at a grasp of what was seen since the last one. What was seen since then is new:
if it lies in the way of a step, this is blocked.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arguments import InstanceOf, Validators, checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions import Configuration, box_distances
from mlivr_gym.extensions.closed_loop.hits import (
    HITS,
    MARGINS,
    NOISE,
    SENSED,
    HitCubes,
    unexplained,
)
from mlivr_gym.motion import Trajectory
from mlivr_gym.schema import Integer
from mlivr_gym.sharing import Independent
from mlivr_gym.stances import StanceGraph, State
from mlivr_gym.world import BOX, Box, scene_name

GRID_BORDER = 0.5
"""Distance by which the grid extends beyond the cabin [m]."""

CELL = 4
"""Edge of the cells of `Belief.occupancy`, in cubes."""

CAPSULES_EXCESS = 0.2
"""Distance by which capsules about the body extend beyond it, relative to its longest edge."""

CHECK_PERIOD = 0.1
"""Time between two configurations of a trajectory that are compared with what is new [s]."""

MAX_SAMPLE = 2**31 - 1
"""Largest number of a sample of a trajectory."""

GIVEN: Validators = {
    "graph": InstanceOf(StanceGraph),
    "noise": NOISE,
    "hits": HITS,
    "trajectory": InstanceOf(Trajectory),
    "sample": Integer(0, MAX_SAMPLE),
    "state": InstanceOf(State),
}
"""Validators of the arguments."""


class Belief(Independent):
    """The stance graph of a robot whose map is incomplete, which grows by what is sensed.

    Attributes
    ----------
    graph
        The stance graph, whose obstacles and occupied points are those believed.
    refused
        Indices of the points that count as occupied, since limbs did not get to them.
    """

    @checked(GIVEN)
    def __init__(self, graph: StanceGraph, noise: float) -> None:
        """Believe in the map and the obstacles of a graph.

        `noise` is the standard deviation of a measured distance [m]. Raises a `SettingError` if it
        is no number from 0 to 0.1 m.
        """
        self.graph, self.refused, self._noise = graph, set[int](), noise
        self._known = *graph.grasp_map.boxes, *graph.obstacles
        border = GRID_BORDER * np.array([[-1.0], [1.0]])
        self._cubes = HitCubes(np.array(graph.grasp_map.cabin) + border)

    def refuse(self, point: int) -> None:
        """Let a point count as occupied, since attempts to reach it failed."""
        self.graph.occupy([point])
        self.refused.add(point)

    def relax(self) -> bool:
        """Take what was seen to be smaller from now on; return whether it was not already.

        It is not if nothing was seen. The graph is as before until `update_graph`.
        """
        cubes = self._cubes
        if cubes.margin == MARGINS[-1] or not len(cubes.number):
            return False
        cubes.margin, cubes.told[:] = MARGINS[-1], -np.inf
        return True

    def withdraw(self) -> None:
        """Let the graph have nothing any more that was sensed."""
        self.graph.remove_obstacles(self._sensed_ids)
        self.graph.vacate(sorted(self.refused))

    @property
    def _sensed_ids(self) -> list[str]:
        """Ids of the boxes of the graph that were sensed."""
        return [box.id for box in self.graph.obstacles if box.id.startswith(SENSED)]

    @checked(GIVEN)
    def add_hits(self, hits: Array) -> None:
        """Take in hits of rays: positions of surfaces in the module frame [m], shape (k, 3).

        The graph is as before until `update_graph`. Raises a `SettingError` if the hits are not all
        finite positions. Nothing is taken in then.
        """
        self._cubes.add(unexplained(hits, self._known, self._noise))

    @checked(GIVEN)
    def update_graph(self, state: State) -> bool:
        """Let the graph have what is believed now, for a robot in a state; return if it is new.

        The state has one branch for each limb, unless nothing was sensed yet.
        """
        cubes = self._cubes
        if not cubes.is_new.any():
            return False
        there = self._apart_from(self.graph.configuration(state), cubes.is_solid)
        if not cubes.is_new[there].any():
            return False
        self.graph.add_obstacles(cubes.merged(there), replaced=self._sensed_ids)
        cubes.told[:] = -np.inf
        cubes.told[there] = cubes.extent[there]
        return True

    def _apart_from(self, configuration: Configuration, chosen: BoolArray) -> IntArray:
        """Return the numbers of the chosen cubes of which no part may be too close to the robot.

        The capsules by which the graph checks the body are larger than the body.
        """
        robot, cubes = self.graph.robot, np.flatnonzero(chosen)
        reach = self.graph.settings.clearance + CAPSULES_EXCESS * max(robot.body_edges)
        boxes = self._cubes.whole(cubes)
        row = {scene_name(BOX, box.id): k for k, box in enumerate(boxes)}
        pairs = box_distances(robot, boxes, configuration, reach)
        return np.delete(cubes, sorted({row[name] for _, name, away in pairs if away < reach}))

    @checked(GIVEN)
    def is_blocked(self, trajectory: Trajectory, sample: int) -> bool:
        """Return whether the robot comes closer than the clearance to what is new after a sample.

        New is what was sensed and the graph does not have, but for what is at the robot where the
        trajectory begins.
        """
        if not self._cubes.is_new.any():
            return False
        stride, last = max(round(CHECK_PERIOD / trajectory.period), 1), len(trajectory.times) - 1
        samples = np.array([0, *range(min(sample, last), last, stride), last])
        at, grasp_map = trajectory.at(samples), self.graph.grasp_map
        places = zip(at.base_positions, at.base_quaternions, at.joint_positions, strict=True)
        new = self._cubes.merged(self._apart_from(next(places), self._cubes.is_new))
        grasps = [
            (limb, grasp_map.positions[point], grasp_map.normals[point])
            for limb, point in enumerate(trajectory.grasps[-1].tolist())
        ]
        robot, clearance = self.graph.robot, self.graph.settings.clearance
        return any(
            away < clearance
            for place in places
            for *_, away in box_distances(robot, new, place, clearance, grasps)
        )

    def boxes(self) -> tuple[Box, ...]:
        """Return the boxes that were sensed."""
        return self._cubes.merged(np.flatnonzero(self._cubes.is_solid))

    def occupancy(self) -> BoolArray:
        """Return in which cells of the module obstacles were seen, shape (nx, ny, nz).

        Cells have edges of `CELL` cubes; the first begins at the corner of the grid of cubes.
        """
        seen = np.zeros(-(-np.array(self._cubes.shape) // CELL), dtype=np.bool_)
        seen[tuple((self._cubes.cells[self._cubes.is_solid] // CELL).T)] = True
        return seen
