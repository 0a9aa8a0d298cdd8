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
        ends = capsule_ends(self.robot, self.shapes, configuration)
        base = Rotation.from_quat(configuration[1], scalar_first=True).as_matrix()
        radius, half = self.shapes.radii, self.shapes.robot["half"]
        mounts, mount_radius = self.shapes.mounts["ends"], self.shapes.mounts["radius"]
        gripper = int(self.shapes.limb["gripper"])
        at_grasp = {i for i, _ in points}
        limbs = [[_capsule(axis, r) for axis, r in zip(limb, radius, strict=True)] for limb in ends]
        with_boxes = [
            _capsule(configuration[0] + axis @ base.T, r)
            for axis, r in zip(mounts, mount_radius, strict=True)
        ]
        with_boxes.append((coal.Box(*(2.0 * half)), coal.Transform3s(base, configuration[0])))
        for i, limb in enumerate(limbs):
            with_boxes += limb[:gripper] if i in at_grasp else limb
        least = min(
            (
                _distance(a, b)
                for first, second in combinations(limbs, 2)
                for a in first
                for b in second
            ),
            default=np.inf,
        )
        for shape, pose in with_boxes:
            # The sphere round a shape tells from which boxes it is far enough away.
            shape.computeLocalAABB()
            middle = pose.getTranslation()
            for box in (*self.graph.grasp_map.boxes, *obstacles):
                away = np.maximum(np.maximum(box.bounds[0] - middle, middle - box.bounds[1]), 0.0)
                if np.linalg.norm(away) - shape.aabb_radius < min(least, 0.1):
                    solid = coal.Box(*(2.0 * np.array(box.half)))
                    where = coal.Transform3s(np.array(box.rotation), np.array(box.centre))
                    least = min(least, _distance((shape, pose), (solid, where)))
        return float(least)


def _capsule(ends: Array, radius: float) -> tuple[Any, Any]:
    """A capsule for coal, and where it is; `ends` has shape (2, 3) [m]."""
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    if length < 1e-9:
        return coal.Sphere(float(radius)), coal.Transform3s(np.eye(3), ends[0])
    turn = Rotation.align_vectors([along / length], [[0.0, 0.0, 1.0]])[0].as_matrix()
    return coal.Capsule(float(radius), length), coal.Transform3s(turn, 0.5 * (ends[0] + ends[1]))


def _distance(first: tuple[Any, Any], second: tuple[Any, Any]) -> float:
    """Coal's distance of two placed shapes [m]."""
    return float(coal.distance(*first, *second, coal.DistanceRequest(), coal.DistanceResult()))
