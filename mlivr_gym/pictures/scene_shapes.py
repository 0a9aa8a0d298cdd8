"""Shapes that a picture shows beside what belongs to the scene, such as a path or a bag.

Each function adds one to a `mujoco.MjvScene`, if the scene has capacity for it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.world.boxes import Box


def rgba(colour: str, opacity: float = 1.0) -> Array:
    """Convert a colour to red, green, blue and opacity, from 0 to 1."""
    from matplotlib.colors import to_rgba

    return np.array(to_rgba(colour, opacity), dtype=np.float32)


def add_ball(scene: Any, position: Array, radius: float, colour: Array) -> None:
    """Add a ball, which casts no shadow, at a position of shape (3,) [m]."""
    if scene.ngeom < scene.maxgeom:
        import mujoco

        geom = scene.geoms[scene.ngeom]
        size, rotation = np.full(3, radius), np.eye(3).ravel()
        mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE, size, position, rotation, colour)
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR  # casts no shadow
        scene.ngeom += 1


def add_capsule(scene: Any, ends: Array, radius: float, colour: Array) -> None:
    """Add a capsule, which casts no shadow; the ends of its axis have shape (2, 3) [m]."""
    start, end = ends
    if scene.ngeom < scene.maxgeom and float(np.linalg.norm(end - start)) > 1e-9:
        import mujoco

        geom, capsule = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_CAPSULE
        mujoco.mjv_initGeom(geom, capsule, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
        mujoco.mjv_connector(geom, capsule, radius, start, end)
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        scene.ngeom += 1


def add_box(scene: Any, box: Box, opacity: float = 1.0) -> None:
    """Add a box in the colour of its kind; a fainter one casts no shadow."""
    if scene.ngeom < scene.maxgeom:
        import mujoco

        from mlivr_gym.simulation.scene import COLOURS

        geom, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_BOX
        colour, rotation = np.array(COLOURS[box.kind], dtype=np.float32), np.array(box.rotation)
        colour[3] *= opacity
        half, centre = np.array(box.half), np.array(box.centre)
        mujoco.mjv_initGeom(geom, kind, half, centre, rotation.ravel(), colour)
        if opacity < 1.0:
            geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        scene.ngeom += 1
