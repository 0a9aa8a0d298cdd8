"""What touches what: distances of the robot from itself and its surroundings.

At rest they are asked of a `Configuration`; whole motions are proved clear by stances and plans.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.collisions.allowed_collisions import ALLOWED_COLLISIONS
    from mlivr_gym.collisions.contacts import (
        Configuration,
        Contact,
        box_distances,
        capsule_ends,
        checked_configuration,
        lies_behind,
    )
    from mlivr_gym.collisions.distances import segment_box_distance, segments_distance
    from mlivr_gym.collisions.limb_shapes import LimbShapes, ShapesOfLimb, cargo_box_capsules

__all__ = [
    "ALLOWED_COLLISIONS",
    "Configuration",
    "Contact",
    "LimbShapes",
    "ShapesOfLimb",
    "box_distances",
    "capsule_ends",
    "cargo_box_capsules",
    "checked_configuration",
    "lies_behind",
    "segment_box_distance",
    "segments_distance",
]

__getattr__, __dir__ = lazy(__name__)
