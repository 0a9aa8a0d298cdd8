"""URDF and MJCF files as MuJoCo reads them.

`mujoco.MjSpec` parses and compiles both formats. What it cannot take from a file is added here:
meshes are found by their package or left out, inertias that rounding made impossible are repaired,
and the speed limits of a URDF, for which MuJoCo has no field, are read from the text. In MJCF they
are the `<numeric>` named `SPEED_LIMITS`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.file_meshes import FileMesh, name_apart, taken_out
from mlivr_gym.robot.file_options import FileOptions
from mlivr_gym.robot.rigid import PAIRS, axes_of, inertia_matrix, rigid
from mlivr_gym.robot.validators import FARTHEST_TURN

SPEED_LIMITS = "speed_limits"
"""Name of the `<numeric>` of an MJCF file that holds the largest speed of each joint [rad/s]."""

LEAST_MASS = 1e-12
"""Mass [kg] and inertia [kg m^2] that MuJoCo is given for frames that have none."""

MOST_REPAIR = 0.01
"""Largest share by which a principal moment of inertia is made smaller."""


class JointData(NamedTuple):
    """What a file says of one joint; None where it says nothing."""

    name: str
    limits: tuple[float, float] | None
    """Lowest and highest angle [rad]."""
    torque: float | None
    """Largest torque [N m]."""
    speed: float | None
    """Largest speed [rad/s]."""
    rotor: float | None
    """Reflected inertia of its rotor [kg m^2]."""


class Tool(NamedTuple):
    """A link, or a site on one, at which an arm may grasp."""

    body: int
    """Body that carries it, by its number in the model."""
    frame: Array
    """The frame in that body, shape (4, 4)."""
    name: str
    """Name of the link or site."""


class Description:
    """A URDF or MJCF file as MuJoCo reads it: a tree of bodies, with all joints at 0."""

    def __init__(self, path: Path, tree: ElementTree.Element, options: FileOptions) -> None:
        """Read a file by its elements, which are changed.

        Packages of `package://` names are looked for in the folders above the file, too. Meshes of
        collision shapes are read only if the caller gives no capsules. Raises a `RobotError` if the
        file cannot be read, or holds a loop or a joint that is no hinge.
        """
        self.name = tree.get("name") or tree.get("model") or path.stem
        try:
            speeds, names = (_prepared(tree), name_apart(tree)) if tree.tag == "robot" else ({}, {})
            spec = mujoco.MjSpec.from_string(ElementTree.tostring(tree, encoding="unicode"))
            if tree.tag == "robot":
                spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
            _check_joints(spec)
            self.notes = _repaired_inertias(spec)
            folders = [path.parent, *map(Path, options.package_dirs), *path.resolve().parents]
            self.meshes = taken_out(spec, names, folders, options.capsules is None)
            spec.compiler.fusestatic = False
            spec.compiler.boundmass = spec.compiler.boundinertia = LEAST_MASS
            self.model = model = spec.compile()
        except RobotError:
            raise
        except ValueError as error:
            raise RobotError(f"MuJoCo cannot read it: {' '.join(str(error).split())}") from None
        self.data = data = mujoco.MjData(model)
        hinges = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
        data.qpos[:] = model.qpos0
        data.qpos[model.jnt_qposadr[model.jnt_type != mujoco.mjtJoint.mjJNT_FREE]] = 0.0
        mujoco.mj_kinematics(model, data)
        # In MJCF a hinge without a range turns without end, as a continuous joint.
        unlimited = (-FARTHEST_TURN, FARTHEST_TURN) if tree.tag == "mujoco" else None
        every = _joint_data(model, hinges.tolist(), speeds, options)
        self.joints = {k: one._replace(limits=one.limits or unlimited) for k, one in every.items()}
        joint = np.where(model.body_jntnum, model.body_jntadr, -1)
        is_free = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE if model.njnt else False
        self.moving: list[int] = np.flatnonzero((joint >= 0) & ~np.asarray(is_free)).tolist()
        """Bodies that joints other than a free one move."""
        self.moved = self.nearest(self.moving)
        """For each body the one of these to which it is fixed, 0 for those of the robot's body."""
        self.tools: dict[str, Tool] = {}
        """Links and sites by their names; a site comes before a link of the same name."""
        for site in map(model.site, range(model.nsite)):
            place = rigid(axes_of(site.quat), site.pos)
            if site.name:  # one without a name cannot be asked for
                self.tools[site.name] = Tool(int(site.bodyid[0]), place, site.name)
        for body in range(1, model.nbody):
            name = self.name_of(body)
            self.tools.setdefault(name, Tool(body, np.eye(4), name))

    def nearest(self, links: Collection[int]) -> IntArray:
        """Return for each body which of some is the nearest that carries it, or is it; else 0."""
        found = np.zeros(self.model.nbody, dtype=np.int64)
        for body in range(1, len(found)):
            found[body] = body if body in links else found[self.parent(body)]
        return found

    def parent(self, body: int) -> int:
        """Return the body that carries a body."""
        return int(self.model.body_parentid[body])

    def body_of(self, joint: int) -> int:
        """Return the body that a joint moves."""
        return int(self.model.jnt_bodyid[joint])

    def carriers(self, body: int) -> list[int]:
        """Return a body, the one that carries it, and so on up to the root, without the world."""
        return [body, *self.carriers(self.parent(body))] if body else []

    def path(self, body: int) -> list[int]:
        """Return the moving bodies from the robot's body to a body, this one included."""
        return [one for one in self.carriers(body)[::-1] if one in self.moving]

    def after(self, body: int) -> list[int]:
        """Return the bodies that joints on a moving body move, or on the robot's body, 0."""
        return [one for one in self.moving if self.moved[self.parent(one)] == body]

    def depth(self, body: int) -> int:
        """Return the number of joints of the longest chain from a moving body on."""
        return 1 + max(map(self.depth, self.after(body)), default=0)

    def is_hinge(self, body: int) -> bool:
        """Return whether one revolute joint moves a body."""
        return self.model.body_jntnum[body] == 1 and self.model.body_jntadr[body] in self.joints

    def solid_geoms(self, body: int) -> list[int]:
        """Return the collision shapes of a body."""
        solid = (self.model.geom_contype != 0) | (self.model.geom_conaffinity != 0)
        shapes: list[int] = np.flatnonzero(solid & (self.model.geom_bodyid == body)).tolist()
        return shapes

    def name_of(self, body: int) -> str:
        """Return the name of a body."""
        return str(self.model.body(body).name) or f"body {body}"

    def frame(self, body: int) -> Array:
        """Return the frame of a body in the world, shape (4, 4)."""
        return rigid(self.data.xmat[body].reshape(3, 3), self.data.xpos[body])

    def lines(self, joints: Sequence[int]) -> tuple[Array, Array]:
        """Return axes of joints and a point on each in the world, both of shape (n, 3)."""
        return self.data.xaxis[list(joints)], self.data.xanchor[list(joints)]

    def meshes_of(self, body: int) -> list[FileMesh]:
        """Return the meshes that show a body.

        Where none of those that are only seen can be read, those of its collision shapes stand for
        them.
        """
        every = [one for one in self.meshes if self.model.geom_bodyid[one.geom.id] == body]
        seen = [one for one in every if not one.is_solid]
        solid = [one for one in every if one.is_solid and one.is_read]
        return seen if any(one.is_read for one in seen) else solid or seen


def each(name: str, given: Any, count: int, things: str) -> Sequence[Any]:
    """Return what is given for each of some things of the file, once for all or in a list."""
    listed = given if isinstance(given, tuple) else (given,)
    if len(listed) not in (1, count):
        raise RobotError(f"{name} has {len(listed)} entries; the file has {count} {things}")
    return listed * (count if len(listed) == 1 else 1)


def _prepared(tree: ElementTree.Element) -> dict[str, float]:
    """Make a URDF readable for MuJoCo; return the speed limits by joint [rad/s]."""
    children = [child.get("link", "") for child in tree.findall("joint/child")]
    for name in children:
        if children.count(name) > 1:
            raise RobotError(
                f"link {name!r} is the child of {children.count(name)} joints; the links must form "
                "a tree, without a loop"
            )
    names = [link.get("name", "") for link in tree.findall("link")]
    roots = [name for name in names if name not in children]
    if len(roots) > 1:
        raise RobotError(
            f"links {roots[0]!r} and {roots[1]!r} hang on no joint; the links must form one tree: "
            "join them by a fixed joint, or leave one out"
        )
    speeds = {}
    for joint in tree.findall("joint"):
        limit = joint.find("limit")
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = limit if limit is not None else ElementTree.SubElement(joint, "limit")
            limit.set("lower", f"{-FARTHEST_TURN}")
            limit.set("upper", f"{FARTHEST_TURN}")
        speed = "" if limit is None else limit.get("velocity", "")
        try:
            speeds[joint.get("name", "")] = float(speed or 0.0)
        except ValueError:
            raise RobotError(
                f"joint {joint.get('name')!r} has the speed limit {speed!r}; it must be a number"
            ) from None
    options = {"strippath": "false", "discardvisual": "false", "fusestatic": "false"}
    for other in tree.findall("mujoco"):
        for compiler in other.findall("compiler"):
            options["balanceinertia"] = compiler.get("balanceinertia", "false")
        tree.remove(other)
    ElementTree.SubElement(ElementTree.SubElement(tree, "mujoco"), "compiler", options)
    return speeds


def _check_joints(spec: Any) -> None:
    """Refuse floating links, loops, and masses below 0."""
    for body in spec.bodies:
        if body.mass < 0.0:
            raise RobotError(
                f"link {body.name!r} has a mass of {body.mass:g} kg; give it an <inertial> with "
                "the mass [kg] and the inertia [kg m^2]"
            )
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE and joint.parent.parent.name != "world":
            raise RobotError(
                f"joint {joint.name!r} is floating; only the whole robot may float, all other "
                "joints must be revolute or fixed"
            )
    for k, equality in enumerate(spec.equalities):
        if equality.type in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            raise RobotError(
                f"the equality {equality.name or f'number {k}'!r} joins {equality.name1!r} and "
                f"{equality.name2!r}, which closes a loop; the links must form a tree"
            )


def _repaired_inertias(spec: Any) -> list[str]:
    """Make the largest moment of inertia of each link at most the sum of the others; return notes.

    No body has a larger one, but figures are often rounded so. It is changed by a share of
    `MOST_REPAIR` at most; what is further off is left to `balanceinertia`, if the file asks for it.
    """
    shares = {}
    for body in spec.bodies:
        is_full = not np.isnan(body.fullinertia[0])
        moments, axes = np.linalg.eigh(
            inertia_matrix(body.fullinertia) if is_full else np.diag(body.inertia)
        )
        least, largest = float(moments[0] + moments[1]), float(moments[2])
        if largest <= least or not body.mass:
            continue
        share = largest / least - 1.0 if least > 0.0 else np.inf
        if share > MOST_REPAIR and not spec.compiler.balanceinertia:
            told = ", ".join(f"{moment:g}" for moment in moments)
            raise RobotError(
                f"link {body.name!r} has the principal moments {told} kg m^2; the largest is more "
                f"than {100.0 * MOST_REPAIR:g} % above the sum of the others, correct them"
            )
        if share <= MOST_REPAIR:
            moments[2] = least * (1.0 - 1e-12)
            whole = axes @ np.diag(moments) @ axes.T
            body.fullinertia = [float(whole[pair]) for pair in PAIRS]
        if share > 1e-9:
            shares[body.name] = share
    return [
        f"inertia of {', '.join(shares)} repaired: the largest principal moment exceeded the sum "
        f"of the others by {100.0 * max(shares.values()):.2g} % at most"
    ] if shares else []  # fmt: skip


def _joint_data(
    model: Any, hinges: list[int], speeds: dict[str, float], options: FileOptions
) -> dict[int, JointData]:
    given, out = options.speed_limits, {}
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, SPEED_LIMITS)
    if given is None and number >= 0:
        start = int(model.numeric_adr[number])
        given = tuple(model.numeric_data[start : start + model.numeric_size[number]].tolist())
    fast = each(SPEED_LIMITS, given, len(hinges), "joints")
    strong = each("torque_limits", options.torque_limits, len(hinges), "joints")
    for joint, speed, torque in zip(hinges, fast, strong, strict=True):
        name = model.joint(joint).name or f"joint {joint}"
        low, high = model.jnt_range[joint].tolist()
        if high < low:
            raise RobotError(
                f"joint {name!r} has the limits {low:g} and {high:g} rad; the lower one comes first"
            )
        out[joint] = JointData(
            name,
            (low, high) if model.jnt_limited[joint] and high > low else None,
            torque or _torque(model, joint) or None,
            speed or speeds.get(name) or None,
            float(model.dof_armature[model.jnt_dofadr[joint]]) or None,
        )
    return out


def _torque(model: Any, joint: int) -> float:
    """Return the largest torque of a joint [N m], its own or that of its actuator; 0 if none."""
    if model.jnt_actfrclimited[joint]:
        return float(np.abs(model.jnt_actfrcrange[joint]).min())
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    for k in np.flatnonzero(on_joint & (model.actuator_trnid[:, 0] == joint)):
        gear = abs(float(model.actuator_gear[k, 0]))
        if model.actuator_forcelimited[k]:
            return float(np.abs(model.actuator_forcerange[k]).min()) * gear
        is_motor = model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_NONE
        if is_motor and model.actuator_ctrllimited[k]:
            gain = abs(float(model.actuator_gainprm[k, 0]))
            return float(np.abs(model.actuator_ctrlrange[k]).min()) * gear * gain
    return 0.0
