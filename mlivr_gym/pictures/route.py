"""The route of a plan as a scene shows it: base path, goal and footholds."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR
from mlivr_gym.pictures.scene_shapes import add_ball, add_capsule, rgba
from mlivr_gym.robot.visuals import LIMB_COLOURS
from mlivr_gym.world.grasp_map import GraspMap

PATH_RADIUS, STANCE_RADIUS, FOOTHOLD_RADIUS = 0.015, 0.03, 0.032
"""Radii of a base path, of the marks of its stances and of footholds [m]."""

GOAL_OPACITY = 0.3
"""Opacity of the ball that shows the goal region."""

SAMPLES = 13
"""Number of samples of a path segment, enough for a smooth line."""

SAME_PLACE = 1e-6
"""Samples closer together than this count as one place [m]."""

Label = tuple[Any, str, str]
"""Position [m], text and colour of a label."""


def base_paths(plan: Plan) -> list[Array]:
    """Return base positions along each step, shapes (k, 3) [m].

    Of a step without a joint path they are those of its stances.
    """
    ends, paths = plan.motion.base_positions, []
    for k, step in enumerate(plan.steps):
        walked = ends[k : k + 2]
        if len(step.knots):
            walked = plan.joint_path(k).samples(SAMPLES).base_positions
        moved = np.linalg.norm(np.diff(walked, axis=0), axis=1) > SAME_PLACE
        paths.append(walked[np.append(True, moved)])
    return paths


def plan_base_path(plan: Plan) -> Array:
    """Sample the base position along a whole plan, shape (k, 3) [m]; k = 1 without a step."""
    return np.concatenate([plan.motion.base_positions[:1], *base_paths(plan)])


class Foothold(NamedTuple):
    """A point that a limb holds in some stances of a plan."""

    position: Array
    """Position of the point, shape (3,) [m]."""
    limb: int
    """Number of the limb."""
    stance: int
    """Number of the first stance in which the limb holds the point."""


class Route(NamedTuple):
    """Base path, stances, goal and footholds of a plan."""

    line: Array
    """Base positions along the base path, shape (k, 3) [m]."""
    stances: Array
    """Base positions of the stances, shape (s, 3) [m]."""
    goal: Array
    """Goal position, shape (3,) [m]."""
    goal_tolerance: float
    """Radius of the goal region [m]."""
    footholds: tuple[Foothold, ...]
    """Footholds at the start, then those of the steps in order."""

    @classmethod
    @checked()
    def of(cls, grasp_map: GraspMap, plan: Plan) -> Route:
        """Return the route of a plan on its map."""
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

    def balls(self) -> list[tuple[Array, float, str]]:
        """Return position [m], radius [m] and colour of the balls at stances and footholds."""
        balls = [(position, STANCE_RADIUS, BASE_COLOUR) for position in self.stances]
        return balls + [
            (hold.position, FOOTHOLD_RADIUS, LIMB_COLOURS[hold.limb]) for hold in self.footholds
        ]

    def add_to(self, scene: Any) -> None:
        """Add the route to a `mujoco.MjvScene`, up to the scene's capacity.

        The base path is a green tube with a ball at each stance, the goal region a translucent
        ball, and footholds are balls in the colour of their limb.
        """
        for a, b in zip(self.line, self.line[1:], strict=False):
            add_capsule(scene, np.stack([a, b]), PATH_RADIUS, rgba(BASE_COLOUR))
        for position, radius, colour in self.balls():
            add_ball(scene, position, radius, rgba(colour))
        add_ball(scene, self.goal, self.goal_tolerance, rgba(GOAL_COLOUR, GOAL_OPACITY))

    def labels(self) -> list[Label]:
        """Return the labels: numbers of stances and footholds.

        The ends come first, and labels that cover others are omitted by pictures.
        """
        lift = np.array([0.0, 0.0, 0.09])
        bases = [(position + lift, str(k), BASE_COLOUR) for k, position in enumerate(self.stances)]
        held = [
            (foothold.position + lift, str(foothold.stance), LIMB_COLOURS[foothold.limb])
            for foothold in self.footholds
        ]
        return [*bases[:1], *bases[1:][-1:], *bases[1:-1], *held]
