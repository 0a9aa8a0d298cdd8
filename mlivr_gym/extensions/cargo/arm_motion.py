"""Motions of one limb while the base rests, with or without a bag at its gripper.

A limb that picks a bag up, folds with it or stows it leaves and reaches points and handles along
their normals, as on a step. Between them it moves on a line in joint space, or on two by way of
random joint angles. Configurations `RESOLUTION` apart keep the clearance from everything; between
them a motion is not certified, unlike the steps of a walk.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions import LimbShapes, lies_behind
from mlivr_gym.kinematics import pose
from mlivr_gym.motion import FREE, JointPath
from mlivr_gym.motion.trajectory import trajectory
from mlivr_gym.robot import Cargo, RobotSpec
from mlivr_gym.settings import CLEARANCE
from mlivr_gym.simulation import Limits, Physics, Simulation, scene_spec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.recording import SimulatedInterval
from mlivr_gym.simulation.scene import compile_spec, robot_alone, set_configuration
from mlivr_gym.simulation.timing import timed_path
from mlivr_gym.stances import StanceGraph
from mlivr_gym.transitions.departures import Departure, departure_of
from mlivr_gym.world import BOX, Box, GraspMap, scene_name

RESOLUTION = 0.02
"""Distance of the configurations that are checked, in the joint that moves most [rad]."""

MARGIN, MOST_SAMPLES = 2.0, 1500
"""How far random joint angles lie beyond the ends of a motion [rad], and how many are tried."""


class LimbScene:
    """A scene in which one limb of a robot moves and all else rests.

    With cargo, the gripper of the limb holds it.
    """

    def __init__(
        self,
        robot: RobotSpec,
        limb: int,
        cargo: Cargo | None = None,
        world: tuple[GraspMap, Sequence[Box]] | None = None,
        clearance: float = CLEARANCE,
    ) -> None:
        """Compile the scene of a map and obstacles, or of nothing but the limb and the body."""
        boxes: tuple[Box, ...] = ()
        if world is None:
            spec = robot_alone(robot)
            for geom in spec.geoms:
                if geom.name.startswith("limb") and not geom.name.startswith(f"limb{limb}/"):
                    geom.contype = geom.conaffinity = 0
        else:
            spec, boxes = scene_spec(world[0], robot, world[1]), (*world[0].boxes, *world[1])
        self.robot, self.limb, self._clearance = robot, limb, clearance
        self._depth, name = 0.0, f"limb{limb}"
        if cargo is not None:
            self._depth, place = float(cargo.edges[2]), cargo.centre_below(robot.tool_length)
            bag = spec.body(f"{name}/gripper").add_body(name=f"{name}/cargo", pos=place)
            bag.add_geom(
                name=f"{name}/cargo/0", type=mujoco.mjtGeom.mjGEOM_BOX, size=0.5 * cargo.edges,
                contype=1, conaffinity=3, mass=0.0,
            )  # fmt: skip
            spec.add_exclude(bodyname1=f"{name}/wrist_3", bodyname2=f"{name}/cargo")
        self._model = compile_spec(spec)
        self._data = mujoco.MjData(self._model)
        names = [self._model.geom(g).name for g in range(self._model.ngeom)]
        self._moving = np.array([n.startswith(f"{name}/") and "/base/" not in n for n in names])
        hand = f"{name}/gripper", f"{name}/cargo"
        self._at_hand = np.array([n.startswith(hand) for n in names])
        self._model.geom_margin[self._moving] = clearance
        self._boxes = {names.index(scene_name(BOX, box.id)): box for box in boxes}
        self._low, self._high = robot.every_limb[limb].windows.T
        self._shapes = LimbShapes(robot).rows

    def stand(self, position: Array, quaternion: Array, joints: Array) -> None:
        """Put the base and the other limbs where they stay; `joints` has shape (N, 6) [rad]."""
        set_configuration(self._model, self._data, position, quaternion, joints)
        self._base = pose(position, self._data.body("base").xmat.reshape(3, 3))
        self._joints = joints

    def is_clear(self, joints: Array, at: Any = None) -> bool:
        """Return whether the limb keeps the clearance at its joint angles, shape (6,) [rad].

        At a grasp the gripper may touch what lies behind it, and cargo what lies behind its foot.
        """
        model, data = self._model, self._data
        data.qpos[7 + 6 * self.limb : 13 + 6 * self.limb] = joints
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        contact = data.contact
        for pair, distance in zip(contact.geom.tolist(), contact.dist.tolist(), strict=True):
            first, second = sorted(pair, key=lambda geom: bool(self._moving[geom]))
            if not self._moving[second] or distance >= self._clearance:
                continue
            box = self._boxes.get(first)
            if at is None or box is None or not self._at_hand[second]:
                return False
            if not lies_behind(box, at["point"] - self._depth * at["normal"], at["normal"]):
                return False
        return True

    def is_clear_along(self, knots: Sequence[Array] | Array, at: Any = None) -> bool:
        """Return whether the limb keeps the clearance on the lines between knots (6,) [rad]."""
        for first, last in pairwise(knots):
            count = int(np.ceil(np.abs(last - first).max() / RESOLUTION)) + 1
            if not all(self.is_clear(q, at) for q in np.linspace(first, last, count)):
                return False
        return True

    def departures(self, grasp: Any) -> list[Array]:
        """Return knots from a grasp, a record of `Grasp`, to above it, each (k, 6) [rad].

        They are clear, and on different branches and flips.
        """
        found, lines = Departure.row(), []
        for branch, flip in np.ndindex(8, 2):
            if not departure_of(self._shapes, self.limb, self._base, grasp, branch, found):
                continue
            knots = found["knots"]["q"][: found["pieces"] + 1].copy()
            turned = knots[0, 5] + np.pi * flip - self._low[5]
            knots[:, 5] += self._low[5] + np.mod(turned, 2.0 * np.pi) - knots[0, 5]
            inside = (knots >= self._low).all() and (knots <= self._high).all()
            if inside and self.is_clear_along(knots, grasp):
                lines.append(knots)
        return lines

    def connect(self, first: Array, last: Array) -> list[Array] | None:
        """Return the knots of one or two clear lines between joint angles (6,) [rad], or None."""
        low = np.maximum(np.minimum(first, last) - MARGIN, self._low)
        high = np.minimum(np.maximum(first, last) + MARGIN, self._high)
        rng, knots = np.random.default_rng(0), [first, last]
        for _ in range(MOST_SAMPLES):
            if all(map(self.is_clear, knots)) and self.is_clear_along(knots):
                return knots
            knots = [first, rng.uniform(low, high), last]
        return None

    def motion(self, points: Sequence[int], parts: Sequence[Sequence[Array] | Array]) -> LimbMotion:
        """Return the motion over parts, knots of the limb from rest to rest, each (k, 6) [rad].

        It begins with the points that limbs hold, `FREE` for one that is free.
        """
        angles = np.concatenate([parts[0][:1], *(part[1:] for part in parts)])
        knots = np.tile(self._joints, (len(angles), 1, 1))
        knots[:, self.limb] = angles
        rests = np.cumsum([0, *(len(part) - 1 for part in parts)]).tolist()
        base = self._base["position"], self._base["rotation"]
        leader = int(self.limb == 0)
        path = JointPath(self.robot, self.limb, leader, *base, knots, tuple(rests))
        return LimbMotion(path, tuple(points))


class LimbMotion(NamedTuple):
    """A motion of one limb from rest to rest while the base rests."""

    path: JointPath
    """The joint path, of a robot with the masses that are moved."""
    points: tuple[int, ...]
    """Index of the point that each limb holds before it, or `FREE`, N numbers."""

    def execute(self, graph: StanceGraph, limits: Limits) -> SimulatedInterval:
        """Carry the motion out in MuJoCo, from where it begins, as fast as limits allow.

        Simulated are the map and the obstacles of a graph.
        """
        grasp_map, period = graph.grasp_map, Physics().timestep
        # Any ids do: nothing is grasped on the way.
        ids = [grasp_map.ids[point] for point in self.points]
        moved = trajectory(grasp_map, (ids, ids), timed_path(self.path, limits), period)
        grasps = np.tile(self.points, (len(moved.times), 1))
        grasps[:, self.path.limb] = FREE
        moved = replace(moved, phase=np.ones_like(moved.phase), grasps=grasps)
        simulation = Simulation(grasp_map, self.path.robot, obstacles=graph.obstacles)
        simulation.reset(*moved.configuration(0), self.points)
        return simulation.move(moved)
