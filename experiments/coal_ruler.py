"""Distances by other programs: MuJoCo puts the shapes in place, coal measures."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from typing import Any

import coal
import mujoco
import numpy as np

from mlivr_gym import Box, GraspMap
from mlivr_gym.arrays import Array
from mlivr_gym.collisions import Configuration
from mlivr_gym.motion import Plan
from mlivr_gym.robot import RobotSpec
from mlivr_gym.simulation import scene_spec
from mlivr_gym.stances import StanceGraph

REQUEST = coal.DistanceRequest()
PLATE, ROD = (1.5, 1.5, 0.0005), (0.0005, 0.3, 0.0005)
"""Half edges of thin obstacles [m]."""


Placed = tuple[Any, Any]
"""A shape for coal, and where it is."""

AtGrasp = Sequence[tuple[int, Array, Array]]
"""Limbs at grasps, with the points [m] and normals of these."""

HeldPoints = list[tuple[int, int]]
"""Pairs of a limb and the point at which its gripper is."""


def solid(box: Box) -> Placed:
    """Return a box for coal, and where it is."""
    where = coal.Transform3s(np.array(box.rotation), np.array(box.centre))
    return coal.Box(*(2.0 * np.array(box.half))), where


def capsule(radius: float, start: Array, end: Array) -> Placed:
    """Return a capsule for coal, and where it is."""
    along = end - start
    length = float(np.linalg.norm(along))
    turn = np.eye(3)
    if length > 1e-6:
        # A reflection that exchanges the z axis and the capsule's, with another axis reversed.
        out = along / length - (0.0, 0.0, 1.0)
        turn -= 2.0 * np.outer(out, out) / max(out @ out, 1e-300)
        turn[:, 0] *= -1.0 if out.any() else 1.0
    return coal.Capsule(float(radius), length), coal.Transform3s(turn, 0.5 * (start + end))


def apart(first: Placed, second: Placed) -> float:
    """Return the distance of two placed shapes [m], negative where they overlap."""
    return coal.distance(*first, *second, REQUEST, coal.DistanceResult())


def mujoco_pairs(model: mujoco.MjModel) -> set[tuple[str, ...]]:
    """Return the names of the geoms that MuJoCo compares, as sorted pairs.

    With a margin larger than every distance all of them are in contact.
    """
    kept = model.geom_margin.copy(), model.opt.disableflags
    model.geom_margin[:] = 100.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0 + 0.3
    mujoco.mj_forward(model, data)
    model.geom_margin[:], model.opt.disableflags = kept
    names = [model.geom(g).name for g in range(model.ngeom)]
    return {tuple(sorted((names[a], names[b]))) for a, b in data.contact.geom[: data.ncon]}


class Ruler:
    """Least distances of a robot's shapes, which MuJoCo places, from each other and from boxes."""

    def __init__(self, robot: RobotSpec, boxes: Sequence[Box] = ()) -> None:
        """Make the shapes of a robot and of some boxes."""
        self.model = scene_spec(GraspMap.from_dict({"segments": [FLOOR]}), robot).compile()
        self.data = mujoco.MjData(self.model)
        names = [self.model.geom(g).name for g in range(self.model.ngeom)]
        parts = ("body", "limb")
        self.shapes = {g: name for g, name in enumerate(names) if name.startswith(parts)}
        self.geoms, self.radii = {}, np.zeros(self.model.ngeom)
        for g, name in self.shapes.items():
            size = self.model.geom_size[g]
            cube = name == "body"
            edges = 2.0 * size
            self.geoms[g] = coal.Box(*edges) if cube else coal.Capsule(size[0], edges[1])
            self.radii[g] = np.linalg.norm(size) if cube else size[0] + size[1]
        compared = mujoco_pairs(self.model)
        pairs = itertools.combinations(self.shapes, 2)
        some = [pair for pair in pairs if tuple(sorted(names[g] for g in pair)) in compared]
        self.pairs, self.beside_boxes = np.array(some), np.array(list(self.shapes))
        self.among(boxes)

    def only(self, compared: Callable[[str, str], bool]) -> Ruler:
        """Return a ruler of the pairs that are compared by name, those with `"box"` among them."""
        names, other = self.shapes, copy(self)
        some = [(a, b) for a, b in self.pairs.tolist() if compared(names[a], names[b])]
        other.pairs = np.array(some, dtype=int).reshape(-1, 2)
        other.beside_boxes = np.array([g for g in names if compared(names[g], "box")], dtype=int)
        return other

    def among(self, boxes: Sequence[Box]) -> Ruler:
        """Replace the boxes; return the ruler."""
        self.boxes, self.solids = tuple(boxes), [solid(box) for box in boxes]
        self.bounds = np.array([box.bounds for box in boxes]).reshape(-1, 2, 3).swapaxes(0, 1)
        return self

    def measured(
        self, configuration: Configuration, grasps: AtGrasp = (), below: float = 0.1
    ) -> list[tuple[float, str, str]]:
        """Return distances below `below` [m] with the names of both shapes, the least first.

        Left out are pairs that MuJoCo leaves out, and grippers with what lies behind the surface
        they are at.
        """
        position, quaternion, joints = configuration
        self.data.qpos[:] = np.concatenate([position, quaternion, np.ravel(joints)])
        mujoco.mj_kinematics(self.model, self.data)
        where, turned = self.data.geom_xpos, self.data.geom_xmat.reshape(-1, 3, 3)
        away = np.linalg.norm(where[self.pairs[:, 0]] - where[self.pairs[:, 1]], axis=1)
        close = self.pairs[away < self.radii[self.pairs].sum(axis=1) + below].tolist()
        centres = where[self.beside_boxes, None]
        away = np.linalg.norm(centres - np.clip(centres, *self.bounds), axis=2)
        around = np.argwhere(away < self.radii[self.beside_boxes, None] + below)
        around[:, 0] = self.beside_boxes[around[:, 0]]
        used = {*itertools.chain(*close), *around[:, 0].tolist()}
        placed = {g: (self.geoms[g], coal.Transform3s(turned[g], where[g])) for g in used}
        names, at_grasp = self.shapes, {f"limb{limb}/gripper": rest for limb, *rest in grasps}
        found = [(apart(placed[a], placed[b]), names[a], names[b]) for a, b in close]
        for g, k in around.tolist():
            grasp = at_grasp.get(names[g].rsplit("/", 1)[0])
            if grasp is None or not behind(self.boxes[k], *grasp):
                found.append((apart(placed[g], self.solids[k]), names[g], self.boxes[k].id))
        return sorted(entry for entry in found if entry[0] < below)


FLOOR = {"id": "R", "face": "deck", "start": [-0.4, 0, 0], "end": [0.4, 0, 0], "normal": [0, 0, 1]}


def behind(box: Box, point: Array, normal: Array) -> bool:
    """Return whether no corner of a box stands out of a surface by more than 2 mm."""
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    corners = np.array(box.centre) + signs * box.half @ np.array(box.rotation).T
    return bool(((corners - point) @ normal).max() <= 2e-3)


def grasps_of(graph: StanceGraph, points: Iterable[tuple[int, int]]) -> AtGrasp:
    """Return limbs with their grasps; `points` are pairs of limb and point index."""
    grasps = graph.solver.grasps
    return [(limb, grasps["point"][point], grasps["normal"][point]) for limb, point in points]


def sampled(graph: StanceGraph, plan: Plan, samples: int) -> list[tuple[Configuration, HeldPoints]]:
    """Return configurations along each step of a plan, with the limbs that are at a point."""
    found = []
    for k, step in enumerate(plan.steps):
        motion = plan.joint_path(k).samples(samples)
        before, after = (graph.indices(plan.stances[n]) for n in (k, k + 1))
        still = [(i, point) for i, point in enumerate(before) if i != step.limb]
        # It departs from one point and approaches the other; between them it is free.
        moving = [[(step.limb, before[step.limb])], [], [(step.limb, after[step.limb])]]
        for n, phase in enumerate(motion.phase.tolist()):
            here = motion.base_positions[n], motion.base_quaternions[n], motion.joint_positions[n]
            found.append((here, still + moving[phase]))
    return found


@contextmanager
def obstacles(graph: StanceGraph, *boxes: Box) -> Iterator[None]:
    """Add boxes to the obstacles of a graph for a while."""
    graph.add_obstacles(boxes)
    try:
        yield
    finally:
        graph.remove_obstacles()
