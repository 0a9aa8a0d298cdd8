"""Robots written as URDF and as MJCF.

The robot itself stands in both as JSON, see `description.PLANNING`: a file that nobody changed is
read again by `from_file` as the same robot.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.capsules import Capsule
from mlivr_gym.robot.description import DIGEST, PLANNING, SPEED_LIMITS, digest_of
from mlivr_gym.robot.link_frames import quaternion_of
from mlivr_gym.robot.links import RobotLink


def as_mjcf(
    name: str, links: Sequence[RobotLink], tool_length: float, robot: dict[str, Any] | None = None
) -> str:
    """Return the links of a robot as MJCF, a body that floats without gravity.

    Links, joints and shapes have their names; flange and grasp of limb i, which are `tool_length`
    apart [m], are the sites `"limb{i}/flange"` and `"limb{i}/grasp"`. The robot as plain data is
    added if it is given.
    """
    root = ElementTree.Element("mujoco", model=name)
    _sub(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    _sub(root, "option", gravity="0 0 0")
    elements = {"": _sub(root, "worldbody")}
    for link in links:
        body = _sub(elements[link.parent], "body", name=link.name, **_placed(link.frame))
        elements[link.name] = body
        if link.solid.mass:
            fixed = link.joint is None and not any(link.solid.inertia[3:])
            moments = (
                {"diaginertia": _text(link.solid.inertia[:3])} if fixed
                else {"fullinertia": _text(link.solid.inertia)}
            )  # fmt: skip
            centre, mass = _text(link.solid.centre), _text(link.solid.mass)
            _sub(body, "inertial", pos=centre, mass=mass, **moments)
        if not link.parent:
            _sub(body, "freejoint", name=link.name)
        if link.joint is not None:
            joint = link.joint
            _sub(
                body, "joint", name=joint.name, axis=_text(joint.axis), range=_text(joint.limits),
                armature=_text(joint.rotor), actuatorfrcrange=_text((-joint.torque, joint.torque)),
            )  # fmt: skip
        for box, frame, edges in link.boxes:
            _sub(body, "geom", name=box, type="box", size=_text(0.5 * edges), **_placed(frame))
        for k, capsule in enumerate(link.capsules):
            shape = {"name": f"{link.shapes}/{k}", "size": _text(capsule.radius)}
            if capsule.start == capsule.end:
                _sub(body, "geom", type="sphere", pos=_text(capsule.start), **shape)
            else:
                # MuJoCo has the shape's z axis point to the end that is named first.
                ends = _text((*capsule.end, *capsule.start))
                _sub(body, "geom", type="capsule", fromto=ends, **shape)
        if link.name.endswith("/gripper"):
            for site, height in (("flange", 0.0), ("grasp", tool_length)):
                place = _text((0.0, 0.0, height))
                _sub(body, "site", name=link.name.replace("gripper", site), pos=place, size="0.005")
    if robot is not None:
        custom = _sub(root, "custom")
        speeds = [link.joint.speed for link in links if link.joint is not None]
        _sub(custom, "numeric", name=SPEED_LIMITS, size=str(len(speeds)), data=_text(speeds))
        _sub(custom, "text", name=PLANNING, data=_with_digest(robot, root))
    return _written(root)


def as_urdf(
    name: str, links: Sequence[RobotLink], tool_length: float, robot: dict[str, Any]
) -> str:
    """Return a robot as URDF, whose capsules are those of URDF 1.2; arguments as in `as_mjcf`."""
    root = ElementTree.Element("robot", name=name, version="1.2")
    for link in links:
        element = _sub(root, "link", name=link.name)
        if link.solid.mass:
            inertial = _sub(element, "inertial")
            _sub(inertial, "origin", xyz=_text(link.solid.centre), rpy="0 0 0")
            _sub(inertial, "mass", value=_text(link.solid.mass))
            names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            figures = map(_text, link.solid.inertia)
            _sub(inertial, "inertia", **dict(zip(names, figures, strict=True)))
        for _, frame, edges in link.boxes:
            collision = _sub(element, "collision")
            _sub(collision, "origin", **_origin(frame))
            _sub(_sub(collision, "geometry"), "box", size=_text(edges))
        for capsule in link.capsules:
            _add_capsule(element, capsule)
        if link.parent:
            kind = "fixed" if link.joint is None else "revolute"
            joint = link.joint.name if link.joint is not None else f"{link.name}/fixed"
            made = _joined(root, joint, kind, link.parent, link.name, _origin(link.frame))
            if link.joint is not None:
                _sub(made, "axis", xyz=_text(link.joint.axis))
                low, high = map(_text, link.joint.limits)
                effort, velocity = _text(link.joint.torque), _text(link.joint.speed)
                _sub(made, "limit", lower=low, upper=high, effort=effort, velocity=velocity)
        if link.name.endswith("/gripper"):
            grasp = link.name.replace("gripper", "grasp")
            _sub(root, "link", name=grasp)
            place = {"xyz": _text((0.0, 0.0, tool_length)), "rpy": "0 0 0"}
            _joined(root, f"{grasp}/fixed", "fixed", link.name, grasp, place)
    _sub(root, PLANNING).text = _with_digest(robot, root)
    return _written(root)


def _add_capsule(link: ElementTree.Element, capsule: Capsule) -> None:
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


def _joined(
    root: ElementTree.Element, name: str, kind: str, parent: str, child: str, place: dict[str, str]
) -> ElementTree.Element:
    joint = _sub(root, "joint", name=name, type=kind)
    _sub(joint, "origin", **place)
    _sub(joint, "parent", link=parent)
    _sub(joint, "child", link=child)
    return joint


def _placed(frame: Array) -> dict[str, str]:
    return {"pos": _text(frame[:3, 3]), "quat": _text(quaternion_of(frame[:3, :3]))}


def _origin(frame: Array) -> dict[str, str]:
    """Return a frame in terms of URDF: roll, pitch, yaw about the fixed axes x, y, z [rad]."""
    turn = frame[:3, :3]
    across = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = np.arctan2(-turn[2, 0], across)
    if across < 1e-9:
        angles = np.arctan2(-turn[1, 2], turn[1, 1]), pitch, 0.0
    else:
        angles = np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])
    return {"xyz": _text(frame[:3, 3]), "rpy": _text(angles)}


def _with_digest(robot: dict[str, Any], root: ElementTree.Element) -> str:
    """Return the robot as JSON, of which neither format has all, with a digest of the rest."""
    return json.dumps(robot | {DIGEST: digest_of(root)})


def _sub(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _text(numbers: Any) -> str:
    """Return numbers with all their digits, none as -0."""
    return " ".join(repr(float(number) + 0.0) for number in np.ravel(numbers))


def _written(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"
