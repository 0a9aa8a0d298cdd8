"""Meshes of a URDF or MJCF file: those that MuJoCo compiles, and those that only pictures show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError, shortened
from mlivr_gym.robot.file_text import mesh_bytes, mesh_file
from mlivr_gym.robot.rigid import axes_of, inverse, quaternion_of, rigid
from mlivr_gym.robot.visuals import Colour, Visual
from mlivr_gym.values import Triple

UNSAID = "-1 -1 -1 -1"
"""Stands for the colour of a mesh of a URDF that has none: MuJoCo gives it that of another one."""


class FileMesh(NamedTuple):
    """A mesh of a file."""

    geom: Any
    """Its shape in the `mujoco.MjSpec`."""
    file: str
    """Its path, or its name in the file if it is not found."""
    scale: Triple
    """Factors from the file's units to metres."""
    colour: Colour | None
    """Red, green, blue and opacity, None if the file says nothing."""
    is_read: bool
    """Whether the file is found and of a known format."""
    is_solid: bool
    """Whether it is a collision shape."""

    def seen_from(self, link: str, body: Array, model: Any) -> Visual:
        """Return it as a visual of a link, in whose frame its body has the frame `body`."""
        k = self.geom.id
        place = body @ rigid(axes_of(model.geom_quat[k]), model.geom_pos[k])
        if model.geom_type[k] == mujoco.mjtGeom.mjGEOM_MESH:
            # MuJoCo has moved the mesh to its own middle and axes.
            mesh = model.geom_dataid[k]
            place = place @ inverse(rigid(axes_of(model.mesh_quat[mesh]), model.mesh_pos[mesh]))
        x, y, z = np.round(place[:3, 3], 9).tolist()
        w, a, b, c = np.round(quaternion_of(place[:3, :3]), 12).tolist()
        return Visual(link, self.file, (x, y, z), (w, a, b, c), self.scale, self.colour)


def name_apart(tree: ElementTree.Element) -> dict[str, str]:
    """Give each mesh file of a URDF a name of its own; return the names that they had.

    MuJoCo takes meshes of one name in different folders for the same.
    """
    colours = {one.get("name"): one.find("color") for one in tree.findall("material")}
    for material in tree.findall("material"):
        tree.remove(material)
    aliases: dict[str, str] = {}
    for mesh in tree.iter("mesh"):
        name = mesh.get("filename", "")
        alias = aliases.setdefault(name, f"{len(aliases)}-{Path(name).name[-60:]}")
        mesh.set("filename", alias)
    for visual in tree.iter("visual"):
        colour = None
        if (said := visual.find("material")) is not None:
            colour = said.find("color")
            colour = colours.get(said.get("name")) if colour is None else colour
            visual.remove(said)
        rgba = UNSAID if colour is None else colour.get("rgba", UNSAID)
        material = ElementTree.SubElement(visual, "material", name="")
        ElementTree.SubElement(material, "color", rgba=rgba)
    return {alias: name for name, alias in aliases.items()}


def taken_out(
    spec: Any, names: dict[str, str], folders: Sequence[Path], with_shapes: bool
) -> list[FileMesh]:
    """Replace what is only seen by spheres without mass, and give the model the other meshes.

    Names are those of `name_apart`, folders that of the file and those of packages. Collision
    shapes that are meshes are only seen unless `with_shapes`. Raises a `RobotError` if a mass
    follows from a mesh whose file is not found, or Git LFS has not fetched a file.
    """
    folder = folders[0] / (spec.compiler.meshdir or spec.meshdir or "")
    spec.meshdir = spec.compiler.meshdir = ""
    known, files, out = dict[str, Any](), dict[str, Path | None](), list[FileMesh]()
    for mesh in spec.meshes:
        mesh.name = mesh.name or Path(mesh.file).stem
        if mesh.file:
            known[mesh.name] = mesh
            name = names.get(mesh.file, mesh.file)
            files[mesh.name] = mesh_file(name, folder, folders[1:])
    colours = {material.name: material.rgba for material in spec.materials}
    from_geoms, kinds = spec.compiler.inertiafromgeom, mujoco.mjtInertiaFromGeom
    for geom in list(spec.geoms):
        is_massive = from_geoms == kinds.mjINERTIAFROMGEOM_TRUE or (
            from_geoms == kinds.mjINERTIAFROMGEOM_AUTO and not geom.parent.explicitinertial
        )
        is_solid = bool(geom.contype or geom.conaffinity)
        colour = colours.get(geom.material, geom.rgba).tolist()
        geom.material, geom.rgba = "", [0.5, 0.5, 0.5, 1.0]
        mesh = known.get(geom.meshname)
        if mesh is None:
            if not is_solid and not is_massive:
                spec.delete(geom)
            continue
        file, name = files[mesh.name], names.get(mesh.file, mesh.file)
        if is_massive and file is None:
            raise RobotError(
                f"mesh {shortened(name)} is not found; the mass of link {geom.parent.name!r} "
                "follows from its shape, give the link an inertial or the file the mesh"
            )
        is_read, scale = file is not None, tuple(mesh.scale.tolist())
        rgba = None if min(colour) < 0.0 else tuple(np.clip(colour, 0.0, 1.0).tolist())
        out.append(FileMesh(geom, str(file or name), scale, rgba, is_read, is_solid))
        if not is_massive and not (is_solid and with_shapes and is_read):
            geom.type, geom.size, geom.meshname = mujoco.mjtGeom.mjGEOM_SPHERE, [1e-3, 0, 0], ""
            geom.contype = geom.conaffinity = 0
            geom.mass = 0.0
    _give(spec, files)
    return out


def _give(spec: Any, files: dict[str, Path | None]) -> None:
    """Give the model the contents of the meshes that it needs, and remove all else."""
    used, assets = {geom.meshname for geom in spec.geoms}, {}
    for k, mesh in enumerate(list(spec.meshes)):
        file = files.get(mesh.name)
        if mesh.name not in used:
            spec.delete(mesh)
        elif file is not None:
            mesh.file = f"{k}-{file.stem[-40:]}{file.suffix.lower()}"
            assets[mesh.file] = mesh_bytes(file)
    spec.assets = assets
    for part in (*spec.skins, *spec.materials, *spec.textures):
        spec.delete(part)
