"""The robot as a `mujoco.MjSpec`: body, links, joints, inertias and collision shapes.

`simulation.scene` puts it into a map, `export` writes it to a file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.colours import LIMB_COLOURS
from mlivr_gym.robot.derived import DerivedFigures
from mlivr_gym.robot.limb_dynamics import LimbDynamics, arm_dynamics, arm_of, gripper_link
from mlivr_gym.robot.rigid import RigidBody

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


def rgba(colour: str) -> tuple[float, float, float, float]:
    """Return the components of a colour like `"#1f77b4"`, opaque."""
    r, g, b = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return (r, g, b, 1.0)


def robot_spec_alone(robot: DerivedFigures) -> Any:
    """Return a robot that floats in empty space without gravity, as a `mujoco.MjSpec`.

    The body is `"base"` with free joint `"base"`; joint k of limb i is `"limb{i}/joint{k}"`, its
    flange frame is site `"limb{i}/flange"`, its grasp point site `"limb{i}/grasp"`. Capsules are
    `"limb{i}/{link}/{number}"`. A robot whose masses are not known has those of the UR5e, which a
    picture does not need and a simulation refuses.
    """
    import mujoco

    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False  # MuJoCo would take the ranges of joints for degrees
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.add_material(name="matt", specular=0.1, shininess=0.1)
    base = _add_base(spec, robot)
    for i in range(robot.limbs):
        links = _add_limb(base, robot, i)
        links["gripper"] = _add_gripper(links["wrist_3"], robot, i)
        _add_capsules(links, robot, i)
    return spec


def quaternion_of(rotation: Array) -> Array:
    """Return the quaternion w, x, y, z of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    quaternion: Array = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    return quaternion


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


def _add_limb(base: Any, robot: DerivedFigures, i: int) -> dict[str, Any]:
    """Add the links of a limb with joints and inertias; return them by name."""
    import mujoco

    limb, dynamics = robot.every_limb[i], known_dynamics(robot, i)
    mount = quaternion_of(robot.mount_rotations[i])
    parent = base.add_body(name=f"limb{i}", pos=robot.mount_positions[i], quat=mount)
    _set_inertia(parent, dynamics.base_link)
    links = {"base": parent}
    for k, ((offset, quaternion), link) in enumerate(
        zip(limb.link_offsets, LINKS[1:-1], strict=True)
    ):
        parent = parent.add_body(name=f"limb{i}/{link}", pos=offset, quat=quaternion)
        links[link] = parent
        parent.add_joint(
            name=f"limb{i}/joint{k + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1],
            range=limb.limits[k].tolist(), armature=dynamics.rotor_inertias[k],
        )  # fmt: skip
        parent.explicitinertial = True
        parent.mass, parent.ipos = dynamics.masses[k], dynamics.centres[k]
        parent.fullinertia = list(dynamics.inertias[k])
    return links


def _set_inertia(body: Any, link: RigidBody) -> None:
    """Give a body a mass, a centre and an inertia."""
    body.explicitinertial = True
    body.mass, body.ipos = link.mass, link.centre
    if any(link.inertia[3:]):
        body.fullinertia = list(link.inertia)
    else:
        body.inertia = list(link.inertia[:3])


def _add_gripper(flange: Any, robot: DerivedFigures, i: int) -> Any:
    """Add the gripper of a limb, and the sites of flange and grasp point."""
    unseen = {"size": [0.005, 0, 0], "rgba": (0, 0, 0, 0)}
    flange.add_site(name=f"limb{i}/flange", **unseen)
    flange.add_site(name=f"limb{i}/grasp", pos=[0, 0, robot.tool_length], **unseen)
    gripper = flange.add_body(name=f"limb{i}/gripper")
    _set_inertia(gripper, gripper_link(robot.gripper_mass, robot.tool_length))
    return gripper


def _add_capsules(links: dict[str, Any], robot: DerivedFigures, i: int) -> None:
    """Add the collision shapes of a limb, links in two shades of its colour."""
    import mujoco

    colour = rgba(LIMB_COLOURS[i])
    pale = (*(0.55 * c + 0.45 for c in colour[:3]), 1.0)
    count: Counter[str] = Counter()
    for capsule in robot.mounted[i].capsules or ():
        number = LINKS.index(capsule.link)
        tint = {0: STEEL_COLOUR, LINKS.index("gripper"): GRIPPER_COLOUR}.get(
            number, colour if number % 2 == 0 else pale
        )
        links[capsule.link].add_geom(
            name=f"limb{i}/{capsule.link}/{count[capsule.link]}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*capsule.start, *_shifted(capsule)],
            size=[capsule.radius, 0, 0], rgba=tint, material="matt", mass=0, **_TOUCHES,
        )  # fmt: skip
        count[capsule.link] += 1


def _shifted(capsule: Capsule) -> Sequence[float]:
    """Return the capsule's end, moved by a micrometre along z if both ends are one.

    MuJoCo needs the direction of the axis.
    """
    end = list(capsule.end)
    if np.linalg.norm(np.subtract(end, capsule.start)) < SHORTEST:
        end[2] += SHORTEST
    return end
