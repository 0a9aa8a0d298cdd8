"""Independent verdicts of MuJoCo and coal on the collision pairs that the planner checks."""

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
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.world.boxes import BOX, Box, scene_name

TOUCH = 1e-6
"""Penetrations below this depth are rounding errors [m]."""

HeldPoints = list[tuple[int, int]]
"""Pairs of a limb and the point at which its gripper is."""


class Judge:
    """Collision checks of configurations by MuJoCo and coal."""

    def __init__(self, graph: TwoLimbGraph) -> None:
        """Build the MuJoCo scene and the coal shapes of a graph's robot and map."""
        self.graph, self.robot = graph, graph.robot
        self.model = scene_spec(graph.grasp_map, graph.robot).compile()
        self.data = mujoco.MjData(self.model)
        self.names = [self.model.geom(i).name for i in range(self.model.ngeom)]
        self.shapes = LimbShapes(graph.robot)
        self._boxes = [box_shape(box) for box in graph.grasp_map.boxes]

    def penetrations(
        self, configuration: Configuration, points: HeldPoints
    ) -> list[tuple[str, str, float]]:
        """Return pairs in contact with distances [m], except a gripper with the track it holds."""
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
        self, configuration: Configuration, points: HeldPoints, obstacles: Sequence[Box] = ()
    ) -> float:
        """Return coal's minimum distance between robot and boxes and between limbs [m].

        Grippers at a point are not compared with boxes. `obstacles` are added to the boxes of the
        map.
        """
        position, quaternion, _ = configuration
        base = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        mounts, gripper = self.shapes.mounts, int(self.shapes.limb["gripper"])
        limbs = [
            [capsule_shape(axis, r) for axis, r in zip(limb, self.shapes.radii, strict=True)]
            for limb in capsule_ends(self.robot, self.shapes, configuration)
        ]
        body = [
            capsule_shape(position + axis @ base.T, r)
            for axis, r in zip(mounts["ends"], mounts["radius"], strict=True)
        ]
        body.append(_placed(coal.Box(*(2.0 * self.shapes.robot["half"])), base, position))
        at_grasp = {i for i, _ in points}
        for i, limb in enumerate(limbs):
            body += limb[:gripper] if i in at_grasp else limb
        boxes = [*self._boxes, *map(box_shape, obstacles)]
        least = min((_min_distance(a, b) for a, b in combinations(limbs, 2)), default=np.inf)
        return min(least, _min_distance(body, boxes))


def _placed(shape: Any, turn: Array, centre: Array) -> Any:
    """Return a coal shape at a pose, with its bounding box."""
    placed = coal.CollisionObject(shape, coal.Transform3s(turn, centre))
    placed.computeAABB()
    return placed


def capsule_shape(ends: Array, radius: float) -> Any:
    """Return a coal capsule; `ends` has shape (2, 3) [m]."""
    along, middle = ends[1] - ends[0], 0.5 * (ends[0] + ends[1])
    length = float(np.linalg.norm(along))
    if length < 1e-9:
        return _placed(coal.Sphere(float(radius)), np.eye(3), middle)
    turn = Rotation.align_vectors([along], [[0.0, 0.0, 1.0]])[0].as_matrix()
    return _placed(coal.Capsule(float(radius), length), turn, middle)


def box_shape(box: Box) -> Any:
    """Return the coal shape of a box or an obstacle."""
    shape = coal.Box(*(2.0 * np.array(box.half)))
    return _placed(shape, np.array(box.rotation), np.array(box.centre))


def _min_distance(first: Sequence[Any], second: Sequence[Any]) -> float:
    """Return the minimum distance between two groups of shapes [m].

    Pairs are visited in the order of the gaps between their bounding boxes, until no other pair can
    be closer.
    """
    low, high = (
        [np.array([side(placed.getAABB()) for placed in group]) for group in (first, second)]
        for side in (lambda box: box.min_, lambda box: box.max_)
    )
    gaps = np.maximum(low[0][:, None] - high[1], low[1] - high[0][:, None])
    gap, least = np.linalg.norm(np.maximum(gaps, 0.0), axis=2), np.inf
    for flat in np.argsort(gap, axis=None):
        i, j = divmod(int(flat), len(second))
        if gap[i, j] > max(least, 0.0):
            break
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        least = min(least, float(coal.distance(first[i], second[j], request, result)))
    return least
