"""Where the capsules of a limb are (compiled)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.limb_shapes import LimbModel
from mlivr_gym.compiled.bit_sets import EVERY, has
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Joints, Record
from mlivr_gym.kinematics.chain import link_frames
from mlivr_gym.kinematics.poses import out_of
from mlivr_gym.robot.sizes import MOST_CAPSULES

if TYPE_CHECKING:
    from mlivr_gym.values import Triple


class Shapes(Record):
    """The capsules of a limb at one configuration."""

    ends: Annotated[Array, (MOST_CAPSULES, 2, 3)]
    """Ends of their axes [m]."""
    motion: Annotated[Array, (MOST_CAPSULES, 2)]
    """Upper bound of how far each end moves [m]."""


class Placed(Record):
    """A limb that does not move."""

    q: Joints
    """Joint angles [rad]."""
    frames: Annotated[Array, (7, 4, 3)]
    """Link frames in the limb base frame, see `chain.link_frames`."""
    in_body: Shapes
    """Its capsules in the body frame."""


@kernel
def axis_of(ends: Array, c: int) -> tuple[Triple, Triple]:
    """Return both ends of the axis of capsule `c` from ends of shape (c, 2, 3)."""
    return (
        (ends[c, 0, 0], ends[c, 0, 1], ends[c, 0, 2]),
        (ends[c, 1, 0], ends[c, 1, 1], ends[c, 1, 2]),
    )


@kernel
def place(limb: LimbModel, capsules: int, frames: Array, ends: Array) -> None:
    """Compute the ends of those capsules of a limb that are in a set, in the body frame.

    Link frames are in the limb base frame, ends have shape (c, 2, 3) [m].
    """
    for c in range(limb.capsule_count):
        if has(capsules, c):
            axis = capsule_axis(limb.capsules[c].ends)
            for e in range(2):
                p = out_of(limb.mount, out_of_link(frames, limb.capsules[c].link, axis[e]))
                for k in range(3):
                    ends[c, e, k] = p[k]


@kernel
def capsule_axis(ends: Array) -> tuple[Triple, Triple]:
    """Return both ends of a capsule's axis from an array of shape (2, 3)."""
    return (ends[0, 0], ends[0, 1], ends[0, 2]), (ends[1, 0], ends[1, 1], ends[1, 2])


@kernel
def out_of_link(frames: Array, f: int, p: Triple) -> Triple:
    """Return a point of the frame of link `f` in the limb base frame [m]."""
    x, y, z = p
    return (
        frames[f, 0, 0] + x * frames[f, 1, 0] + y * frames[f, 2, 0] + z * frames[f, 3, 0],
        frames[f, 0, 1] + x * frames[f, 1, 1] + y * frames[f, 2, 1] + z * frames[f, 3, 1],
        frames[f, 0, 2] + x * frames[f, 1, 2] + y * frames[f, 2, 2] + z * frames[f, 3, 2],
    )


@entry
def place_in_body(robots: Any, i: int, placed: Any) -> None:
    """Compute the capsule ends of limb `i` in the body frame from its joint angles.

    `robots` is a record of `RobotModel` and `placed` a record of `Placed`, each of shape (1,).
    """
    limb, one = robots[0].limbs[i], placed[0]
    link_frames(limb.arm, one.q, one.frames)
    place(limb, EVERY, one.frames, one.in_body.ends)
