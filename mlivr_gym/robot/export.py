"""Robots written as URDF and as MJCF.

Both are written with all digits: read again by `from_file` they give the same robot. What neither
format has, such as the candidate heights of the base, stands as JSON in an element of its own, see
`description.PLANNING`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.files import write_whole
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.derived import DerivedFigures
from mlivr_gym.robot.description import PLANNING, ROTORS, SPEED_LIMITS, WINDOWS
from mlivr_gym.robot.limb_dynamics import gripper_link
from mlivr_gym.robot.link_frames import axes_of
from mlivr_gym.robot.model import quaternion_of
from mlivr_gym.robot.rigid import RigidBody
from mlivr_gym.values import as_triple

FIELDS = (
    "characteristic_length", "grasp_separation", "span", "heights", "rolls", "lift", "folds",
    "source", "apart",
)  # fmt: skip
"""Fields of `RobotSpec` that neither format has."""


class WrittenJoint(NamedTuple):
    """A joint about the z axis of the link that it moves."""

    name: str
    """Its name."""
    limits: tuple[float, float]
    """Lower and upper limit [rad]."""
    torque: float
    """Largest torque [N m]."""
    speed: float
    """Largest speed [rad/s]."""
    rotor: float
    """Inertia of its rotor [kg m^2]."""


class WrittenLink(NamedTuple):
    """A link as it is written to a file."""

    name: str
    """Its name."""
    parent: str
    """Name of the link that carries it, empty for the body."""
    origin: Array
    """Its origin in the frame of that link [m], shape (3,)."""
    rotation: Array
    """Its axes in that frame, shape (3, 3)."""
    mass: RigidBody
    """Its mass, centre and inertia."""
    capsules: tuple[Capsule, ...]
    """Its collision shapes."""
    joint: WrittenJoint | None
    """The joint that moves it, None if it is fixed."""


def as_mjcf(robot: DerivedFigures, fields: dict[str, Any], path: str | Path | None = None) -> str:
    """Return a robot as MJCF, a body that floats without gravity.

    It is written to a file if one is named; `fields` are those of the robot as plain data. Raises a
    `RobotError` if its masses are not known, and a `FileError` if the file cannot be written.
    """
    root = ElementTree.Element("mujoco", model=robot.name)
    _sub(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    _sub(root, "option", gravity="0 0 0")
    elements: dict[str, Any] = {"": _sub(root, "worldbody")}
    links = list(_links(robot))
    for link in links:
        body = elements[link.name] = _sub(
            elements[link.parent], "body", name=link.name, pos=_text(link.origin),
            quat=_text(quaternion_of(link.rotation)),
        )  # fmt: skip
        if link.mass.mass:
            _sub(
                body, "inertial", pos=_text(link.mass.centre), mass=_text(link.mass.mass),
                fullinertia=_text(link.mass.inertia),
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
                body, "joint", name=joint.name, axis="0 0 1", range=_text(joint.limits),
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
    _sub(custom, "text", name=PLANNING, data=_fields(robot, fields))
    return _written(root, path)


def as_urdf(robot: DerivedFigures, fields: dict[str, Any], path: str | Path | None = None) -> str:
    """Return a robot as URDF, whose capsules are those of URDF 1.2; arguments as in `as_mjcf`."""
    root = ElementTree.Element("robot", name=robot.name, version="1.2")
    for link in _links(robot):
        element = _sub(root, "link", name=link.name)
        if link.mass.mass:
            inertial = _sub(element, "inertial")
            _sub(inertial, "origin", xyz=_text(link.mass.centre), rpy="0 0 0")
            _sub(inertial, "mass", value=_text(link.mass.mass))
            names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            figures = map(_text, link.mass.inertia)
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
    _sub(root, PLANNING).text = _fields(robot, fields)
    return _written(root, path)


def _links(robot: DerivedFigures) -> Iterator[WrittenLink]:
    """Yield the links of a robot, each after the one that carries it."""
    none = np.zeros(3)
    held = () if robot.cargo is None else robot.cargo.limb_capsules
    locked = tuple(
        Capsule("base", as_triple(start), as_triple(end), radius)
        for _, (start, end), radius in held
    )
    yield WrittenLink("base", "", none, np.eye(3), robot.body_solid, locked, None)
    mounts = zip(robot.mount_positions, robot.mount_rotations, strict=True)
    for i, (position, rotation) in enumerate(mounts):
        dynamics, limb = robot.dynamics_of(i), robot.every_limb[i]
        parts = {
            name: tuple(c for c in robot.mounted[i].capsules or () if c.link == name)
            for name in LINKS
        }
        parent = f"limb{i}"
        yield WrittenLink(
            parent, "base", position, rotation, dynamics.base_link, parts["base"], None
        )
        for k, (origin, quaternion) in enumerate(limb.link_offsets):
            axes = np.round(axes_of(quaternion), 15)
            name = f"limb{i}/{LINKS[k + 1]}"
            mass = RigidBody(
                dynamics.masses[k], as_triple(np.array(dynamics.centres[k])), dynamics.inertias[k]
            )
            joint = WrittenJoint(
                f"limb{i}/joint{k + 1}", tuple(limb.limits[k].tolist()), dynamics.torque_limits[k],
                dynamics.speed_limits[k], dynamics.rotor_inertias[k],
            )  # fmt: skip
            yield WrittenLink(
                name, parent, np.array(origin), axes, mass, parts[LINKS[k + 1]], joint
            )
            parent = name
        gripper = gripper_link(robot.gripper_mass, robot.tool_length)
        yield WrittenLink(
            f"limb{i}/gripper", parent, none, np.eye(3), gripper, parts["gripper"], None
        )


def _fields(robot: DerivedFigures, fields: dict[str, Any]) -> str:
    """Return what neither format has, as JSON."""
    fields = {name: value for name, value in fields.items() if name in FIELDS}
    fields[WINDOWS] = [limb.window_starts for limb in robot.every_limb]
    fields[ROTORS] = [robot.dynamics_of(i).rotor_inertias for i in range(robot.limbs)]
    return json.dumps(fields)


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


def _add_joint(root: ElementTree.Element, link: WrittenLink) -> None:
    """Add the joint that carries a link of a URDF."""
    joint = link.joint
    name, kind = (f"{link.name}/fixed", "fixed") if joint is None else (joint.name, "revolute")
    element = _sub(root, "joint", name=name, type=kind)
    _sub(element, "origin", xyz=_text(link.origin), rpy=_text(_roll_pitch_yaw(link.rotation)))
    _sub(element, "parent", link=link.parent)
    _sub(element, "child", link=link.name)
    if joint is not None:
        _sub(element, "axis", xyz="0 0 1")
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
