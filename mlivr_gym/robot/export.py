"""Robots written as MJCF, and as URDF, into which their MJCF is translated.

The robot itself stands in both as JSON, see `description.PLANNING`: a file that nobody changed is
read again by `from_file` as the same robot.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.description import DIGEST, PLANNING, SPEED_LIMITS, digest_of
from mlivr_gym.robot.fields import RobotFields
from mlivr_gym.robot.limb_dynamics import arm_dynamics, gripper_link
from mlivr_gym.robot.rigid import RigidBody, axes_of, quaternion_of, rigid

Element = ElementTree.Element


def as_mjcf(robot: RobotFields, *, with_robot: bool) -> str:
    """Return a robot as MJCF, a body that floats without gravity, perhaps with itself as JSON.

    The body is `"base"` with the free joint `"base"`, joints have the names of
    `RobotSpec.named_joints`. Base and links of limb i are `"limb{i}"` and `"limb{i}/{link}"`, their
    capsules `"limb{i}/{link}/{number}"`; its flange frame is the site `"limb{i}/flange"`, its grasp
    the site `"limb{i}/grasp"`. Limbs whose masses are not known have those of the UR5e, which a
    picture does not need and a simulation refuses.
    """
    root = _mjcf(robot)
    if with_robot:
        custom, speeds = _sub(root, "custom"), robot.speed_limits
        _sub(custom, "numeric", name=SPEED_LIMITS, size=str(speeds.size), data=_text(speeds))
        _sub(custom, "text", name=PLANNING, data=_with_digest(robot, root))
    return _written(root)


def as_urdf(robot: RobotFields) -> str:
    """Return a robot as URDF, whose capsules are those of URDF 1.2."""
    root = Element("robot", name=robot.name, version="1.2")
    speeds = iter(robot.speed_limits.ravel().tolist())
    for body in _mjcf(robot).findall("worldbody/body"):
        _add_link(root, body, speeds)
    _sub(root, PLANNING).text = _with_digest(robot, root)
    return _written(root)


def _mjcf(robot: RobotFields) -> Element:
    root = Element("mujoco", model=robot.name)
    _sub(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    _sub(root, "option", gravity="0 0 0")
    base = _body(_sub(root, "worldbody"), "base", np.eye(4), robot.body_solid)
    _sub(base, "freejoint", name="base")
    _sub(base, "geom", name="body", type="box", size=_text(0.5 * robot.body_edges))
    if robot.cargo is not None:
        size = _text(0.5 * robot.cargo.edges)
        _sub(base, "geom", name="cargo", type="box", size=size, **_placed(robot.cargo_frame))
        for k, (_, ends, radius) in enumerate(robot.cargo.limb_capsules):
            _add_capsule(base, f"cargo/limb/{k}", ends.tolist(), radius)
    gripper = gripper_link(robot.gripper_mass, robot.tool_length)
    for i, mount in enumerate(robot.mounted):
        limb, names = robot.every_limb[i], robot.named_joints[i]
        dynamics = mount.dynamics or arm_dynamics("ur5e")
        body, frames = base, (mount.frame, *limb.steps, np.eye(4))
        for k, (link, solid) in enumerate(zip(LINKS, (*dynamics.solids, gripper), strict=True)):
            body = _body(body, f"limb{i}/{link}" if k else f"limb{i}", frames[k], solid)
            if 1 <= k <= len(names):
                torque = dynamics.torque_limits[k - 1]
                _sub(
                    body, "joint", name=names[k - 1], axis=_text((0.0, 0.0, limb.senses[k - 1])),
                    range=_text(limb.limits[k - 1]), armature=_text(dynamics.rotor_inertias[k - 1]),
                    actuatorfrcrange=_text((-torque, torque)),
                )  # fmt: skip
            shapes = [shape for shape in mount.capsules or () if shape.link == link]
            for n, shape in enumerate(shapes):
                _add_capsule(body, f"limb{i}/{link}/{n}", (shape.start, shape.end), shape.radius)
            if link == LINKS[6]:
                _sub(body, "site", name=f"limb{i}/flange", pos="0 0 0", size="0.005")
        grasp = _text((0.0, 0.0, robot.tool_length))
        _sub(body, "site", name=f"limb{i}/grasp", pos=grasp, size="0.005")
    return root


def _body(parent: Element, name: str, frame: Array, solid: RigidBody) -> Element:
    body = _sub(parent, "body", name=name, **_placed(frame))
    if solid.mass:
        kind, count = ("fullinertia", 6) if any(solid.inertia[3:]) else ("diaginertia", 3)
        figures = {"pos": _text(solid.centre), "mass": _text(solid.mass)}
        _sub(body, "inertial", **figures, **{kind: _text(solid.inertia[:count])})
    return body


def _add_capsule(body: Element, name: str, ends: Sequence[Sequence[float]], radius: float) -> None:
    """Add a capsule to a body, or if its ends are one a ball."""
    start, end = ends
    if start == end:
        _sub(body, "geom", name=name, type="sphere", pos=_text(start), size=_text(radius))
    else:
        # MuJoCo has the shape's z axis point to the end that is named first.
        both = _text((*end, *start))
        _sub(body, "geom", name=name, type="capsule", fromto=both, size=_text(radius))


def _add_link(root: Element, body: Element, speeds: Iterator[float], parent: str = "") -> None:
    """Add a body of MJCF, and all that it carries, to a URDF as links and joints.

    The largest speeds are those of the joints in their order [rad/s].
    """
    name = body.get("name", "")
    link, joint = _sub(root, "link", name=name), body.find("joint")
    for part in body.findall("inertial"):
        inertial = _sub(link, "inertial")
        _sub(inertial, "origin", xyz=part.get("pos", ""), rpy="0 0 0")
        _sub(inertial, "mass", value=part.get("mass", ""))
        figures = part.get("fullinertia") or f"{part.get('diaginertia')} 0.0 0.0 0.0"
        names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        _sub(inertial, "inertia", **dict(zip(names, figures.split(), strict=True)))
    for geom in body.findall("geom"):
        _add_shape(_sub(link, "collision"), geom)
    if parent:
        kind = "fixed" if joint is None else "revolute"
        called = f"{name}/fixed" if joint is None else joint.get("name", "")
        made = _joined(root, called, kind, _origin(_frame_of(body)), (parent, name))
        if joint is not None:
            low, high = joint.get("range", "").split()
            effort, speed = joint.get("actuatorfrcrange", "").split()[1], _text(next(speeds))
            _sub(made, "axis", xyz=joint.get("axis", ""))
            _sub(made, "limit", lower=low, upper=high, effort=effort, velocity=speed)
    for site in body.findall("site"):
        grasp = site.get("name", "")
        if grasp.endswith("/grasp"):
            _sub(root, "link", name=grasp)
            _joined(root, f"{grasp}/fixed", "fixed", _origin(_frame_of(site)), (name, grasp))
    for inner in body.findall("body"):
        _add_link(root, inner, speeds, name)


def _add_shape(collision: Element, geom: Element) -> None:
    size = _numbers(geom, "size")
    if geom.get("type") == "capsule":
        end, start = _numbers(geom, "fromto").reshape(2, 3)
        length = float(np.linalg.norm(end - start))
        x, y, z = (end - start) / length
        # Roll 0, then pitch and yaw bring z onto the axis.
        turns = _text((0.0, np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)))
        _sub(collision, "origin", xyz=_text(0.5 * (start + end)), rpy=turns)
        shape = {"radius": _text(size), "length": _text(length)}
        _sub(_sub(collision, "geometry"), "capsule", **shape)
        return
    _sub(collision, "origin", **_origin(_frame_of(geom)))
    if geom.get("type") == "box":
        _sub(_sub(collision, "geometry"), "box", size=_text(2.0 * size))
    else:
        _sub(_sub(collision, "geometry"), "sphere", radius=_text(size))


def _joined(
    root: Element, name: str, kind: str, origin: dict[str, str], links: tuple[str, str]
) -> Element:
    joint = _sub(root, "joint", name=name, type=kind)
    _sub(joint, "origin", **origin)
    _sub(joint, "parent", link=links[0])
    _sub(joint, "child", link=links[1])
    return joint


def _placed(frame: Array) -> dict[str, str]:
    return {"pos": _text(frame[:3, 3]), "quat": _text(quaternion_of(frame[:3, :3]))}


def _frame_of(element: Element) -> Array:
    """Return the frame that attributes of MJCF tell, shape (4, 4)."""
    w, x, y, z = _numbers(element, "quat", "1 0 0 0").tolist()
    return rigid(np.round(axes_of((w, x, y, z)), 15), _numbers(element, "pos", "0 0 0"))


def _origin(frame: Array) -> dict[str, str]:
    """Return a frame as attributes of URDF: roll, pitch, yaw about the fixed axes x, y, z [rad]."""
    turn = frame[:3, :3]
    across = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = np.arctan2(-turn[2, 0], across)
    if across < 1e-9:
        angles = np.arctan2(-turn[1, 2], turn[1, 1]), pitch, 0.0
    else:
        angles = np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])
    return {"xyz": _text(frame[:3, 3]), "rpy": _text(angles)}


def _with_digest(robot: RobotFields, root: Element) -> str:
    """Return the robot as JSON, of which neither format has all, with a digest of the rest."""
    return json.dumps(robot.to_dict() | {DIGEST: digest_of(root)})


def _sub(parent: Element, tag: str, **attributes: str) -> Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _text(numbers: Any) -> str:
    """Return numbers with all their digits, none as -0."""
    return " ".join(repr(float(number) + 0.0) for number in np.ravel(numbers))


def _numbers(element: Element, name: str, default: str = "") -> Array:
    return np.array(element.get(name, default).split(), dtype=np.float64)


def _written(root: Element) -> str:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"
