"""The camera of a scene: projection of positions to pixels, and the distance to see all of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import ANY_NUMBER, NOT_NEGATIVE, Reader, checked
from mlivr_gym.arrays import Array
from mlivr_gym.schema import FieldPath, Numbers, Tuples
from mlivr_gym.values import MAX_LENGTH, MAX_POINTS

FIELD_OF_VIEW = 45.0
"""Vertical field of view [deg], MuJoCo's default."""


class Camera(NamedTuple):
    """A pinhole camera that looks at a target position."""

    lookat: tuple[float, float, float]
    """Target position, in the centre of the picture [m]."""
    distance: float = 5.8
    """Distance of the camera from the target [m]."""
    azimuth: float = 82.0
    """Angle of the line of sight about z, from x [deg]."""
    elevation: float = -5.0
    """Angle of the line of sight above the horizon [deg]."""

    @property
    def axes(self) -> Array:
        """Axes right, up and ahead of the camera as rows, in the world frame, shape (3, 3)."""
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

    def pixels(self, positions: Array, width: int, height: int) -> Array:
        """Return column and row of positions in a picture, shape (k, 2) [px].

        They are NaN behind the camera. The positions in the world frame have shape (k, 3) [m], the
        picture width and height [px].
        """
        right, up, ahead = self.axes @ (positions - np.array(self.lookat)).T
        depth = self.distance + ahead
        slope = np.tan(np.deg2rad(0.5 * FIELD_OF_VIEW))
        scale = 0.5 * height / slope / np.where(depth > 1e-9, depth, np.nan)
        return np.stack([0.5 * width + scale * right, 0.5 * height - scale * up], axis=1)

    @checked(
        {
            "positions": Numbers((None, 3), rows=(1, MAX_POINTS)),
            "radius": NOT_NEGATIVE,
            "aspect": Tuples((), 1e-3, 1e3),
        }
    )
    def seeing(self, positions: Array, radius: float, aspect: float) -> Camera:
        """Return this camera at the smallest distance at which it sees whole balls.

        Their centres have shape (k, 3), and one radius [m]; the aspect is the width of the picture
        divided by its height.
        """
        slope = np.tan(np.deg2rad(0.5 * FIELD_OF_VIEW))
        right, up, ahead = self.axes @ (positions - np.array(self.lookat)).T
        needed = []
        for off, steep in ((np.abs(up), slope), (np.abs(right), slope * aspect)):
            # A ball touches the picture's edge if its centre is radius / cos from the edge's plane.
            needed.append((off + radius * np.hypot(1.0, steep)) / steep - ahead)
        return self._replace(distance=float(np.max(needed)))


def _camera(value: Any, place: FieldPath) -> Camera:
    """Check that an argument is a camera with valid fields."""
    if not isinstance(value, Camera):
        raise place.refused(value, "a Camera")
    kinds = (Tuples((3,), most=MAX_LENGTH, unit="m"), Tuples((), 0.0, MAX_LENGTH, "m"))
    fields = zip((*kinds, ANY_NUMBER, ANY_NUMBER), value, Camera._fields, strict=True)
    return Camera(*(kind.read(given, place.field(name)) for kind, given, name in fields))


CAMERA = Reader(_camera)
"""Validator of an argument that is a `Camera`."""
