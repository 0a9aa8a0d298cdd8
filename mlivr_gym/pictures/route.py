"""What a scene shows of a plan: base path, goal and footholds."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.base_path import PATH_KINDS, STRAIGHT, base_path, base_poses
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.world.grasp_map import GraspMap

PATH_RADIUS, STANCE_RADIUS, FOOTHOLD_RADIUS = 0.015, 0.03, 0.032
"""Radii of a base path, of the marks of its stances and of footholds [m]."""

GOAL_OPACITY = 0.3
"""Opacity of a goal's ball."""


SAMPLES = 13
"""Places on the base path of a step: enough for an arc to look round."""


def base_paths(plan: Plan, samples: int = SAMPLES) -> list[Array]:
    """Base positions along the base path of each step, shapes (samples, 3) [m]."""
    motion, share = plan.motion, np.linspace(0.0, 1.0, samples)
    turns = scipy.spatial.transform.Rotation.from_quat(
        motion.base_quaternions, scalar_first=True
    ).as_matrix()
    poses = [pose(*at) for at in zip(motion.base_positions, turns, strict=True)]
    found = []
    for k, step in enumerate(plan.steps):
        kind = PATH_KINDS.index(step.path) if step.path in PATH_KINDS else STRAIGHT
        path = base_path(poses[k], poses[k + 1], kind, np.array(step.pivot))
        found.append(base_poses(path, share)[0])
    return found


def plan_base_path(plan: Plan) -> Array:
    """Base positions along a whole plan, shape (k, 3) [m]; one of a plan without a step."""
    return np.concatenate([plan.motion.base_positions[:1], *base_paths(plan)])


class Foothold(NamedTuple):
    """A point that a limb takes hold of."""

    position: Array
    """Where it is, shape (3,) [m]."""
    limb: int
    """The limb."""
    stance: int
    """Number of the stance from which on the limb holds it."""


class Route(NamedTuple):
    """A plan as a scene shows it."""

    line: Array
    """Base positions along the base path, shape (k, 3) [m]."""
    stances: Array
    """Base positions of the stances, shape (s, 3) [m]."""
    goal: Array
    """Goal position, shape (3,) [m]."""
    goal_tolerance: float
    """Radius of the goal's ball [m]."""
    footholds: tuple[Foothold, ...]
    """What limbs hold at the start, and what they take hold of later."""

    @classmethod
    def of(cls, grasp_map: GraspMap, plan: Plan) -> Route:
        """The route of a plan on its map."""
        held = [(point, limb, 0) for limb, point in enumerate(plan.stances[0])]
        held += [(step.to_point, step.limb, k) for k, step in enumerate(plan.steps, 1)]
        return cls(
            plan_base_path(plan),
            plan.motion.base_positions,
            np.array(plan.query.goal),
            plan.query.goal_tolerance,
            tuple(
                Foothold(grasp_map.positions[grasp_map.index(point)], limb, k)
                for point, limb, k in held
            ),
        )

    def add_to(self, scene: Any) -> None:
        """Add the route to a `mujoco.MjvScene`, as far as it has room.

        The base path is a green tube with a ball at each stance, the goal a translucent ball, and
        footholds are balls in the colour of their limb.
        """
        green, gold = _rgba(BASE_COLOUR), _rgba(GOAL_COLOUR, GOAL_OPACITY)
        for a, b in zip(self.line, self.line[1:], strict=False):
            _add_tube(scene, a, b, green)
        for place in self.stances:
            _add_ball(scene, place, STANCE_RADIUS, green)
        for foothold in self.footholds:
            colour = _rgba(LIMB_COLOURS[foothold.limb])
            _add_ball(scene, foothold.position, FOOTHOLD_RADIUS, colour)
        _add_ball(scene, self.goal, self.goal_tolerance, gold)

    def labels(self) -> list[tuple[Array, str, str]]:
        """Place [m], text and colour of what is written: numbers of stances, of footholds too."""
        lift = np.array([0.0, 0.0, 0.09])
        bases = [(place + lift, str(k), BASE_COLOUR) for k, place in enumerate(self.stances)]
        held = [
            (foothold.position + lift, str(foothold.stance), LIMB_COLOURS[foothold.limb])
            for foothold in self.footholds
        ]
        return [*bases, *held]


def _rgba(colour: str, opacity: float = 1.0) -> Array:
    from matplotlib.colors import to_rgba

    return np.array(to_rgba(colour, opacity), dtype=np.float32)


def _add_ball(scene: Any, place: Array, radius: float, colour: Array) -> None:
    import mujoco

    if scene.ngeom < scene.maxgeom:
        geom = scene.geoms[scene.ngeom]
        size, turn = np.full(3, radius), np.eye(3).ravel()
        mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE, size, place, turn, colour)
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR  # which casts no shadow
        scene.ngeom += 1


def _add_tube(scene: Any, start: Array, end: Array, colour: Array) -> None:
    import mujoco

    if scene.ngeom < scene.maxgeom and float(np.linalg.norm(end - start)) > 1e-9:
        geom, capsule = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_CAPSULE
        mujoco.mjv_initGeom(geom, capsule, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
        mujoco.mjv_connector(geom, capsule, PATH_RADIUS, start, end)
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR  # which casts no shadow
        scene.ngeom += 1
