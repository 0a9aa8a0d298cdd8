"""Visual meshes of limbs: which files of a URDF or MJCF file show which link, and where.

Only pictures, films and the viewer use them, see `pictures.limb_meshes`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.link_frames import rigid
from mlivr_gym.schema import Choice, FieldPath, OrNone, Struct, Text, Tuples
from mlivr_gym.values import MAX_REMARK_LENGTH, MAX_ROBOT_LENGTH, Triple

MESH_FORMATS = (".stl", ".obj", ".msh")
"""Endings of mesh files that MuJoCo reads."""

LARGEST_SCALE = 1e3
"""Largest factor from the units of a mesh file to metres."""

MOST_VISUALS = 64
"""Largest number of visual meshes of a limb."""

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, from 0 to 1."""


@dataclass(frozen=True)
class Visual:
    """A mesh file that shows a link of a limb."""

    link: Annotated[str, Choice(LINKS)]
    """One of `capsules.LINKS`."""
    file: Annotated[str, Text(1, MAX_REMARK_LENGTH)]
    """Path of the file, STL or OBJ; one that is missing is named when the robot is drawn."""
    position: Annotated[Triple, Tuples((3,), most=MAX_ROBOT_LENGTH, unit="m")] = (0.0, 0.0, 0.0)
    """Where the mesh's origin lies in the frame of the link [m]."""
    quaternion: Annotated[
        tuple[float, float, float, float], Tuples((4,), -1.0 - 1e-9, 1.0 + 1e-9)
    ] = (1.0, 0.0, 0.0, 0.0)
    """Its orientation there, w, x, y, z."""
    scale: Annotated[Triple, Tuples((3,), most=LARGEST_SCALE)] = (1.0, 1.0, 1.0)
    """Factors from the file's units to metres."""
    colour: Annotated[Colour | None, OrNone(Tuples((4,), 0.0, 1.0))] = None
    """Red, green, blue and opacity, from 0 to 1; None for the colour of the limb."""

    def __post_init__(self) -> None:
        """Check every figure."""
        VISUAL.check(self, FieldPath("visual", RobotError))

    @property
    def frame(self) -> Array:
        """Frame of the mesh in that of the link, shape (4, 4)."""
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_quat(self.quaternion, scalar_first=True)
        return rigid(turn.as_matrix(), self.position)


VISUAL = Struct.of(Visual)
"""Fields of a `Visual`."""


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
        from scipy.spatial.transform import Rotation

        place = body @ self.frame
        quaternion = Rotation.from_matrix(place[:3, :3]).as_quat(scalar_first=True)
        x, y, z = np.round(place[:3, 3], 9).tolist()
        w, a, b, c = np.round(quaternion, 12).tolist()
        return Visual(link, self.file, (x, y, z), (w, a, b, c), self.scale, self.colour)


def mesh_file(name: str, folder: Path, folders: Sequence[Path]) -> Path | None:
    """Return the file of a mesh, None if it is not found or MuJoCo cannot read its format.

    Its name in a description that lies in `folder` may begin with `package://`, whose packages are
    looked for in `folders`, or with `file://`.
    """
    if name.startswith("package://"):
        places = [parent / name.removeprefix("package://") for parent in folders]
    else:
        places = [folder / name.removeprefix("file://")]
    if Path(name).suffix.lower() not in MESH_FORMATS:
        return None
    return next((place.resolve() for place in places if place.is_file()), None)


def urdf_meshes(
    tree: ElementTree.Element, folder: Path, folders: Sequence[Path]
) -> dict[str, tuple[BodyMesh, ...]]:
    """Return the meshes that show each link of a URDF.

    Where none of a link's visual meshes can be read, those of its collision shapes stand for them.
    """
    colours = {
        material.get("name"): color.get("rgba", "")
        for material in tree.findall("material")
        if (color := material.find("color")) is not None
    }
    out = {}
    for link in tree.iter("link"):
        seen = tuple(_meshes_of(link, "visual", colours, folder, folders))
        if not any(Path(mesh.file).is_file() for mesh in seen):
            solid = tuple(_meshes_of(link, "collision", colours, folder, folders))
            seen = solid if any(Path(mesh.file).is_file() for mesh in solid) else seen
        if seen:
            out[link.get("name", "")] = seen
    return out


def _meshes_of(
    link: ElementTree.Element,
    tag: str,
    colours: dict[str | None, str],
    folder: Path,
    folders: Sequence[Path],
) -> Iterator[BodyMesh]:
    """Yield the meshes of the visual or collision shapes of a link."""
    from scipy.spatial.transform import Rotation

    for shape in link.findall(tag):
        mesh, origin, material = (
            shape.find(path) for path in ("geometry/mesh", "origin", "material")
        )
        if mesh is None:
            continue
        frame, name = np.eye(4), mesh.get("filename", "")
        if origin is not None:
            frame[:3, 3] = _numbers(origin.get("xyz"), (0.0, 0.0, 0.0))
            turn = Rotation.from_euler("xyz", _numbers(origin.get("rpy"), (0.0, 0.0, 0.0)))
            frame[:3, :3] = turn.as_matrix()
        color = None if material is None else material.find("color")
        text = colours.get(material.get("name")) if material is not None else None
        text = text if color is None else color.get("rgba")
        rgba = _numbers(text, ()) if text else ()
        a, b, c = _numbers(mesh.get("scale"), (1.0, 1.0, 1.0))
        file = mesh_file(name, folder, folders)
        yield BodyMesh(name if file is None else str(file), frame, (a, b, c), colour_of(rgba))


def colour_of(rgba: Sequence[float]) -> Colour | None:
    """Return four components from 0 to 1, None if there are not four."""
    if len(rgba) != 4:
        return None
    r, g, b, opacity = np.clip(rgba, 0.0, 1.0).tolist()
    return r, g, b, opacity


def _numbers(text: str | None, otherwise: Sequence[float]) -> Sequence[float]:
    """Return the numbers of an attribute."""
    return otherwise if text is None else [float(number) for number in text.split()]


def mjcf_meshes(
    spec: Any, geoms: Sequence[tuple[Any, str, str]]
) -> list[tuple[str, str, BodyMesh]]:
    """Put spheres without mass in the place of visual meshes, which the model need not hold.

    Geoms of a `mujoco.MjSpec` are given with the names of their meshes and of their materials.
    Returned are the name of each sphere, the name of its body, and the mesh, whose frame is not
    known before the model is compiled.
    """
    import mujoco

    folder = Path(spec.modelfiledir) / (spec.compiler.meshdir or spec.meshdir or "")
    files = {mesh.name or Path(mesh.file).stem: mesh for mesh in spec.meshes if mesh.file}
    colours = {material.name: material.rgba for material in spec.materials}
    out = []
    for k, (geom, meshname, material) in enumerate(geoms):
        mesh = files.get(meshname)
        if mesh is None:
            spec.delete(geom)
            continue
        geom.name, geom.type = f"visual/{k}", mujoco.mjtGeom.mjGEOM_SPHERE
        geom.size, geom.meshname, geom.mass = [1e-3, 0.0, 0.0], "", 0.0
        rgba = colours.get(material, geom.rgba)
        a, b, c = mesh.scale.tolist()
        out.append((
            geom.name, geom.parent.name,
            BodyMesh(str((folder / mesh.file).resolve()), np.eye(4), (a, b, c),
                     colour_of(rgba.tolist())),
        ))  # fmt: skip
    return out


def placed_meshes(
    model: Any, found: Sequence[tuple[str, str, BodyMesh]]
) -> dict[str, tuple[BodyMesh, ...]]:
    """Return meshes by the name of their body, placed where the model has their spheres."""
    import mujoco

    out: dict[str, tuple[BodyMesh, ...]] = {}
    for name, body, mesh in found:
        geom, turn = model.geom(name), np.empty(9)
        mujoco.mju_quat2Mat(turn, geom.quat)
        placed = mesh._replace(frame=rigid(turn.reshape(3, 3), geom.pos))
        out[body] = (*out.get(body, ()), placed)
    return out
