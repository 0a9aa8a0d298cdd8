"""The robot that the options of a command describe."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from mlivr_gym.arguments import ANY_NUMBER
from mlivr_gym.collisions.always_close import always_close_links
from mlivr_gym.errors import SettingError
from mlivr_gym.robot.cargo import CARGO, Cargo
from mlivr_gym.robot.sizes import MOST_LIMBS
from mlivr_gym.robot.specification import SUFFIXES, RobotSpec, robot_spec
from mlivr_gym.robot.validators import APART
from mlivr_gym.schema import FieldPath, Integer

OF_FILES = ("locked_joint", "locked_angle", "tool_frame", "package_dir")
"""Options that only the file of a robot without a mount or a locked joint needs."""

OF_ROBOT = (*OF_FILES, "failed_joint", "allow_touching")
"""Options that make a robot another than that of `--robot`."""

NONE = "none"
"""Word for a limb without a locked joint."""


def cargo_of(given: Any, place: FieldPath) -> Cargo:
    """Return the cargo of a mass [kg] and three edges [m]."""
    return CARGO.read({"mass": given[0], "size": given[1:]}, place)


def failed_joint_of(given: Any, place: FieldPath) -> tuple[int, int, float]:
    """Return limb, joint and angle [rad] of a joint that has failed, of three numbers."""
    limb, joint = (int(one) if one.is_integer() else one for one in given[:2])
    return (
        Integer(0, MOST_LIMBS).read(limb, place.entry(0)),
        Integer(1, 7).read(joint, place.entry(1)),
        float(ANY_NUMBER.read(given[2], place.entry(2))),
    )


def is_described(args: argparse.Namespace) -> bool:
    """Return whether the robot of `--robot` is a URDF or MJCF file."""
    return Path(args.robot).suffix.lower() in SUFFIXES


def described_robot(args: argparse.Namespace) -> RobotSpec:
    """Return the robot of `--robot` and of the options on its file and its failed joints.

    What a URDF or MJCF file leaves open, and what is assumed in its place, is printed.
    """
    given = {name: getattr(args, name) for name in OF_FILES if getattr(args, name) is not None}
    if not given:
        robot = robot_spec(args.robot)
    elif not is_described(args):
        raise SettingError(
            f"--{next(iter(given)).replace('_', '-')} has no effect with --robot {args.robot}, "
            "which is no URDF or MJCF file; leave it out"
        )
    else:
        robot = RobotSpec.from_urdf(args.robot, **_as_arguments(given))
    if is_described(args) and not args.quiet:
        print(f"robot of {args.robot}: {robot.source}", file=sys.stderr)
    if args.allow_touching:
        touching = set(always_close_links(robot, args.clearance)) & set(APART)
        robot = replace(robot, apart=tuple(p for p in APART if p in {*robot.apart, *touching}))
    for failed in args.failed_joint:
        robot = robot.with_failed_joint(*failed)
    return robot


def _as_arguments(given: dict[str, list[str]]) -> dict[str, Any]:
    """Return options on a file as arguments of `RobotSpec.from_urdf`."""
    out: dict[str, Any] = dict(given)
    if "package_dir" in out:
        out["package_dirs"] = out.pop("package_dir")
    for name in ("locked_joint", "locked_angle", "tool_frame"):
        if name in out:
            entries = [None if word.lower() == NONE else word for word in out[name]]
            if name == "locked_angle":
                entries = [_number(word) for word in entries]
            out[name] = entries[0] if len(entries) == 1 else entries
    return out


def _number(word: str | None) -> Any:
    """Return the number that a word is, or what is none as it is."""
    try:
        return None if word is None else float(word)
    except ValueError:
        return word


def chosen_robot(args: argparse.Namespace) -> RobotSpec:
    """Return the robot of all options, with the cargo of `--cargo`."""
    return described_robot(args).carrying(args.cargo)
