"""MuJoCo's and coal's opinion of what the planner's collision checks compare."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import coal
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration, capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.simulation.scene import scene_spec
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.world.boxes import BOX, Box, scene_name

TOUCH = 1e-6
"""Overlaps below this are rounding [m]."""


class Judge:
    """MuJoCo's and coal's opinion of a configuration."""

    def __init__(self, graph: PairGraph) -> None:
        """Build the scene, and the shapes once more for coal."""
        self.graph, self.robot = graph, graph.robot
        self.model = scene_spec(graph.grasp_map, graph.robot).compile()
        self.data = mujoco.MjData(self.model)
        self.names = [self.model.geom(i).name for i in range(self.model.ngeom)]
        self.address = [
            [int(self.model.joint(f"limb{i}/joint{k + 1}").qposadr[0]) for k in range(6)]
            for i in range(graph.robot.limbs)
        ]
        self.shapes = LimbShapes(graph.robot)
        self._boxes = [_solid_of(box) for box in graph.grasp_map.boxes]

    def penetrations(
        self, configuration: Configuration, points: list[tuple[int, int]]
    ) -> list[tuple[str, str, float]]:
        """Pairs in contact with their distances [m], but for grippers with the track they hold.

        Args:
            configuration: The configuration.
            points: Limbs and the points that they are at.
        """
        position, quaternion, joints = configuration
        self.data.qpos[:3], self.data.qpos[3:7] = position, quaternion
        for i, angles in enumerate(joints):
            self.data.qpos[self.address[i]] = angles
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
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
        self,
        configuration: Configuration,
        points: list[tuple[int, int]],
        obstacles: Sequence[Box] = (),
    ) -> float:
        """Coal's least distance of the robot to boxes and between limbs [m].

        Args:
            configuration: The configuration.
            points: Limbs and the points that they are at; their grippers are not compared.
            obstacles: Boxes beside those of the map.
        """
        position, quaternion, _ = configuration
        ends = capsule_ends(self.robot, self.shapes, configuration)
        base = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        radius, half = self.shapes.radii, self.shapes.robot["half"]
        mounts, mount_radius = self.shapes.mounts["ends"], self.shapes.mounts["radius"]
        gripper = int(self.shapes.limb["gripper"])
        at_grasp = {i for i, _ in points}
        limbs = [[_capsule(axis, r) for axis, r in zip(limb, radius, strict=True)] for limb in ends]
        body = [
            _capsule(position + axis @ base.T, r)
            for axis, r in zip(mounts, mount_radius, strict=True)
        ]
        body.append(_solid(half, base, position))
        for i, limb in enumerate(limbs):
            body += limb[:gripper] if i in at_grasp else limb
        boxes = [*self._boxes, *(_solid_of(box) for box in obstacles)]
        least = min((_least(a, b) for a, b in combinations(limbs, 2)), default=np.inf)
        return min(least, _least(body, boxes))


class _Placed(NamedTuple):
    """A shape of coal somewhere, and the sphere round it."""

    shape: Any
    pose: Any
    centre: Array
    """Centre of the sphere [m], shape (3,)."""
    radius: float
    """Radius of the sphere [m]."""


def _capsule(ends: Array, radius: float) -> _Placed:
    """A capsule; `ends` has shape (2, 3) [m]."""
    along, middle = ends[1] - ends[0], 0.5 * (ends[0] + ends[1])
    length = float(np.linalg.norm(along))
    if length < 1e-9:
        shape, turn = coal.Sphere(float(radius)), np.eye(3)
    else:
        shape, z = coal.Capsule(float(radius), length), along / length
        x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
        x /= np.linalg.norm(x)
        turn = np.stack([x, np.cross(z, x), z], axis=1)
    return _Placed(shape, coal.Transform3s(turn, middle), middle, 0.5 * length + float(radius))


def _solid(half: Array, turn: Array, centre: Array) -> _Placed:
    """A box by its half edges [m]."""
    pose = coal.Transform3s(turn, centre)
    return _Placed(coal.Box(*(2.0 * half)), pose, centre, float(np.linalg.norm(half)))


def _solid_of(box: Box) -> _Placed:
    """A box of the map, or an obstacle."""
    return _solid(np.array(box.half), np.array(box.rotation), np.array(box.centre))


def _least(first: Sequence[_Placed], second: Sequence[_Placed]) -> float:
    """Least distance of two groups of shapes [m]; those nearest by their spheres come first."""
    spheres = [np.array([shape.centre for shape in group]) for group in (first, second)]
    radii = [np.array([shape.radius for shape in group]) for group in (first, second)]
    apart = np.linalg.norm(spheres[0][:, None] - spheres[1], axis=2)
    apart -= radii[0][:, None] + radii[1]
    least = np.inf
    for flat in np.argsort(apart, axis=None):
        i, j = divmod(int(flat), len(second))
        if apart[i, j] >= least:
            break
        least = min(least, _distance(first[i], second[j]))
    return least


def _distance(first: _Placed, second: _Placed) -> float:
    """Coal's distance of two placed shapes [m]."""
    places = first.shape, first.pose, second.shape, second.pose
    return float(coal.distance(*places, coal.DistanceRequest(), coal.DistanceResult()))
