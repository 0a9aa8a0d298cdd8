"""Axes of a stance, from which its candidate base poses are made."""

import numpy as np
from compiled import called

from mlivr_gym.postures.base_poses import _set_axes
from mlivr_gym.postures.records import PostureRule, StanceGeometry


def axes_of(grasps, normals, rail):
    """Body axes at roll zero, outward direction, roll axis, and whether the walls are opposite.

    Grasps are relative to their centroid; the rail is that of the first.
    """
    limbs, rule, geometry = len(grasps), PostureRule.row(), StanceGeometry.row()
    angles = 2.0 * np.pi * np.arange(limbs) / limbs
    rule["mounts"][:limbs] = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    held = geometry["grasps"][:limbs]
    held["point"], held["normal"], held["rail"][0] = grasps, normals, rail
    called(_set_axes)(rule, limbs, geometry)
    return geometry["frame"], geometry["out"], geometry["line"], bool(geometry["opposed"])
