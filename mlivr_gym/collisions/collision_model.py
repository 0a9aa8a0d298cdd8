"""A robot's shapes, a world of boxes and the clearance, in the form the compiled checks read."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

from mlivr_gym.collisions.box_grid import BoxWorld
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.world.boxes import Box


class CollisionModel:
    """A robot's shapes among boxes.

    Attributes:
        shapes: The robot's shapes.
        world: The boxes.
        clearance: Least distance [m].
    """

    def __init__(self, shapes: LimbShapes, boxes: Sequence[Box], clearance: float) -> None:
        """Put `shapes` among `boxes`."""
        self.shapes, self.world, self.clearance = shapes, BoxWorld(boxes), clearance

    @cached_property
    def arrays(self) -> tuple[Any, ...]:
        """Seven parts for the kernels.

        `LimbShapes.arrays`, first capsules of gripper and hand, `LimbShapes.fixed`,
        `BoxWorld.arrays`, clearance [m], and `LimbShapes.body`.
        """
        shapes = self.shapes
        return (
            shapes.arrays, shapes.first_gripper, shapes.hand, shapes.fixed, self.world.arrays,
            self.clearance,
            shapes.body,
        )  # fmt: skip
