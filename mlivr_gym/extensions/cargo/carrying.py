"""A robot of which one limb carries cargo: it stands folded, and the others walk."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.collisions import (
    LimbShapes,
    ShapesOfLimb,
    cargo_box_capsules,
    segment_box_distance,
    segments_distance,
)
from mlivr_gym.errors import RobotError
from mlivr_gym.robot import MOST_LIMBS, Cargo, LockedLimb, RobotSpec
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.schema import Integer, OrNone, Tuples
from mlivr_gym.values import as_triple

FOLD_STEP = np.pi / 6.0
"""Step of joints 2, 3 and 4 among the folds that are tried [rad]; the others turn by quarters."""

FOLD_CLEARANCE = 0.02
"""Distance that a folded limb and its cargo keep from each other and from the body [m]."""

MOST_FOLDS_TRIED = 4000
"""Largest number of folds whose collisions are checked."""


@checked(
    {
        "robot": InstanceOf(RobotSpec),
        "limb": Integer(0, MOST_LIMBS - 1),
        "cargo": InstanceOf(Cargo),
        "joints": OrNone(Tuples((6,), unit="rad")),
    }
)
def carrying_robot(
    robot: RobotSpec, limb: int, cargo: Cargo, joints: tuple[float, ...] | None = None
) -> RobotSpec:
    """Return a robot whose limb `limb` holds cargo, folded and locked, while the others walk.

    The limbs of the returned robot are the others, in their order. Limb and cargo are a part of its
    body in collisions, masses and inertia.

    Parameters
    ----------
    robot
        A robot of at least three limbs without cargo.
    limb
        Number of the limb that carries.
    cargo
        The bag; its `centre` is one in the frame of the flange.
    joints
        Joint angles of the folded limb [rad]; by default those, of a grid, that bring the bag
        nearest to the body without touching it, above it if possible and never below it.

    Raises
    ------
    RobotError
        If fewer than two limbs would walk, the robot has cargo already, or the limb can stand
        nowhere with this bag.

    Examples
    --------
    >>> from mlivr_gym import robot_spec
    >>> from mlivr_gym.robot import Cargo
    >>> carrying_robot(robot_spec("mlivr3"), 0, Cargo(10.0, 0.2)).limbs
    2
    """
    if robot.limbs < 3:
        raise RobotError(
            f"robot {robot.name!r} has {robot.limbs} limbs; if one carries, two others must walk"
        )
    if limb >= robot.limbs:
        raise RobotError(f"limb is {limb}; robot {robot.name!r} has limbs 0 to {robot.limbs - 1}")
    if robot.cargo is not None:
        raise RobotError(f"robot {robot.name!r} has cargo already; a limb carries the only one")
    mount = replace(robot.mounted[limb], dynamics=robot.dynamics_of(limb))
    others = tuple(one for i, one in enumerate(robot.whole_mounts) if i != limb)
    tried = [joints] if joints is not None else folds(robot, limb, cargo)
    shapes, reason = LimbShapes(robot), "no fold of it lies inside its joint limits"
    for fold in tried[:MOST_FOLDS_TRIED]:
        held = replace(cargo, limb=LockedLimb(mount, tuple(np.asarray(fold).tolist())))
        if touching := _touching(robot, held, shapes.each[limb]):
            reason = f"{touching} would come closer than {FOLD_CLEARANCE:g} m"
            continue
        name = f"{robot.name}-limb{limb}-carries"
        try:
            return replace(robot, name=name, mounts=others, cargo=held)
        except RobotError as error:
            reason = str(error)
    raise RobotError(
        f"limb {limb} of {robot.name!r} cannot carry cargo of "
        f"{' by '.join(f'{edge:g}' for edge in cargo.edges)} m"
        f"{'' if joints is None else ' at these joint angles'}: {reason}"
    )


def folds(robot: RobotSpec, limb: int, cargo: Cargo) -> list[Array]:
    """Return folds of a limb inside its joint limits, those with the nearest bag first.

    Folds with the bag above the body come before those with a bag beside it, where the other limbs
    move. Below it lie the points that they hold: there a bag must not reach.
    """
    kinematics, mount = robot.every_limb[limb], robot.mounted[limb]
    quarters, steps = np.arange(4) * 0.5 * np.pi, np.arange(-np.pi, np.pi - 1e-9, FOLD_STEP)
    grid = [quarters, steps, steps, steps, quarters[1::2], np.zeros(1)]
    low, high = kinematics.windows.T
    angles = low + np.mod(np.array(list(product(*grid))) - low, 2.0 * np.pi)
    angles = angles[(angles <= high).all(axis=1)]
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = mount.rotation, mount.position
    flanges = frame @ link_frames(kinematics, angles)[:, 6]
    places = flanges[:, :3, :3] @ cargo.centre_below(robot.tool_length) + flanges[:, :3, 3]
    lowest = places[:, 2] - np.abs(flanges[:, 2, :3]) @ (0.5 * cargo.edges)
    half = 0.5 * robot.body_edges[2]
    beside = lowest < half
    order = np.lexsort((np.linalg.norm(places, axis=1), beside))
    return list(angles[order[lowest[order] >= -half]])


def _touching(robot: RobotSpec, cargo: Cargo, limb: ShapesOfLimb) -> str:
    """Return which parts of a locked limb, its cargo and the body are too close, empty if none."""
    half, frame = 0.5 * robot.body_edges, cargo.frame_on(robot.body_edges, robot.tool_length)
    held, locked = cargo.limb_capsules, cargo.limb
    assert locked is not None
    for ends, radius in zip(*cargo_box_capsules(cargo, frame), strict=True):
        if _box_distance(ends, half) - radius < FOLD_CLEARANCE:
            return "cargo and body"
    bases = [shape for shape in held if shape[0] == "base"]
    for link, ends, radius in held:
        number = LINKS.index(link)
        from_body, upper_arm = _box_distance(ends, half) - radius, LINKS.index("upper_arm")
        if number >= upper_arm and from_body < FOLD_CLEARANCE:
            return f"{link} and body"
        local = (ends - frame[:3, 3]) @ frame[:3, :3]
        from_cargo = _box_distance(local, 0.5 * cargo.edges) - radius
        if link not in LINKS[6:] and from_cargo < FOLD_CLEARANCE:
            return f"{link} and cargo"
        for _, axis, around in bases if number >= LINKS.index("forearm") else ():
            if _axes_distance(ends, axis) - radius - around < FOLD_CLEARANCE:
                return f"{link} and base"
    frames = locked.frames[limb.links]
    axes = limb.ends @ frames[:, :3, :3].transpose(0, 2, 1) + frames[:, None, :3, 3]
    for a, b in limb.pairs.tolist():
        if _axes_distance(axes[a], axes[b]) - limb.radii[a] - limb.radii[b] < FOLD_CLEARANCE:
            return f"{limb.names[a]} and {limb.names[b]}"
    return ""


def _axes_distance(first: Array, second: Array) -> float:
    """Return the distance of two segments (2, 3) [m]."""
    lines = [as_triple(part) for axis in (first, second) for part in (axis[0], axis[1] - axis[0])]
    return float(segments_distance(*lines))


def _box_distance(axis: Array, half: Array) -> float:
    """Return the distance of a segment (2, 3) from a box about the origin [m]."""
    start, along = as_triple(axis[0]), as_triple(axis[1] - axis[0])
    return float(segment_box_distance(start, along, as_triple(half)))
