"""Places of the robot on a line in joint space, and how far shapes travel from there (compiled).

Every motion is made of pieces on which the joint angles of all limbs change linearly. A limb that
holds a grasp, the leader, carries the base; without a leader the base rests.

**Travel.** A point that a chain of joints carries is `p = T_1 .. T_n x`. Let joint j be turned by
`d_j` against the middle of a piece. The difference of p from its place in the middle telescopes:
term j changes joint j alone, with the joints before it as they are, which keeps lengths, and those
after it as in the middle. So p is displaced by at most `sum |d_j| r_j`, where `r_j` is its distance
from axis j, **both in the middle**. The sum over the joints between two links bounds the
displacement of a point of one as seen from the other; that over the joints of the leader from its
grasp on, and then those of another limb, bounds it in the world. It is the bound of Schwarzer, Saha
and Latombe (IEEE Transactions on Robotics 21, 2005), with the radii of the present place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.limb_shapes import LimbModel
from mlivr_gym.collisions.placement import Shapes, capsule_axis, out_of_link
from mlivr_gym.compiled.bit_sets import has
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints, Record, Rows
from mlivr_gym.kinematics.families import link_frames, turn_flange
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import Pose, cross, length, minus, out_of, vector
from mlivr_gym.robot.specification import MOST_LIMBS

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

RESTING = -1
"""Leader of a line on which the base rests."""

FLANGE = 6
"""Row of the flange among the frames of links."""


class JointLine(Record):
    """A line in joint space of the limbs that take part, and what carries the base."""

    leader: int
    """Limb whose grasp carries the base, or `RESTING`."""
    grasp: Pose
    """Flange of the leader in the world."""
    base: Pose
    """Base in the world while it rests."""
    first: Annotated[Rows[Angles], (MOST_LIMBS,)]
    """Joint angles at the start."""
    last: Annotated[Rows[Angles], (MOST_LIMBS,)]
    """Joint angles at the end."""


class LimbPlace(Record):
    """A limb in the middle of an interval of a line, with bounds of its travel to either end."""

    q: Joints
    """Joint angles [rad]."""
    change: Joints
    """How far each joint turns from the middle to either end [rad]."""
    frames: Annotated[Array, (7, 4, 3)]
    """Link frames in the limb base frame, see `families.link_frames`."""
    axis: Annotated[Array, (6, 3)]
    """Unit vectors along the joints, in the body frame."""
    point: Annotated[Array, (6, 3)]
    """A point on each joint axis, in the body frame [m]."""
    in_body: Shapes
    """Capsules in the body frame, with their travel as seen from the body."""
    in_world: Shapes
    """Capsules in the world, with their travel there."""


@kernel
def place_limb(
    limb: LimbModel, line: JointLine, middle: float, half: float, capsules: int, to: LimbPlace
) -> None:
    """Place a limb at a fraction of a line, with those of its capsules that are in a set.

    Their travel is bounded as seen from the body.
    """
    first, last = line.first[limb.index].q, line.last[limb.index].q
    for j in range(6):
        to.q[j] = first[j] + middle * (last[j] - first[j])
        to.change[j] = half * abs(last[j] - first[j])
    place_axes(limb, to)
    ends, moves = to.in_body.ends, to.in_body.motion
    for c in range(limb.capsule_count):
        if has(capsules, c):
            capsule = limb.capsules[c]
            axis = capsule_axis(capsule.ends)
            for e in range(2):
                p = out_of(limb.mount, out_of_link(to.frames, capsule.link, axis[e]))
                for k in range(3):
                    ends[c, e, k] = p[k]
                moves[c, e] = travel(to, 0, capsule.link, p)


@kernel
def place_axes(limb: LimbModel, to: LimbPlace) -> None:
    """Compute link frames and joint axes of a limb from its joint angles."""
    link_frames(limb.arm, to.q, to.frames)
    for j in range(6):
        o = vector(to.frames[j + 1, 0])
        point = out_of(limb.mount, o)
        axis = minus(out_of(limb.mount, vector(to.frames[j + 1, 3])), vector(limb.mount.position))
        for k in range(3):
            to.axis[j, k], to.point[j, k] = axis[k], point[k]


@kernel
def travel(placed: LimbPlace, first: int, stop: int, p: Triple) -> float:
    """Bound how far joints `first` to `stop` - 1 of a limb, counted from 0, move a point [m]."""
    total = 0.0
    for j in range(first, stop):
        if placed.change[j] > 0.0:
            away = cross(vector(placed.axis[j]), minus(p, vector(placed.point[j])))
            total += placed.change[j] * length(away)
    return total


@kernel
def place_base(limb: LimbModel, placed: LimbPlace, grasp: Pose, base: Pose) -> None:
    """Compute the base in the world of a limb whose flange is at a grasp."""
    frames, mount = placed.frames, limb.mount
    turn_flange(limb.arm, placed.q, frames)
    o = vector(mount.position)
    x, y, z = (
        minus(out_of(mount, vector(frames[FLANGE, 1])), o),
        minus(out_of(mount, vector(frames[FLANGE, 2])), o),
        minus(out_of(mount, vector(frames[FLANGE, 3])), o),
    )
    p, g = out_of(mount, vector(frames[FLANGE, 0])), grasp.rotation
    for row in range(3):
        at = grasp.position[row]
        for k in range(3):
            # Rotations: base in world = grasp in world times the transpose of flange in body.
            turned = g[row, 0] * x[k] + g[row, 1] * y[k] + g[row, 2] * z[k]
            base.rotation[row, k] = turned
            at -= turned * p[k]
        base.position[row] = at


@kernel
def jacobian_determinant(placed: LimbPlace, work: Array) -> float:
    """Return `|det J|` of a placed limb [m^3]; `work`, shape (6, 6), is scratch.

    The twists of the joints are taken at the body's origin, which changes no determinant.
    """
    for j in range(6):
        axis = vector(placed.axis[j])
        arm = cross(vector(placed.point[j]), axis)
        for k in range(3):
            work[k, j], work[3 + k, j] = arm[k], axis[k]
    product = 1.0
    for j in range(6):
        pivot = j
        for row in range(j + 1, 6):
            if abs(work[row, j]) > abs(work[pivot, j]):
                pivot = row
        if work[pivot, j] == 0.0:
            return 0.0
        product *= abs(work[pivot, j])
        for c in range(j, 6):
            work[j, c], work[pivot, c] = work[pivot, c], work[j, c]
        for row in range(j + 1, 6):
            factor = work[row, j] / work[j, j]
            for c in range(j, 6):
                work[row, c] -= factor * work[j, c]
    return product
