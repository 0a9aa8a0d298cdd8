"""A robot of which one limb carries cargo: it stands folded, and the others walk."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.extensions.cargo.arm_motion import LimbScene
from mlivr_gym.robot import MOST_LIMBS, Cargo, LockedLimb, RobotSpec
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.schema import Integer

FOLD_STEP = np.pi / 6.0
"""Step of joints 2, 3 and 4 among the folds that are tried [rad]; the others turn by quarters."""


@checked(
    {
        "robot": InstanceOf(RobotSpec),
        "limb": Integer(0, MOST_LIMBS - 1),
        "cargo": InstanceOf(Cargo),
    }
)
def carrying_robot(robot: RobotSpec, limb: int, cargo: Cargo) -> RobotSpec:
    """Return a robot whose limb `limb` holds cargo, folded and locked, while the others walk.

    The limbs of the returned robot are the others, in their order. Limb and cargo are a part of its
    body in collisions, masses and inertia. The limb folds so that the bag, whose `centre` is one in
    the frame of the flange, is above the body and as near to it as it can be without touching it.

    Raises a `RobotError` if fewer than two limbs would walk, the robot has cargo already, or the
    limb can stand nowhere with this bag.

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
    name, reason = f"{robot.name}-limb{limb}-carries", "each fold of it touches something"
    scene = LimbScene(robot, limb, cargo)
    for fold in folds(robot, limb, cargo):
        if scene.is_clear(fold):
            held = replace(cargo, limb=LockedLimb(mount, tuple(fold.tolist())))
            try:
                return replace(robot, name=name, mounts=others, cargo=held)
            except RobotError as error:
                reason = str(error)
    raise RobotError(
        f"limb {limb} of {robot.name!r} cannot carry cargo of "
        f"{' by '.join(f'{edge:g}' for edge in cargo.edges)} m: {reason}"
    )


def folds(robot: RobotSpec, limb: int, cargo: Cargo) -> list[Array]:
    """Return folds of a limb with the bag above the body, those with the nearest bag first.

    Beside the body the other limbs move, and below it lie the points that they hold.
    """
    kinematics, mount = robot.every_limb[limb], robot.mounted[limb]
    quarters, steps = np.arange(4) * 0.5 * np.pi, np.arange(-np.pi, np.pi - 1e-9, FOLD_STEP)
    grid = [quarters, steps, steps, steps, quarters[1::2], np.zeros(1)]
    low, high = kinematics.windows.T
    angles = low + np.mod(np.array(list(product(*grid))) - low, 2.0 * np.pi)
    angles = angles[(angles <= high).all(axis=1)]
    flanges = mount.frame @ link_frames(kinematics, angles)[:, 6]
    places = flanges[:, :3, :3] @ cargo.centre_below(robot.tool_length) + flanges[:, :3, 3]
    lowest = places[:, 2] - np.abs(flanges[:, 2, :3]) @ (0.5 * cargo.edges)
    above = lowest >= 0.5 * robot.body_edges[2]
    order = np.linalg.norm(places[above], axis=1).argsort(kind="stable")
    return list(angles[above][order])
