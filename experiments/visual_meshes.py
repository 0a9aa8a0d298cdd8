"""Simplify the visual meshes of the UR3e and UR5e that pictures and films draw.

    pip install airo-models==0.0.12 fast-simplification trimesh
    python experiments/visual_meshes.py

The meshes are those of Universal_Robots_ROS2_Description (BSD-3) as the package airo-models (MIT)
has them; both licences stand in `envs_assets/meshes-licence.txt`. Each material of a link is
simplified to at most `MOST` faces and turned into the link's frame. Writes
`envs_assets/meshes-ur3e.npz` and `meshes-ur5e.npz`; nothing at run time needs the packages above.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from reports import command_line

LINKS = {
    "base": "base_link_inertia", "shoulder": "shoulder_link", "upper_arm": "upper_arm_link",
    "forearm": "forearm_link", "wrist_1": "wrist_1_link", "wrist_2": "wrist_2_link",
    "wrist_3": "wrist_3_link",
}  # fmt: skip
"""Links of a limb, and their names in the package."""

MOST = 800
"""Largest number of faces of one material of a link."""

GRID = 0.004
"""Size of the grid on which meshes of many separate pieces are merged [m]."""

STEP = 1e-4
"""Vertices are rounded to this length [m]."""


def parts(file: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return vertices and triangles of an OBJ file by the name of their material."""
    vertices, faces, material = [], {}, ""
    for line in file.read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            vertices.append([float(part) for part in rest[:3]])
        elif word == "usemtl":
            material = rest[0].split(".")[0]
        elif word == "f":
            corners = [int(part.split("/")[0]) - 1 for part in rest]
            fan = [(corners[0], b, c) for b, c in pairwise(corners[1:])]
            faces.setdefault(material, []).extend(fan)
    points = np.array(vertices)
    return {name: (points, np.array(rows)) for name, rows in faces.items()}


def simplified(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh with fewer faces, whose equal vertices are merged."""
    import fast_simplification
    import trimesh

    mesh = trimesh.Trimesh(points, faces)
    mesh.merge_vertices()
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) <= MOST:
        return mesh.vertices, mesh.faces
    points, faces = fast_simplification.simplify(
        np.asarray(mesh.vertices, dtype=np.float32), mesh.faces, target_count=MOST
    )
    if len(faces) > MOST:  # of many separate pieces, which merge on a grid
        mesh = trimesh.Trimesh(GRID * np.round(points / GRID), faces, process=False)
        mesh.merge_vertices()
        mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
        mesh.remove_unreferenced_vertices()
        points, faces = mesh.vertices, mesh.faces
    return points, faces


def arm(folder: Path, name: str) -> dict[str, np.ndarray]:
    """Return the arrays of an arm: vertices, in units of `STEP`, and faces of each part."""
    from scipy.spatial.transform import Rotation

    text = (folder / f"{name}.urdf").read_text()
    tree = ElementTree.fromstring(text.replace("drake:", ""))  # undeclared prefixes
    out = {}
    for link, title in LINKS.items():
        visual = next(
            element.find("visual") for element in tree.iter("link") if element.get("name") == title
        )
        origin, mesh = visual.find("origin"), visual.find("geometry/mesh")
        turn = Rotation.from_euler("xyz", [float(a) for a in origin.get("rpy").split()])
        shift = np.array([float(a) for a in origin.get("xyz").split()])
        if link == "base":  # the package adds a cable to the base
            mesh.set("filename", "visual/base.obj")
        for material, (points, faces) in parts(folder / mesh.get("filename")).items():
            points, faces = simplified(turn.apply(points) + shift, faces)
            out[f"{link}/{material}/vertices"] = np.round(points / STEP).astype(np.int16)
            out[f"{link}/{material}/faces"] = faces.astype(np.uint16)
    return out


def main() -> None:
    """Write both arms."""
    parser = command_line(__doc__, None)
    parser.add_argument("--package", type=Path, help="folder of airo_models, if not installed")
    folder = parser.parse_args().package
    if folder is None:
        import airo_models

        folder = Path(airo_models.__file__).parent
    for name in ("ur3e", "ur5e"):
        arrays = arm(folder / "arms" / name, name)
        path = Path(__file__).parent.parent / "envs_assets" / f"meshes-{name}.npz"
        np.savez_compressed(path, **arrays)
        faces = sum(len(rows) for key, rows in arrays.items() if key.endswith("faces"))
        print(f"{path.name}: {faces} faces, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
