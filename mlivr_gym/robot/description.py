"""URDF and MJCF files as MuJoCo reads them.

`mujoco.MjSpec` parses and compiles both formats. What it cannot take from a file is added here:
meshes are found by their package or left out, inertias that rounding made impossible are repaired,
and the speed limits of a URDF, for which MuJoCo has no field, are read from the text. In MJCF they
are the `<numeric>` named `SPEED_LIMITS`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.file_meshes import BodyMesh, Meshes
from mlivr_gym.robot.file_options import FileOptions
from mlivr_gym.robot.limb import FARTHEST_TURN
from mlivr_gym.robot.rigid import PAIRS

SPEED_LIMITS = "speed_limits"
"""Name of the `<numeric>` of an MJCF file that holds the largest speed of each joint [rad/s]."""

PLANNING = "mlivr_gym"
"""Name of the `<text>` of an MJCF file, and of the element of a URDF file, with the robot that this
package wrote, as JSON."""

DIGEST = "digest"
"""Name of the digest of the rest of the file in it."""

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
    """Inertia of the rotor, reflected through the gear [kg m^2]."""


class Description(NamedTuple):
    """A file as MuJoCo reads it, with all joints at 0."""

    name: str
    """Name of the robot."""
    model: Any
    """The compiled `mujoco.MjModel`."""
    data: Any
    """Its `mujoco.MjData`."""
    joints: dict[int, JointData]
    """Data of each hinge by its number in the model."""
    missing: tuple[tuple[int, str], ...]
    """Bodies, and mesh files of their collision shapes that were not found or cannot be read."""
    visuals: dict[int, tuple[BodyMesh, ...]]
    """Meshes that show each body, by its number in the model."""
    notes: tuple[str, ...]
    """What was repaired, in words."""


def read_description(path: Path, tree: ElementTree.Element, options: FileOptions) -> Description:
    """Read a file as URDF or as MJCF, by its elements, which are changed.

    Packages of `package://` names are looked for in the folders above the file, too. Meshes of
    collision shapes are read only if the caller gives no capsules. Raises a `RobotError` if the
    file cannot be read, or holds a loop or a joint that is no hinge.
    """
    found: dict[str, float] = {}
    meshes = Meshes(path.parent, [*map(Path, options.package_dirs), *path.resolve().parents])
    try:
        if tree.tag == "robot":
            found = _prepare_urdf(tree)
            meshes.name_apart(tree)
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(tree, encoding="unicode"))
        if tree.tag == "robot":
            spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        _check_joints(spec)
        notes = _repaired_inertias(spec)
        meshes.take_out(spec, options.capsules is None)
        spec.compiler.fusestatic = False
        spec.compiler.boundmass = spec.compiler.boundinertia = LEAST_MASS
        model = spec.compile()
    except RobotError:
        raise
    except ValueError as error:
        raise RobotError(f"MuJoCo cannot read it: {' '.join(str(error).split())}") from None
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        address = model.jnt_qposadr[joint]
        data.qpos[address : address + 7] = model.qpos0[address : address + 7]
    mujoco.mj_kinematics(model, data)
    joints = _joint_data(model, found, (options.speed_limits, options.torque_limits))
    if tree.tag == "mujoco":  # a hinge without a range turns without end, as a continuous joint
        endless = (-FARTHEST_TURN, FARTHEST_TURN)
        joints = {k: one._replace(limits=one.limits or endless) for k, one in joints.items()}
    name = tree.get("name") or tree.get("model") or path.stem
    return Description(
        name, model, data, joints, meshes.missing(model), meshes.placed(model), tuple(notes),
    )  # fmt: skip


def written_in(tree: ElementTree.Element) -> tuple[dict[str, Any], bool]:
    """Return the plain data of the robot that a file of this package has, empty if none.

    Also whether the file is as it was written. The data are taken out of its elements.
    """
    text = ""
    for parent in (tree, *tree.findall("custom")):
        for entry in list(parent):
            if entry.tag == PLANNING or (entry.tag == "text" and entry.get("name") == PLANNING):
                text = entry.get("data") or entry.text or ""
                parent.remove(entry)
    if not text:
        return {}, False
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError):
        fields = None
    if not isinstance(fields, dict):
        raise RobotError(f"the text {PLANNING!r} of the file is not a JSON object")
    return fields, fields.pop(DIGEST, None) == digest_of(tree)


def digest_of(tree: ElementTree.Element) -> str:
    """Return a digest of the elements of a file, the white space between them aside."""
    text = ElementTree.tostring(tree, encoding="unicode")
    return sha256(ElementTree.canonicalize(text, strip_text=True).encode()).hexdigest()


def _prepare_urdf(tree: ElementTree.Element) -> dict[str, float]:
    """Make a URDF readable for MuJoCo; return the speed limits by joint [rad/s]."""
    children = [joint.find("child") for joint in tree.iter("joint")]
    names = [child.get("link", "") for child in children if child is not None]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RobotError(
            f"link {twice!r} is the child of {names.count(twice)} joints; the links must form a "
            "tree, without a loop"
        )
    roots = [name for link in tree.findall("link") if (name := link.get("name", "")) not in names]
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
        if limit is not None and limit.get("velocity"):
            speeds[joint.get("name", "")] = _number(limit.get("velocity", ""), joint)
    options = {"strippath": "false", "discardvisual": "false", "fusestatic": "false"}
    for other in tree.findall("mujoco"):
        for compiler in other.findall("compiler"):
            options["balanceinertia"] = compiler.get("balanceinertia", "false")
        tree.remove(other)
    ElementTree.SubElement(ElementTree.SubElement(tree, "mujoco"), "compiler", options)
    return speeds


def _number(text: str, joint: ElementTree.Element) -> float:
    try:
        return float(text)
    except ValueError:
        raise RobotError(
            f"joint {joint.get('name')!r} has the speed limit {text!r}; it must be a number"
        ) from None


def _check_joints(spec: Any) -> None:
    """Refuse floating links, loops, and masses below 0."""
    for body in spec.bodies:
        if body.mass < 0.0:
            raise RobotError(
                f"link {body.name!r} has a mass of {body.mass:g} kg; give it an <inertial> with "
                "the mass [kg] and the inertia [kg m^2]"
            )
    for joint in spec.joints:
        carrier = joint.parent.parent
        if joint.type == mujoco.mjtJoint.mjJNT_FREE and carrier.name != "world":
            raise RobotError(
                f"joint {joint.name!r} is floating; only the whole robot may float, all other "
                "joints must be revolute or fixed"
            )
    for k, equality in enumerate(spec.equalities):
        name = equality.name or f"number {k}"
        if equality.type in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            raise RobotError(
                f"the equality {name!r} joins {equality.name1!r} and {equality.name2!r}, which "
                "closes a loop; the links must form a tree"
            )


def _repaired_inertias(spec: Any) -> list[str]:
    """Make the largest moment of inertia of each link at most the sum of the others; return notes.

    No body has a larger one, but figures are often rounded so. It is changed by a share of
    `MOST_REPAIR` at most; what is further off is left to `balanceinertia`, if the file asks for it.
    """
    names, most = [], 0.0
    for body in spec.bodies:
        matrix = _inertia_of(body)
        moments, axes = np.linalg.eigh(matrix)
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
            names.append(body.name)
            most = max(most, share)
    if not names:
        return []
    return [
        f"inertia of {', '.join(names)} repaired: the largest principal moment exceeded the sum of "
        f"the others by {100.0 * most:.2g} % at most"
    ]


def _inertia_of(body: Any) -> Array:
    """Return the inertia of a body of a `mujoco.MjSpec` as a matrix, shape (3, 3)."""
    if np.isnan(body.fullinertia[0]):
        return np.asarray(np.diag(body.inertia))
    matrix = np.zeros((3, 3))
    for (row, column), value in zip(PAIRS, body.fullinertia, strict=True):
        matrix[row, column] = matrix[column, row] = value
    return matrix


def _joint_data(
    model: Any,
    found: dict[str, float],
    limits: tuple[float | Sequence[float] | None, float | Sequence[float] | None],
) -> dict[int, JointData]:
    """Return the data of the hinges.

    `found` are the speed limits of a URDF by joint, `limits` the speeds and torques that a caller
    gives in their place.
    """
    hinges = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE).tolist()
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, SPEED_LIMITS)
    speeds, torques = limits
    if speeds is None and number >= 0:
        start = int(model.numeric_adr[number])
        speeds = model.numeric_data[start : start + int(model.numeric_size[number])].tolist()
    given = _each(SPEED_LIMITS, speeds, len(hinges))
    strong = _each("torque_limits", torques, len(hinges))
    out = {}
    for k, joint in enumerate(hinges):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or f"joint {joint}"
        low, high = model.jnt_range[joint].tolist()
        limited = bool(model.jnt_limited[joint]) and high > low
        if high < low:
            raise RobotError(
                f"joint {name!r} has the limits {low:g} and {high:g} rad; the lower one comes first"
            )
        address = int(model.jnt_dofadr[joint])
        out[joint] = JointData(
            name,
            (low, high) if limited else None,
            _torque(model, joint) if strong is None else strong[k],
            (found.get(name) if given is None else given[k]) or None,
            float(model.dof_armature[address]) or None,
        )
    return out


def _each(name: str, limits: float | Sequence[float] | None, count: int) -> list[float] | None:
    """Return limits that were given joint by joint, None if none were."""
    if limits is None:
        return None
    listed = [float(limit) for limit in np.ravel(np.asarray(limits, dtype=np.float64))]
    if len(listed) == 1:
        return listed * count
    if len(listed) != count:
        raise RobotError(
            f"{name} has {len(listed)} entries; it must have 1, or {count}, one for each "
            "joint of the file"
        )
    return listed


def _torque(model: Any, joint: int) -> float | None:
    """Return the largest torque of a joint [N m], of the joint or of its actuator."""
    if model.jnt_actfrclimited[joint]:
        return float(np.abs(model.jnt_actfrcrange[joint]).min()) or None
    for k in range(model.nu):
        if model.actuator_trntype[k] != mujoco.mjtTrn.mjTRN_JOINT:
            continue
        if model.actuator_trnid[k, 0] != joint:
            continue
        gear = abs(float(model.actuator_gear[k, 0]))
        if model.actuator_forcelimited[k]:
            return float(np.abs(model.actuator_forcerange[k]).min()) * gear or None
        is_motor = model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_NONE
        if is_motor and model.actuator_ctrllimited[k]:
            gain = abs(float(model.actuator_gainprm[k, 0]))
            return float(np.abs(model.actuator_ctrlrange[k]).min()) * gear * gain or None
    return None
