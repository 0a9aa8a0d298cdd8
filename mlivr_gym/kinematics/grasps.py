"""Grasps: points that a limb can hold, as compiled code reads them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.records import Record, Vector
from mlivr_gym.kinematics.poses import Pose


class Grasp(Record):
    """A point that a limb can hold; all fields are in one frame, the world if none is named."""

    point: Vector
    """The point [m]."""
    normal: Vector
    """Outward surface normal."""
    rail: Vector
    """Direction of the rail."""
    flange: Pose
    """Flange of a limb that holds the point, flip 0: x along the rail, z into the surface."""


def grasp_rows(points: Array, normals: Array, rails: Array, tool_length: float) -> Any:
    """Return rows of `Grasp` for points [m], surface normals and rail directions (..., 3).

    `tool_length` is the distance from the flange to the grasped point [m].
    """
    out = Grasp.rows(*points.shape[:-1])
    out["point"], out["normal"], out["rail"] = points, normals, rails
    flange = out["flange"]
    flange["position"] = points + tool_length * normals
    flange["rotation"][..., 0], flange["rotation"][..., 2] = rails, -normals
    flange["rotation"][..., 1] = np.cross(-normals, rails)
    return out
