"""What pictures show of limbs beside or in place of the collision shapes: meshes and rods.

A robot read from a URDF or MJCF file has the meshes of the file, see `robot.visuals`. Meshes ship
for the UR3e and UR5e. Other arms are drawn by their capsules, with rods for joints. Neither takes
part in physics or in checks of collisions.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.file_text import MESH_FORMATS
from mlivr_gym.robot.limb_dynamics import arm_of
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.robot.visuals import LIMB_COLOURS, Visual, rgba

STEP = 1e-4
"""Length of which the coordinates in the files are multiples [m]."""

COLOURS = {
    "Black": (0.11, 0.11, 0.12, 1.0),
    "JointGrey": (0.46, 0.48, 0.51, 1.0),
    "LinkGrey": (0.84, 0.85, 0.87, 1.0),
}
"""Colours of materials; the lids of the joints, `URBlue`, have the colour of the limb."""

UNCHECKED = {"material": "matt", "mass": 0, "contype": 0, "conaffinity": 0}
"""Properties of a shape that takes no part in physics or in checks of collisions."""

JOINT_RADIUS, JOINT_COLOUR = 0.03, (0.44, 0.46, 0.49, 1.0)
"""Radius [m] and colour of the rods that represent joints between the shapes of the links."""

AXIS_SAMPLES = 41
"""Number of positions on the axis of a capsule among which the closest is taken."""


class LimbMesh(NamedTuple):
    """A mesh of one colour, fixed to a link of a limb."""

    link: str
    """One of `capsules.LINKS`."""
    colour: tuple[float, float, float, float] | None
    """Its colour, None for that of the limb."""
    shape: dict[str, Any]
    """Arguments of `add_mesh`: vertices and triangles, or a file and its scale."""
    place: dict[str, Any]
    """Position and quaternion in the frame of the link, none if they are those of the link."""


@cache
def _arm_meshes(name: str) -> tuple[LimbMesh, ...]:
    """Return the meshes of an arm, none if none ship for it."""
    path = asset_path(f"meshes-{name}.npz")
    if not path.is_file():
        return ()
    meshes = []
    with np.load(path) as file:
        for part in sorted({key.rpartition("/")[0] for key in file}):
            link, material = part.split("/")
            shape = {
                "uservert": (STEP * file[f"{part}/vertices"]).ravel(),
                "userface": file[f"{part}/faces"].astype(np.int32).ravel(),
            }
            meshes.append(LimbMesh(link, COLOURS.get(material), shape, {}))
    return tuple(meshes)


@cache
def _meshes_of_files(visuals: tuple[Visual, ...]) -> tuple[LimbMesh, ...]:
    """Return the meshes of files; one warning names those that are missing or of another format."""
    missing = [
        visual
        for visual in visuals
        if Path(visual.file).suffix.lower() not in MESH_FORMATS or not Path(visual.file).is_file()
    ]
    if missing:
        warnings.warn(
            f"{len(missing)} of {len(visuals)} visual meshes are not found or not STL or OBJ, the "
            f"first is {missing[0].file!r} of link {missing[0].link!r}; links without a mesh are "
            "drawn by their capsules (folders of package:// names are given with package_dirs)",
            stacklevel=2,
        )
    return tuple(
        LimbMesh(
            visual.link,
            visual.colour,
            {"file": visual.file, "scale": visual.scale},
            {"pos": visual.position, "quat": visual.quaternion},
        )
        for visual in visuals
        if visual not in missing
    )


def limb_meshes(robot: RobotSpec, limb: int) -> tuple[LimbMesh, ...]:
    """Return the meshes of a limb of a robot, none if it is drawn by its capsules."""
    visuals = robot.mounted[limb].visuals
    if visuals:
        return _meshes_of_files(visuals)
    name = arm_of(robot.every_limb[limb])
    return () if name is None else _arm_meshes(name)


def show_limbs(spec: Any, robot: RobotSpec, capsules: bool = False) -> None:
    """Add what pictures show of the limbs of a robot to a scene, a `mujoco.MjSpec`.

    Meshes hide the capsules they cover. Links without meshes, all with `capsules`, have rods for
    joints, where the collision shapes leave gaps.
    """
    import mujoco

    for i in range(robot.limbs):
        meshes = () if capsules else limb_meshes(robot, i)
        covered = {body_of(i, mesh.link) for mesh in meshes}
        for geom in spec.geoms:
            if geom.parent.name in covered:
                geom.rgba[3] = 0.0
        for k, mesh in enumerate(meshes):
            name, colour = f"limb{i}/mesh/{k}", mesh.colour or rgba(LIMB_COLOURS[i])
            shell = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            spec.add_mesh(name=name, inertia=shell, **mesh.shape)
            spec.body(body_of(i, mesh.link)).add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=colour,
                **mesh.place, **UNCHECKED,
            )  # fmt: skip
        for k, (body, joint, end) in enumerate(joint_rods(robot, i)):
            if body not in covered:
                spec.body(body).add_geom(
                    name=f"limb{i}/joint/{k}", type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                    fromto=[*joint, *end], size=[JOINT_RADIUS, 0, 0], rgba=JOINT_COLOUR,
                    **UNCHECKED,
                )  # fmt: skip


def joint_rods(robot: RobotSpec, limb: int) -> Iterator[tuple[str, Array, Array]]:
    """Yield a body and two positions in its frame, shape (3,) [m], for each rod of a limb.

    They are the origin of a joint and the closest position on the axes of the body's capsules; both
    links that the joint connects have one.
    """
    shapes, steps = robot.mounted[limb].capsules or (), robot.every_limb[limb].steps
    for k, place in enumerate([*steps[:, :3, 3], np.zeros(3)]):
        for link, joint in ((LINKS[k], place), (LINKS[k + 1], np.zeros(3))):
            ends = [
                np.linspace(shape.start, shape.end, AXIS_SAMPLES)
                for shape in shapes
                if shape.link == link
            ]
            if ends:
                axes = np.concatenate(ends)
                nearest = axes[np.argmin(np.linalg.norm(axes - joint, axis=1))]
                if np.linalg.norm(nearest - joint) > JOINT_RADIUS:
                    yield body_of(limb, link), joint, nearest


def body_of(limb: int, link: str) -> str:
    """Return the name of a link's body in the scene."""
    return f"limb{limb}" if link == "base" else f"limb{limb}/{link}"
