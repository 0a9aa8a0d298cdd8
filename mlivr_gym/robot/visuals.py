"""What is seen of limbs: their colours, and mesh files that show their links.

Only pictures, films and the viewer use them, see `pictures.limb_meshes`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.validators import POSITION
from mlivr_gym.schema import Choice, FieldPath, ListOf, OrNone, Struct, Text, Tuples
from mlivr_gym.values import MAX_REMARK_LENGTH, Triple

LIMB_COLOURS = (
    "#d62728", "#1f5fd0", "#ff9f1c", "#17a2a2", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f",
)  # fmt: skip
"""Colour of each limb; red and blue are the paper's."""

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
    position: Annotated[Triple, POSITION] = (0.0, 0.0, 0.0)
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


VISUAL = Struct.of(Visual)
"""Fields of a `Visual`."""

GivenVisuals = Annotated[tuple[Visual, ...] | None, OrNone(ListOf(VISUAL, most=MOST_VISUALS))]
"""Meshes that show a limb, or None."""


def rgba(colour: str) -> Colour:
    """Return the components of a colour like `"#1f77b4"`, opaque."""
    r, g, b = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return r, g, b, 1.0
