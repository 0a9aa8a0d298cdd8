"""Visual meshes of limbs: which mesh files show which link, and where.

Only pictures, films and the viewer use them, see `pictures.limb_meshes`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.link_frames import axes_of, rigid
from mlivr_gym.schema import Choice, FieldPath, OrNone, Struct, Text, Tuples
from mlivr_gym.values import MAX_REMARK_LENGTH, MAX_ROBOT_LENGTH, Triple

LARGEST_SCALE = 1e3
"""Largest factor from the units of a mesh file to metres."""

MOST_VISUALS = 64
"""Largest number of visual meshes of a limb."""

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, from 0 to 1."""


@dataclass(frozen=True)
class Visual:
    """A mesh file that shows a link of a limb."""

    link: Annotated[str, Choice(LINKS)]
    """One of `capsules.LINKS`."""
    file: Annotated[str, Text(1, MAX_REMARK_LENGTH)]
    """Path of the file, STL or OBJ; one that is missing is named when the robot is drawn."""
    position: Annotated[Triple, Tuples((3,), most=MAX_ROBOT_LENGTH, unit="m")] = (0.0, 0.0, 0.0)
    """Where the mesh's origin lies in the frame of the link [m]."""
    quaternion: Annotated[
        tuple[float, float, float, float], Tuples((4,), -1.0 - 1e-9, 1.0 + 1e-9)
    ] = (1.0, 0.0, 0.0, 0.0)
    """Its orientation there, w, x, y, z."""
    scale: Annotated[Triple, Tuples((3,), most=LARGEST_SCALE)] = (1.0, 1.0, 1.0)
    """Factors from the file's units to metres."""
    colour: Annotated[Colour | None, OrNone(Tuples((4,), 0.0, 1.0))] = None
    """Red, green, blue and opacity, from 0 to 1; None for the colour of the limb."""

    def __post_init__(self) -> None:
        """Check every figure."""
        VISUAL.check(self, FieldPath("visual", RobotError))

    @property
    def frame(self) -> Array:
        """Frame of the mesh in that of the link, shape (4, 4)."""
        return rigid(axes_of(self.quaternion), self.position)


VISUAL = Struct.of(Visual)
"""Fields of a `Visual`."""
