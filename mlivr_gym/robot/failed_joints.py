"""Robots of which a joint has failed and is locked at an angle.

A limb of seven joints of which one is held has another choice: the failed joint is held, and the
one that was held moves. Its plans are those of the robot that results. A limb of six joints has no
choice: it can hold its point, but neither step nor follow the body; nor has one of seven joints of
which two have failed. The limits of a failed joint are the one angle at which it is locked.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NoReturn

from mlivr_gym.errors import RobotError
from mlivr_gym.robot.derived import DerivedFigures
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.mounts import Mount, even_mounts


def fields_with_failed_joint(
    robot: DerivedFigures, limb: int, joint: int, angle: float
) -> dict[str, Any]:
    """Return the fields in which a robot of which a joint has failed differs.

    Limbs are counted from 0, joints of an arm from 1; the angle at which it is locked is in the
    terms of the limb's `joint_limits` [rad]. Raises a `RobotError` if the limb cannot move without
    that joint, or another of its joints has failed before.
    """
    if limb not in range(robot.limbs):
        raise RobotError(f"limb is {limb!r}; it must be a whole number from 0 to {robot.limbs - 1}")
    mounts = robot.mounts or even_mounts(robot.limbs, robot.mount_radius)
    whole = mounts[limb].limb or robot.limb
    joints = len(whole.joint_limits)
    if joint not in range(1, joints + 1):
        raise RobotError(f"joint is {joint!r}; it must be a whole number from 1 to {joints}")
    if whole.held_joint is None:
        raise RobotError(
            f"limb {limb} has {joints} joints: with joint {joint} failed it can hold its point, "
            "but neither step nor follow the body, so no plan moves a robot that it holds; "
            "only a limb of seven joints plans on"
        )
    if whole.failed_joint is not None:
        if (joint, angle) == (whole.failed_joint, whole.held_angle):
            return {}
        _refuse_second(whole, limb, joint, angle)
    held: dict[str, Any] = {"held_joint": joint, "held_angle": float(angle)}
    try:
        failed = replace(whole, **held)
    except RobotError as fault:
        raise RobotError(f"limb {limb} cannot move with joint {joint} failed: {fault}") from None
    limits = list(whole.joint_limits)
    limits[joint - 1] = (failed.held_angle, failed.held_angle)
    failed = replace(failed, joint_limits=tuple(limits))
    place = mounts[limb]
    mount = Mount(place.position, place.rotation, failed)
    if joint == whole.held_joint:
        shared = place.limb is None
        mount = replace(
            mount,
            capsules=place.capsules or (robot.capsules if shared else None),
            dynamics=place.dynamics or (robot.dynamics if shared else None),
            visuals=place.visuals or (robot.visuals if shared else None),
        )
    return {
        "name": f"{robot.name}-limb{limb}-joint{joint}",
        "mounts": (*mounts[:limb], mount, *mounts[limb + 1 :]),
    }


def _refuse_second(whole: Limb, limb: int, joint: int, angle: float) -> NoReturn:
    """Refuse a joint that fails in a limb of which one has failed before."""
    before = f"joint {whole.failed_joint} of limb {limb} has failed at {whole.held_angle:g} rad"
    if joint == whole.failed_joint:
        raise RobotError(f"{before} already; it cannot be locked at {angle:g} rad as well")
    raise RobotError(
        f"{before} already; with joint {joint} failed at {angle:g} rad as well five joints move: "
        "the limb can hold its point, but neither step nor follow the body"
    )
