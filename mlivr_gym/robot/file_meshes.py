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
from mlivr_gym.robot.link_frames import axes_of, inverse, quaternion_of, rigid
from mlivr_gym.robot.visuals import Colour, Visual
from mlivr_gym.values import Triple

UNSAID = "-1 -1 -1 -1"
"""Stands for the colour of a mesh of a URDF that has none: MuJoCo gives it that of another one."""


class BodyMesh(NamedTuple):
    """A mesh file that shows a body of a URDF or MJCF file."""

    file: str
    """Its path, or its name in the file if it is not found."""
    frame: Array
    """Frame of the mesh in that of the body, shape (4, 4)."""
    scale: Triple
    """Factors from the file's units to metres."""
    colour: Colour | None
    """Red, green, blue and opacity, None if the file says nothing."""

    def seen_from(self, link: str, body: Array) -> Visual:
        """Return it as a visual of a link, in whose frame the body has the frame `body`."""
        place = body @ self.frame
        x, y, z = np.round(place[:3, 3], 9).tolist()
        w, a, b, c = np.round(quaternion_of(place[:3, :3]), 12).tolist()
        return Visual(link, self.file, (x, y, z), (w, a, b, c), self.scale, self.colour)


class _Shown(NamedTuple):
    """A mesh of a file before it is known where the compiled model has it."""

    geom: Any
    mesh: BodyMesh
    is_read: bool
    is_solid: bool


class Meshes:
    """The meshes of a file, taken out of a `mujoco.MjSpec` before it is compiled."""

    def __init__(self, folder: Path, folders: Sequence[Path]) -> None:
        """Take the folder of the file and those in which packages are looked for."""
        self._folder, self._folders = folder, folders
        self._names: dict[str, str] = {}
        self._shown: list[_Shown] = []

    def name_apart(self, tree: ElementTree.Element) -> None:
        """Give each mesh file of a URDF a name of its own.

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
            self._names[alias] = name
        for visual in tree.iter("visual"):
            said = visual.find("material")
            colour = None
            if said is not None:
                color = said.find("color")
                colour = colours.get(said.get("name")) if color is None else color
                visual.remove(said)
            rgba = UNSAID if colour is None else colour.get("rgba", UNSAID)
            material = ElementTree.SubElement(visual, "material", name="")
            ElementTree.SubElement(material, "color", rgba=rgba)

    def take_out(self, spec: Any, with_shapes: bool) -> None:
        """Replace what is only seen by spheres without mass, and give the model the other meshes.

        Collision shapes that are meshes are only seen unless `with_shapes`. Raises a `RobotError`
        if a mass follows from a mesh whose file is not found, or Git LFS has not fetched a file.
        """
        folder = self._folder / (spec.compiler.meshdir or spec.meshdir or "")
        spec.meshdir = spec.compiler.meshdir = ""
        files, known = dict[str, Path | None](), {}
        for mesh in spec.meshes:
            mesh.name = mesh.name or Path(mesh.file).stem
            if mesh.file:
                known[mesh.name] = mesh
                name = self._names.get(mesh.file, mesh.file)
                files[mesh.name] = mesh_file(name, folder, self._folders)
        colours = {material.name: material.rgba for material in spec.materials}
        from_geoms = spec.compiler.inertiafromgeom
        for geom in list(spec.geoms):
            is_massive = from_geoms == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE or (
                from_geoms == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
                and not geom.parent.explicitinertial
            )
            is_solid = bool(geom.contype or geom.conaffinity)
            colour = colours.get(geom.material, geom.rgba).tolist()
            geom.material, geom.rgba = "", [0.5, 0.5, 0.5, 1.0]
            mesh = known.get(geom.meshname)
            if mesh is None:
                if not is_solid and not is_massive:
                    spec.delete(geom)
                continue
            file, name = files[geom.meshname], self._names.get(mesh.file, mesh.file)
            if is_massive and file is None:
                raise RobotError(
                    f"mesh {shortened(name)} is not found; the mass of link {geom.parent.name!r} "
                    "follows from its shape, give the link an inertial or the file the mesh"
                )
            a, b, c = mesh.scale.tolist()
            seen = BodyMesh(str(file or name), np.eye(4), (a, b, c), colour_of(colour))
            self._shown.append(_Shown(geom, seen, file is not None, is_solid))
            if not is_massive and not (is_solid and with_shapes and file is not None):
                geom.type, geom.size, geom.meshname = mujoco.mjtGeom.mjGEOM_SPHERE, [1e-3, 0, 0], ""
                geom.contype = geom.conaffinity = 0
                geom.mass = 0.0
        self._give(spec, files)

    def _give(self, spec: Any, files: dict[str, Path | None]) -> None:
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

    def missing(self, model: Any) -> tuple[tuple[int, str], ...]:
        """Return bodies, and mesh files of their collision shapes that are not read."""
        unread = [one for one in self._shown if one.is_solid and not one.is_read]
        return tuple((int(model.geom_bodyid[one.geom.id]), one.mesh.file) for one in unread)

    def placed(self, model: Any) -> dict[int, tuple[BodyMesh, ...]]:
        """Return the meshes that show each body, by its number in the compiled model.

        Where none of those that are only seen can be read, those of its collision shapes stand for
        them.
        """
        every: dict[int, list[tuple[_Shown, BodyMesh]]] = {}
        for one in self._shown:
            k = one.geom.id
            frame = rigid(axes_of(model.geom_quat[k]), model.geom_pos[k])
            if model.geom_type[k] == mujoco.mjtGeom.mjGEOM_MESH:
                # MuJoCo has moved the mesh to its own middle and axes.
                mesh = model.geom_dataid[k]
                moved = rigid(axes_of(model.mesh_quat[mesh]), model.mesh_pos[mesh])
                frame = frame @ inverse(moved)
            placed = one, one.mesh._replace(frame=frame)
            every.setdefault(int(model.geom_bodyid[k]), []).append(placed)
        out = {}
        for body, found in every.items():
            seen = [mesh for one, mesh in found if not one.is_solid]
            if not any(one.is_read for one, _ in found if not one.is_solid):
                seen = [mesh for one, mesh in found if one.is_solid and one.is_read] or seen
            if seen:
                out[body] = tuple(seen)
        return out


def colour_of(rgba: Sequence[float]) -> Colour | None:
    """Return four components from 0 to 1, None if they are `UNSAID`."""
    if min(rgba) < 0.0:
        return None
    r, g, b, opacity = np.clip(rgba, 0.0, 1.0).tolist()
    return r, g, b, opacity
