"""The place: graspable points on rails, and the boxes that must not be touched.

A `GraspMap` holds the points of a module with its boxes; obstacles are boxes that come later.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.world.boxes import BOX, Box, load_obstacles, scene_name
    from mlivr_gym.world.covering_boxes import capsule_box, point_cloud_boxes
    from mlivr_gym.world.grasp_map import PLACES, GraspMap, as_map, jem_map
    from mlivr_gym.world.meshes import largest_excess, merged_cells, mesh_boxes

__all__ = [
    "BOX",
    "PLACES",
    "Box",
    "GraspMap",
    "as_map",
    "capsule_box",
    "jem_map",
    "largest_excess",
    "load_obstacles",
    "merged_cells",
    "mesh_boxes",
    "point_cloud_boxes",
    "scene_name",
]

__getattr__, __dir__ = lazy(__name__)
