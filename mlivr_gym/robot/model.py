"""The robot as a `mujoco.MjSpec`: body, links, joints, inertias and collision shapes.

`simulation.scene` puts it into a map, `export` writes it to a file.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.colours import LIMB_COLOURS
from mlivr_gym.robot.derived import DerivedFigures
from mlivr_gym.robot.limb_dynamics import LimbDynamics, arm_dynamics, arm_of, gripper_link
from mlivr_gym.robot.link_frames import quaternion_of as quaternion_of
from mlivr_gym.robot.link_frames import rigid
from mlivr_gym.robot.rigid import RigidBody
from mlivr_gym.values import Triple, as_triple

ROBOT, SURROUNDINGS = 1, 2
"""Bits of `contype` and `conaffinity`.

The robot's shapes meet each other and the surroundings; boxes never meet.
"""

BODY_COLOUR, GRIPPER_COLOUR = (0.93, 0.93, 0.95, 1), (0.15, 0.15, 0.17, 1)
CARGO_COLOUR = (0.80, 0.62, 0.38, 1)
STEEL_COLOUR, DISC_COLOUR = (0.70, 0.72, 0.75, 1), (0.1, 0.1, 0.12, 1)

SHORTEST = 1e-6
"""Length of an axis that MuJoCo accepts [m]."""

_TOUCHES = {"contype": ROBOT, "conaffinity": ROBOT | SURROUNDINGS}


class RobotJoint(NamedTuple):
    """A joint along the z axis of the link that it moves."""

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
    sign: float
    """1 if its axis leads along the z axis, -1 if against it."""

    @property
    def axis(self) -> Triple:
        """Its axis in the frame of the link."""
        return 0.0, 0.0, self.sign


class RobotLink(NamedTuple):
    """A link of a robot."""

    name: str
    """Its name."""
    parent: str
    """Name of the link that carries it, empty for the body."""
    frame: Array
    """Its frame in that of that link, shape (4, 4)."""
    solid: RigidBody
    """Its mass, centre and inertia."""
    capsules: tuple[Capsule, ...]
    """Its collision shapes."""
    joint: RobotJoint | None
    """The joint that moves it, None if it is fixed."""


def rgba(colour: str) -> tuple[float, float, float, float]:
    """Return the components of a colour like `"#1f77b4"`, opaque."""
    r, g, b = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return (r, g, b, 1.0)


def robot_spec_alone(robot: DerivedFigures) -> Any:
    """Return a robot that floats in empty space without gravity, as a `mujoco.MjSpec`.

    The body is `"base"` with free joint `"base"`; joints have the names of
    `RobotSpec.named_joints`. The flange frame of limb i is site `"limb{i}/flange"`, its grasp point
    site `"limb{i}/grasp"`. Capsules are
    `"limb{i}/{link}/{number}"`. A robot whose masses are not known has those of the UR5e, which a
    picture does not need and a simulation refuses.
    """
    import mujoco

    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False  # MuJoCo would take the ranges of joints for degrees
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.add_material(name="matt", specular=0.1, shininess=0.1)
    made = {"base": _add_base(spec, robot)}
    for i in range(robot.limbs):
        for link in limb_links(robot, i, known_dynamics(robot, i)):
            _add_link(made, link, robot.tool_length, LIMB_COLOURS[i])
    return spec


def limb_links(robot: DerivedFigures, i: int, dynamics: LimbDynamics) -> Iterator[RobotLink]:
    """Yield base, links and gripper of a limb, each after the one that carries it.

    Their names are `limb{i}` and `limb{i}/{link}`; the gripper is fixed to the flange.
    """
    shapes = robot.mounted[i].capsules or ()
    parts = {name: tuple(c for c in shapes if c.link == name) for name in LINKS}
    parent, limb = f"limb{i}", robot.every_limb[i]
    place, turn = robot.mount_positions[i], robot.mount_rotations[i]
    yield RobotLink(parent, "base", rigid(turn, place), dynamics.base_link, parts["base"], None)
    for k, step in enumerate(limb.steps):
        centre = as_triple(np.array(dynamics.centres[k]))
        joint = RobotJoint(
            robot.named_joints[i][k], tuple(limb.limits[k].tolist()), dynamics.torque_limits[k],
            dynamics.speed_limits[k], dynamics.rotor_inertias[k], float(limb.senses[k]),
        )  # fmt: skip
        name = f"limb{i}/{LINKS[k + 1]}"
        yield RobotLink(
            name, parent, step,
            RigidBody(dynamics.masses[k], centre, dynamics.inertias[k]), parts[LINKS[k + 1]], joint,
        )  # fmt: skip
        parent = name
    gripper = gripper_link(robot.gripper_mass, robot.tool_length)
    yield RobotLink(f"limb{i}/gripper", parent, np.eye(4), gripper, parts["gripper"], None)


def known_dynamics(robot: DerivedFigures, limb: int) -> LimbDynamics:
    """Return the dynamics of a limb, those of the UR5e if they are not known."""
    known = robot.mounted[limb].dynamics is not None or arm_of(robot.every_limb[limb]) is not None
    return robot.dynamics_of(limb) if known else arm_dynamics("ur5e")


def _add_base(spec: Any, robot: DerivedFigures) -> Any:
    """Add the robot's body, free to move, with a disc that marks its front."""
    import mujoco

    half = 0.5 * robot.body_edges
    base = spec.worldbody.add_body(name="base", pos=[0, 0, 0])
    base.add_freejoint(name="base")
    base.add_geom(
        name="body", type=mujoco.mjtGeom.mjGEOM_BOX, size=half, rgba=BODY_COLOUR, material="matt",
        mass=robot.body_mass, **_TOUCHES,
    )  # fmt: skip
    base.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, pos=[0, 0, half[2]],
        size=[0.6 * half[:2].min(), 0.004, 0], rgba=DISC_COLOUR, mass=0, contype=0, conaffinity=0,
    )  # fmt: skip
    if robot.cargo is not None:
        base.add_geom(
            name="cargo", type=mujoco.mjtGeom.mjGEOM_BOX, pos=robot.cargo_frame[:3, 3],
            quat=quaternion_of(robot.cargo_frame[:3, :3]), size=0.5 * robot.cargo.edges,
            rgba=CARGO_COLOUR, material="matt", mass=0, **_TOUCHES,
        )  # fmt: skip
        for k, (_, ends, radius) in enumerate(robot.cargo.limb_capsules):
            base.add_geom(
                name=f"cargo/limb/{k}", type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[*ends[0], *ends[1] + [0.0, 0.0, SHORTEST]], size=[radius, 0, 0],
                rgba=STEEL_COLOUR, material="matt", mass=0, **_TOUCHES,
            )  # fmt: skip
    if robot.body_inertia is not None or robot.cargo is not None:
        base.explicitinertial = True
        solid = robot.body_solid
        base.mass, base.ipos, base.fullinertia = solid.mass, solid.centre, list(solid.inertia)
    return base


def _add_link(made: dict[str, Any], link: RobotLink, tool_length: float, limb_colour: str) -> None:
    """Add a link of a limb with its joint and shapes, and the sites of flange and grasp point.

    Links have two shades of the limb's colour.
    """
    import mujoco

    parent, part = made[link.parent], link.name.partition("/")[2] or "base"
    turn = quaternion_of(link.frame[:3, :3])
    body = parent.add_body(name=link.name, pos=link.frame[:3, 3], quat=turn)
    made[link.name] = body
    body.explicitinertial = True
    body.mass, body.ipos = link.solid.mass, link.solid.centre
    if link.joint is None and not any(link.solid.inertia[3:]):
        body.inertia = list(link.solid.inertia[:3])
    else:
        body.fullinertia = list(link.solid.inertia)
    if link.joint is not None:
        body.add_joint(
            name=link.joint.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=link.joint.axis,
            range=link.joint.limits, armature=link.joint.rotor,
        )  # fmt: skip
    colour = rgba(limb_colour)
    if LINKS.index(part) % 2:
        red, green, blue = (0.55 * c + 0.45 for c in colour[:3])
        colour = (red, green, blue, 1.0)
    tint = {"base": STEEL_COLOUR, "gripper": GRIPPER_COLOUR}.get(part, colour)
    for k, capsule in enumerate(link.capsules):
        body.add_geom(
            name=f"{link.name.partition('/')[0]}/{part}/{k}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*capsule.start, *_shifted(capsule)],
            size=[capsule.radius, 0, 0], rgba=tint, material="matt", mass=0, **_TOUCHES,
        )  # fmt: skip
    if part == "gripper":
        unseen = {"size": [0.005, 0, 0], "rgba": (0, 0, 0, 0)}
        parent.add_site(name=link.name.replace("gripper", "flange"), **unseen)
        parent.add_site(
            name=link.name.replace("gripper", "grasp"), pos=[0, 0, tool_length], **unseen
        )


def _shifted(capsule: Capsule) -> Sequence[float]:
    """Return the capsule's end, moved by a micrometre along z if both ends are one.

    MuJoCo needs the direction of the axis.
    """
    end = list(capsule.end)
    if np.linalg.norm(np.subtract(end, capsule.start)) < SHORTEST:
        end[2] += SHORTEST
    return end
