"""The camera that looks at a scene: what it sees where, and from how far it sees all."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import ANY_NUMBER, Via
from mlivr_gym.arrays import Array
from mlivr_gym.schema import FieldPath, Tuples
from mlivr_gym.values import LONGEST

FIELD_OF_VIEW = 45.0
"""Vertical angle that a picture shows [deg]: MuJoCo's."""


class Camera(NamedTuple):
    """A camera turned towards a place."""

    lookat: tuple[float, float, float]
    """Place in the middle of the picture [m]."""
    distance: float = 5.8
    """Distance from there [m]."""
    azimuth: float = 82.0
    """Angle of the line of sight about z, from x [deg]."""
    elevation: float = -5.0
    """Angle of the line of sight over the horizon [deg]."""

    @property
    def axes(self) -> Array:
        """The picture's axes right, up and ahead in the world, shape (3, 3)."""
        azimuth, elevation = np.deg2rad([self.azimuth, self.elevation])
        ahead = np.array(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
            ]
        )
        right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        return np.stack([right, np.cross(right, ahead), ahead])

    def pixels(self, places: Array, width: int, height: int) -> Array:
        """Where places, shape (k, 3) [m], are in a picture: columns and rows, shape (k, 2) [px].

        NaN where they are behind the camera.
        """
        right, up, ahead = self.axes @ (places - np.array(self.lookat)).T
        depth = self.distance + ahead
        slope = np.tan(np.deg2rad(0.5 * FIELD_OF_VIEW))
        scale = 0.5 * height / slope / np.where(depth > 1e-9, depth, np.nan)
        return np.stack([0.5 * width + scale * right, 0.5 * height - scale * up], axis=1)

    def seeing(self, places: Array, radius: float, aspect: float) -> Camera:
        """The same camera as near as it can be while balls stay inside its picture.

        Parameters
        ----------
        places
            Middles of the balls, shape (k, 3) [m].
        radius
            Their radius [m].
        aspect
            Width of the picture over its height.
        """
        slope = np.tan(np.deg2rad(0.5 * FIELD_OF_VIEW))
        right, up, ahead = self.axes @ (places - np.array(self.lookat)).T
        needed = []
        for off, steep in ((np.abs(up), slope), (np.abs(right), slope * aspect)):
            # A ball touches the edge when its middle is radius / cos from the plane of the edge.
            needed.append((off + radius * np.hypot(1.0, steep)) / steep - ahead)
        return self._replace(distance=float(np.max(needed)))


def _camera(value: Any, place: FieldPath) -> Camera:
    """A camera whose fields are numbers."""
    if not isinstance(value, Camera):
        raise place.refused(value, "a Camera")
    kinds = (Tuples((3,), most=LONGEST, unit="m"), Tuples((), 0.0, LONGEST, "m"))
    fields = zip((*kinds, ANY_NUMBER, ANY_NUMBER), value, Camera._fields, strict=True)
    return Camera(*(kind.read(given, place.field(name)) for kind, given, name in fields))


CAMERA = Via(_camera)
"""A `Camera`."""
