"""Arms of files that this package wrote, which say themselves what they are."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from mlivr_gym.errors import RobotError
from mlivr_gym.robot.any_limb import LIMB_OF_FAMILY
from mlivr_gym.robot.description import Description
from mlivr_gym.robot.file_arms import FileArm, body_frame
from mlivr_gym.robot.joint_chain import RecognisedArm
from mlivr_gym.robot.link_frames import inverse, link_frames, rigid
from mlivr_gym.schema import FieldPath

LIMBS = "every_limb"
"""Name of the limbs among the fields of such a file."""

AS_WRITTEN = 1e-7
"""Largest deviation of a link's frame from that of the limb, in metres and radians, in a file that
nobody changed."""

OF_FILE = ("joint_limits", "window_starts", "joints", "family")
"""Fields of a limb that are read from the rest of the file."""


def exported_arm(file: Description, arm: FileArm, number: int) -> RecognisedArm | None:
    """Return the arm of a limb as the file says that it is, by its number.

    The result is None if it says nothing, or its joints are no longer those of that limb.
    """
    listed = file.fields.get(LIMBS)
    if not file.is_exported or not isinstance(listed, list) or number >= len(listed):
        return None
    limb = LIMB_OF_FAMILY.read(listed[number], FieldPath(f"{LIMBS}[{number}]", RobotError))
    base = body_frame(file.data, int(file.model.body_parentid[arm.first]))
    there = np.array([body_frame(file.data, link) for link in arm.links])
    axes = file.model.jnt_axis[list(arm.joints), 2]
    if (
        np.abs(base @ link_frames(limb, np.zeros(6))[1:] - there).max() > AS_WRITTEN
        or np.abs(axes - limb.signs).max() > AS_WRITTEN
    ):
        return None
    mount = base
    if limb.base_in_mount is not None:
        mount = base @ inverse(rigid(*limb.base_in_mount))
    count = len(limb.joint_limits)
    signs, zeros = np.ones(count), np.zeros(count)
    if limb.joints is not None:
        signs, zeros = np.array(limb.joints.signs), np.array(limb.joints.zeros)
    given = {one.name: getattr(limb, one.name) for one in fields(limb) if one.name not in OF_FILE}
    held = limb.held_joint
    limits = (-np.pi, np.pi) if held is None else limb.joint_limits[held - 1]
    return RecognisedArm(type(limb), given, signs, zeros, mount, limits)
