"""MuJoCo's and coal's opinion of what the planner's collision checks compare."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import coal
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration, capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.simulation.scene import scene_spec, set_configuration
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.world.boxes import BOX, Box, scene_name

TOUCH = 1e-6
"""Overlaps below this are rounding [m]."""

At = list[tuple[int, int]]
"""Limbs, and the points that they are at."""


class Judge:
    """MuJoCo's and coal's opinion of a configuration."""

    def __init__(self, graph: PairGraph) -> None:
        """Build the scene, and the shapes once more for coal."""
        self.graph, self.robot = graph, graph.robot
        self.model = scene_spec(graph.grasp_map, graph.robot).compile()
        self.data = mujoco.MjData(self.model)
        self.names = [self.model.geom(i).name for i in range(self.model.ngeom)]
        self.shapes = LimbShapes(graph.robot)
        self._boxes = [solid(box) for box in graph.grasp_map.boxes]

    def penetrations(
        self, configuration: Configuration, points: At
    ) -> list[tuple[str, str, float]]:
        """Pairs in contact with their distances [m], but for grippers with the track they hold."""
        set_configuration(self.model, self.data, *configuration)
        ids = self.graph.grasp_map.ids
        held = {(f"limb{i}/gripper/0", scene_name(BOX, ids[p].split(":")[0])) for i, p in points}
        found = []
        for k in range(self.data.ncon):
            if self.data.contact.dist[k] < -TOUCH:
                a, b = (self.names[g] for g in self.data.contact.geom[k])
                if (a, b) not in held and (b, a) not in held:
                    found.append((a, b, float(self.data.contact.dist[k])))
        return found

    def least_distance(
        self, configuration: Configuration, points: At, obstacles: Sequence[Box] = ()
    ) -> float:
        """Coal's least distance of the robot to boxes and between limbs [m].

        Grippers at a point are compared with no box; `obstacles` stand beside those of the map.
        """
        position, quaternion, _ = configuration
        base = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        mounts, gripper = self.shapes.mounts, int(self.shapes.limb["gripper"])
        limbs = [
            [capsule(axis, r) for axis, r in zip(limb, self.shapes.radii, strict=True)]
            for limb in capsule_ends(self.robot, self.shapes, configuration)
        ]
        body = [
            capsule(position + axis @ base.T, r)
            for axis, r in zip(mounts["ends"], mounts["radius"], strict=True)
        ]
        body.append(_placed(coal.Box(*(2.0 * self.shapes.robot["half"])), base, position))
        at_grasp = {i for i, _ in points}
        for i, limb in enumerate(limbs):
            body += limb[:gripper] if i in at_grasp else limb
        boxes = [*self._boxes, *map(solid, obstacles)]
        least = min((_least(a, b) for a, b in combinations(limbs, 2)), default=np.inf)
        return min(least, _least(body, boxes))


def _placed(shape: Any, turn: Array, centre: Array) -> Any:
    """A shape of coal somewhere, with its box along the axes."""
    placed = coal.CollisionObject(shape, coal.Transform3s(turn, centre))
    placed.computeAABB()
    return placed


def capsule(ends: Array, radius: float) -> Any:
    """A capsule; `ends` has shape (2, 3) [m]."""
    along, middle = ends[1] - ends[0], 0.5 * (ends[0] + ends[1])
    length = float(np.linalg.norm(along))
    if length < 1e-9:
        return _placed(coal.Sphere(float(radius)), np.eye(3), middle)
    turn = Rotation.align_vectors([along], [[0.0, 0.0, 1.0]])[0].as_matrix()
    return _placed(coal.Capsule(float(radius), length), turn, middle)


def solid(box: Box) -> Any:
    """A box of the map, or an obstacle."""
    shape = coal.Box(*(2.0 * np.array(box.half)))
    return _placed(shape, np.array(box.rotation), np.array(box.centre))


def _least(first: Sequence[Any], second: Sequence[Any]) -> float:
    """Least distance of two groups of shapes [m]; pairs whose boxes are nearest come first."""
    low, high = (
        [np.array([side(placed.getAABB()) for placed in group]) for group in (first, second)]
        for side in (lambda box: box.min_, lambda box: box.max_)
    )
    gaps = np.maximum(low[0][:, None] - high[1], low[1] - high[0][:, None])
    apart, least = np.linalg.norm(np.maximum(gaps, 0.0), axis=2), np.inf
    for flat in np.argsort(apart, axis=None):
        i, j = divmod(int(flat), len(second))
        if apart[i, j] > max(least, 0.0):
            break
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        least = min(least, float(coal.distance(first[i], second[j], request, result)))
    return least
