"""URDF and MJCF files as MuJoCo reads them.

`mujoco.MjSpec` parses and compiles both formats. What it cannot take from a URDF is added here:
meshes are found by their package or left out, and the speed limits, for which MuJoCo has no field,
are read from the text. In MJCF they are the `<numeric>` named `SPEED_LIMITS`.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from mlivr_gym.errors import RobotError
from mlivr_gym.files import LARGEST_FILE
from mlivr_gym.robot.limb import FARTHEST_TURN
from mlivr_gym.robot.visuals import BodyMesh, mesh_file, mjcf_meshes, placed_meshes, urdf_meshes

SPEED_LIMITS = "speed_limits"
"""Name of the `<numeric>` of an MJCF file that holds the largest speed of each joint [rad/s]."""

PLANNING = "mlivr_gym"
"""Name of the `<text>` of an MJCF file, and of the element of a URDF file, with `RobotSpec` fields
that neither format has, as JSON."""

WINDOWS, ROTORS = "window_starts", "rotor_inertias"
"""Entries of `PLANNING` that are no fields of a robot: figures of each limb, N of six."""

LEAST_MASS = 1e-12
"""Mass [kg] and inertia [kg m^2] that MuJoCo is given for frames that have none."""


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
    missing: tuple[str, ...]
    """Mesh files of collision shapes that were not found or cannot be read."""
    fields: dict[str, Any]
    """Fields of `RobotSpec` that the file names, see `PLANNING`."""
    visuals: dict[str, tuple[BodyMesh, ...]]
    """Meshes that show each body, by its name."""

    @property
    def is_exported(self) -> bool:
        """Whether this package wrote the file, and so says all that there is of a robot."""
        return WINDOWS in self.fields


def read_description(
    path: str | Path,
    package_dirs: Sequence[str | Path] = (),
    speeds: float | Sequence[float] | None = None,
    torques: float | Sequence[float] | None = None,
) -> Description:
    """Read a file as URDF, if it ends in `.urdf`, or as MJCF.

    Packages of `package://` names are looked for in `package_dirs` and in the folders above the
    file. Largest speeds [rad/s] and torques [N m] that are given, one for all joints or one for
    each in the order of the file, replace those of the file. Raises a `RobotError` if the file
    cannot be read, or holds a loop or a joint that is no hinge.
    """
    path = Path(path)
    try:
        size = os.path.getsize(path)
        text = path.read_text(encoding="utf-8") if size <= LARGEST_FILE else ""
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise RobotError(f"the file cannot be read: {reason}") from None
    if not text:
        raise RobotError(f"the file is empty or larger than {LARGEST_FILE} bytes")
    tree = _parsed(text)
    found: dict[str, float] = {}
    missing: list[str] = []
    visuals: dict[str, tuple[BodyMesh, ...]] = {}
    pictures: list[tuple[str, str, BodyMesh]] = []
    try:
        _check_numbers(tree, path.stem)
        if tree.tag == "robot":
            folders = [*map(Path, package_dirs), *path.resolve().parents]
            visuals = urdf_meshes(tree, path.parent, folders)
            found, missing, fields = _prepare_urdf(tree, path.parent, folders)
            spec = mujoco.MjSpec.from_string(ElementTree.tostring(tree, encoding="unicode"))
            spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        else:
            spec = mujoco.MjSpec.from_file(str(path))
            missing, pictures = _without_pictures(spec)
            fields = next((entry.data for entry in spec.texts if entry.name == PLANNING), "")
        _check_joints(spec)
        if tree.tag == "robot":
            _check_masses(spec)
        spec.compiler.fusestatic = False
        spec.compiler.boundmass = spec.compiler.boundinertia = LEAST_MASS
        model = spec.compile()
    except RobotError:
        raise
    except RecursionError:
        raise RobotError("the file is nested too deeply") from None
    except ValueError as error:
        raise RobotError(f"MuJoCo cannot read it: {' '.join(str(error).split())}") from None
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        address = model.jnt_qposadr[joint]
        data.qpos[address : address + 7] = model.qpos0[address : address + 7]
    mujoco.mj_kinematics(model, data)
    joints = _joint_data(model, found, (speeds, torques))
    if tree.tag == "mujoco":  # a hinge without a range turns without end, as a continuous joint
        endless = (-FARTHEST_TURN, FARTHEST_TURN)
        joints = {k: one._replace(limits=one.limits or endless) for k, one in joints.items()}
    name = tree.get("name") or tree.get("model") or path.stem
    visuals |= placed_meshes(model, pictures)
    return Description(name, model, data, joints, tuple(missing), _fields(fields), visuals)


def _parsed(text: str) -> ElementTree.Element:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise RobotError("the file defines entities, which are not read")
    # Extensions of simulators often use a prefix that the file does not declare.
    text = re.sub(r"(</?|\s)([A-Za-z_][\w.-]*):(?=[\w.-]+[\s=/>])", r"\1\2.", text)
    try:
        tree = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise RobotError(f"the file is not XML: {error}") from None
    if any(part.tag.startswith("xacro.") for part in tree.iter()):
        raise RobotError("the file has elements of xacro; expand it first: xacro FILE > robot.urdf")
    if tree.tag not in ("robot", "mujoco"):
        raise RobotError(
            f"the file's outermost element is <{tree.tag}>; it must be <robot> (URDF) or "
            "<mujoco> (MJCF)"
        )
    return tree


def _check_numbers(element: ElementTree.Element, owner: str) -> None:
    """Refuse attributes that are not a number, of which MuJoCo only warns, in a file it writes."""
    owner = element.get("name", owner)
    for attribute, text in element.items():
        if attribute != "name" and "nan" in text.lower().replace("-", "").split():
            raise RobotError(
                f"{element.tag} of {owner!r} has {attribute} {text!r}; numbers must be finite"
            )
    for part in element:
        _check_numbers(part, owner)


def _fields(text: str) -> dict[str, Any]:
    """Return the fields of a robot that a file of this package names."""
    if not text:
        return {}
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError):
        fields = None
    if not isinstance(fields, dict):
        raise RobotError(f"the text {PLANNING!r} of the file is not a JSON object")
    return fields


def _prepare_urdf(
    tree: ElementTree.Element, folder: Path, folders: Sequence[Path]
) -> tuple[dict[str, float], list[str], str]:
    """Make a URDF readable for MuJoCo; return speed limits, missing meshes and own fields."""
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
    missing = []
    for link in tree.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        for shape in link.findall("collision"):
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            file = mesh_file(mesh.get("filename", ""), folder, folders)
            if file is None:
                missing.append(mesh.get("filename", ""))
                link.remove(shape)
            else:
                mesh.set("filename", str(file))
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
    for other in tree.findall("mujoco"):
        tree.remove(other)
    extra = tree.find(PLANNING)
    extension = ElementTree.SubElement(tree, "mujoco")
    options = {"strippath": "false", "discardvisual": "false", "fusestatic": "false"}
    ElementTree.SubElement(extension, "compiler", options)
    return speeds, missing, "" if extra is None else extra.text or ""


def _number(text: str, joint: ElementTree.Element) -> float:
    try:
        return float(text)
    except ValueError:
        raise RobotError(
            f"joint {joint.get('name')!r} has the speed limit {text!r}; it must be a number"
        ) from None


def _without_pictures(spec: Any) -> tuple[list[str], list[tuple[str, str, BodyMesh]]]:
    """Remove what is only seen, and meshes that are not there; return the latter and the former."""
    folder = Path(spec.modelfiledir) / (spec.compiler.meshdir or spec.meshdir or "")
    absent = {
        mesh.name or Path(mesh.file).stem: mesh.file
        for mesh in spec.meshes
        if mesh.file and not (folder / mesh.file).is_file()
    }
    from_geoms = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE

    def is_massive(geom: Any) -> bool:
        return bool(from_geoms or not geom.parent.explicitinertial)

    missing, seen = [], []
    for geom in list(spec.geoms):
        material, geom.material = geom.material, ""
        file = absent.get(geom.meshname)
        if is_massive(geom) and file:
            raise RobotError(
                f"mesh {file!r} is not found; the mass of link {geom.parent.name!r} follows from "
                "its shape, give the link an inertial or the file the mesh"
            )
        if not (geom.contype or geom.conaffinity) and not is_massive(geom):
            if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
                seen.append((geom, geom.meshname, material))
            else:
                spec.delete(geom)
        elif file:
            missing.append(file)
            spec.delete(geom)
    pictures = mjcf_meshes(spec, seen)
    used = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if (mesh.name or Path(mesh.file).stem) not in used:
            spec.delete(mesh)
    for part in (*spec.skins, *spec.materials, *spec.textures, *spec.hfields):
        spec.delete(part)
    return missing, pictures


def _check_joints(spec: Any) -> None:
    """Refuse floating links and loops."""
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


def _check_masses(spec: Any) -> None:
    """Refuse a link of a URDF that moves and has no mass."""
    masses: dict[str, float] = {}
    for body in spec.bodies:
        rigid = body
        while rigid.parent is not None and not len(rigid.joints) and rigid.parent.name != "world":
            rigid = rigid.parent
        masses[rigid.name] = masses.get(rigid.name, 0.0) + float(body.mass)
    for body in spec.bodies:
        mass = masses.get(body.name, 0.0)
        if len(body.joints) and mass <= 0.0:
            has = f"a mass of {mass:g} kg" if mass else "no mass"
            raise RobotError(
                f"link {body.name!r} has {has}; give it an <inertial> with the mass [kg] and the "
                "inertia [kg m^2]"
            )


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
            found.get(name) if given is None else given[k],
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
