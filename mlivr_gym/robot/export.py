"""Robots written as URDF and as MJCF.

The robot itself stands in both as JSON, see `description.PLANNING`: a file that nobody changed is
read again by `from_file` as the same robot.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.files import write_whole
from mlivr_gym.robot.capsules import Capsule
from mlivr_gym.robot.derived import DerivedFigures
from mlivr_gym.robot.description import DIGEST, PLANNING, SPEED_LIMITS, digest_of
from mlivr_gym.robot.model import RobotLink, limb_links, quaternion_of
from mlivr_gym.values import as_triple


def as_mjcf(robot: DerivedFigures, path: str | Path | None = None) -> str:
    """Return a robot as MJCF, a body that floats without gravity.

    It is written to a file if one is named. Raises a `RobotError` if its masses are not known, and
    a `FileError` if the file cannot be written.
    """
    root = ElementTree.Element("mujoco", model=robot.name)
    _sub(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    _sub(root, "option", gravity="0 0 0")
    elements: dict[str, Any] = {"": _sub(root, "worldbody")}
    links = list(_links(robot))
    for link in links:
        body = elements[link.name] = _sub(
            elements[link.parent], "body", name=link.name, pos=_text(link.frame[:3, 3]),
            quat=_text(quaternion_of(link.frame[:3, :3])),
        )  # fmt: skip
        if link.solid.mass:
            _sub(
                body, "inertial", pos=_text(link.solid.centre), mass=_text(link.solid.mass),
                fullinertia=_text(link.solid.inertia),
            )  # fmt: skip
        if not link.parent:
            _sub(body, "freejoint", name=link.name)
            _sub(body, "geom", type="box", size=_text(0.5 * robot.body_edges))
            if robot.cargo is not None:
                place, half = robot.cargo_frame, 0.5 * robot.cargo.edges
                turn = _text(quaternion_of(place[:3, :3]))
                _sub(body, "geom", type="box", pos=_text(place[:3, 3]), quat=turn, size=_text(half))
        if link.joint is not None:
            joint = link.joint
            _sub(
                body, "joint", name=joint.name, axis=_text(joint.axis), range=_text(joint.limits),
                armature=_text(joint.rotor), actuatorfrcrange=_text((-joint.torque, joint.torque)),
            )  # fmt: skip
        for capsule in link.capsules:
            # MuJoCo has the shape's z axis point to the end that is named first.
            ends, size = (*capsule.end, *capsule.start), _text(capsule.radius)
            if capsule.start == capsule.end:
                _sub(body, "geom", type="sphere", pos=_text(capsule.start), size=size)
            else:
                _sub(body, "geom", type="capsule", fromto=_text(ends), size=size)
        if link.name.endswith("/gripper"):
            name = link.name.replace("/gripper", "/grasp")
            _sub(body, "site", name=name, pos=_text((0.0, 0.0, robot.tool_length)), size="0.005")
    custom = _sub(root, "custom")
    speeds = [link.joint.speed for link in links if link.joint is not None]
    _sub(custom, "numeric", name=SPEED_LIMITS, size=str(len(speeds)), data=_text(speeds))
    fields = _fields(robot, root)
    _sub(custom, "text", name=PLANNING, data=fields)
    return _written(root, path)


def as_urdf(robot: DerivedFigures, path: str | Path | None = None) -> str:
    """Return a robot as URDF, whose capsules are those of URDF 1.2; arguments as in `as_mjcf`."""
    root = ElementTree.Element("robot", name=robot.name, version="1.2")
    for link in _links(robot):
        element = _sub(root, "link", name=link.name)
        if link.solid.mass:
            inertial = _sub(element, "inertial")
            _sub(inertial, "origin", xyz=_text(link.solid.centre), rpy="0 0 0")
            _sub(inertial, "mass", value=_text(link.solid.mass))
            names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            figures = map(_text, link.solid.inertia)
            _sub(inertial, "inertia", **dict(zip(names, figures, strict=True)))
        if not link.parent:
            collision = _sub(element, "collision")
            _sub(_sub(collision, "geometry"), "box", size=_text(robot.body_edges))
            if robot.cargo is not None:
                collision = _sub(element, "collision")
                place = robot.cargo_frame
                turn = _text(_roll_pitch_yaw(place[:3, :3]))
                _sub(collision, "origin", xyz=_text(place[:3, 3]), rpy=turn)
                _sub(_sub(collision, "geometry"), "box", size=_text(robot.cargo.edges))
        for capsule in link.capsules:
            _add_capsule(element, capsule)
        if link.parent:
            _add_joint(root, link)
        if link.name.endswith("/gripper"):
            grasp = link.name.replace("/gripper", "/grasp")
            _sub(root, "link", name=grasp)
            joint = _sub(root, "joint", name=f"{grasp}/fixed", type="fixed")
            _sub(joint, "origin", xyz=_text((0.0, 0.0, robot.tool_length)), rpy="0 0 0")
            _sub(joint, "parent", link=link.name)
            _sub(joint, "child", link=grasp)
    fields = _fields(robot, root)
    _sub(root, PLANNING).text = fields
    return _written(root, path)


def _links(robot: DerivedFigures) -> Iterator[RobotLink]:
    """Yield the links of a robot, each after the one that carries it."""
    held = () if robot.cargo is None else robot.cargo.limb_capsules
    locked = tuple(
        Capsule("base", as_triple(start), as_triple(end), radius)
        for _, (start, end), radius in held
    )
    yield RobotLink("base", "", np.eye(4), robot.body_solid, locked, None)
    for i in range(robot.limbs):
        yield from limb_links(robot, i, robot.dynamics_of(i))


def _fields(robot: DerivedFigures, root: ElementTree.Element) -> str:
    """Return the robot as JSON, of which neither format has all, with a digest of the rest."""
    return json.dumps(robot.to_dict() | {DIGEST: digest_of(root)})


def _add_capsule(link: ElementTree.Element, capsule: Capsule) -> None:
    """Add a collision shape to a link of a URDF."""
    start, end = np.array(capsule.start), np.array(capsule.end)
    length = float(np.linalg.norm(end - start))
    collision = _sub(link, "collision")
    axis = (end - start) / length if length else np.array([0.0, 0.0, 1.0])
    # Roll 0, then pitch and yaw bring z onto the axis.
    rpy = (0.0, np.arctan2(np.hypot(axis[0], axis[1]), axis[2]), np.arctan2(axis[1], axis[0]))
    _sub(collision, "origin", xyz=_text(0.5 * (start + end)), rpy=_text(rpy))
    shape = _sub(collision, "geometry")
    if length:
        _sub(shape, "capsule", radius=_text(capsule.radius), length=_text(length))
    else:
        _sub(shape, "sphere", radius=_text(capsule.radius))


def _add_joint(root: ElementTree.Element, link: RobotLink) -> None:
    """Add the joint that carries a link of a URDF."""
    joint = link.joint
    name, kind = (f"{link.name}/fixed", "fixed") if joint is None else (joint.name, "revolute")
    element = _sub(root, "joint", name=name, type=kind)
    turn = _text(_roll_pitch_yaw(link.frame[:3, :3]))
    _sub(element, "origin", xyz=_text(link.frame[:3, 3]), rpy=turn)
    _sub(element, "parent", link=link.parent)
    _sub(element, "child", link=link.name)
    if joint is not None:
        _sub(element, "axis", xyz=_text(joint.axis))
        low, high = map(_text, joint.limits)
        effort, velocity = _text(joint.torque), _text(joint.speed)
        _sub(element, "limit", lower=low, upper=high, effort=effort, velocity=velocity)


def _roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Return the angles of URDF [rad]: rotations about the fixed axes x, y and z, in this order."""
    across = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = float(np.arctan2(-rotation[2, 0], across))
    if across < 1e-9:
        return float(np.arctan2(-rotation[1, 2], rotation[1, 1])), pitch, 0.0
    roll = float(np.arctan2(rotation[2, 1], rotation[2, 2]))
    return roll, pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0]))


def _sub(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _text(numbers: Any) -> str:
    """Return numbers with all their digits."""
    return " ".join(repr(float(number)) for number in np.ravel(numbers))


def _written(root: ElementTree.Element, path: str | Path | None) -> str:
    """Return a document as text, written to a file if one is named."""
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode") + "\n"
    if path is not None:
        write_whole(path, text)
    return text
