"""Conversion of the MuJoCo scene to triangle meshes, link by link, for the page."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.pictures.limb_meshes import body_of, limb_meshes
from mlivr_gym.pictures.robot_shapes import JOINT_COLOUR
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import compile_spec, rgba, scene_spec
from mlivr_gym.world.boxes import BOX, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

ROUND = 20
"""Number of faces round a capsule or a cylinder."""

ROD_RADIUS = 0.038
"""Radius of the rods that represent joints between the shapes of the links [m]."""

Mesh = trimesh.Trimesh
"""Triangle mesh whose triangles are anticlockwise seen from outside."""

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, from 0 to 1."""


class Solid(NamedTuple):
    """A shape of one colour that is fixed to a link or to the world."""

    link: str
    """Name of the link in the MuJoCo scene, `"world"` for shapes that do not move."""
    face: str
    """Face of the cabin to which it belongs, `""` for none."""
    colour: Colour
    """Its colour."""
    checked: bool
    """Whether it is a collision shape."""
    mesh: Mesh
    """Its triangles in the frame of the link."""
    covered: bool = False
    """Whether a visual mesh of the link is drawn in its place."""


class Link(NamedTuple):
    """A link of the robot."""

    name: str
    """Its name in the MuJoCo scene."""
    parent: str
    """Name of the parent link, `"world"` for the base."""
    position: Array
    """Its origin in the frame of the parent, shape (3,) [m]."""
    quaternion: Array
    """Its orientation in the frame of the parent at joint angle 0, w, x, y, z."""
    joint: tuple[int, int] | None
    """Limb and number of the joint that rotates it about z, None if it is fixed."""

    def orientation(self, joints: Array) -> Array:
        """Return its orientation w, x, y, z in the parent's frame at joint angles (N, 6) [rad]."""
        if self.joint is None:
            return self.quaternion
        w, x, y, z = self.quaternion
        half = 0.5 * float(joints[self.joint])
        c, s = np.cos(half), np.sin(half)
        return np.array([w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s])


class Scene(NamedTuple):
    """Links and shapes that a page draws."""

    links: tuple[Link, ...]
    """Links of the robot, parents before their children."""
    robot: tuple[Solid, ...]
    """Shapes of the robot."""
    surroundings: tuple[Solid, ...]
    """Shapes that do not move; those of the same face and colour are merged."""


def scene_solids(
    grasp_map: GraspMap, robot: RobotSpec, obstacles: Sequence[Box] = (), capsules: bool = False
) -> Scene:
    """Return the scene of a robot in a module, with visual meshes where they ship.

    Limbs without meshes, or all with `capsules`, have rods for joints, which MuJoCo's scene omits.
    Raises a `SceneError` if MuJoCo refuses the scene.
    """
    model = compile_spec(scene_spec(grasp_map, robot, obstacles))
    faces = {scene_name(BOX, box.id): box.face for box in (*grasp_map.boxes, *obstacles)}
    groups: dict[tuple[str, str, Colour, bool], list[Mesh]] = defaultdict(list)
    for k in range(model.ngeom):
        geom = model.geom(k)
        link = model.body(int(geom.bodyid[0])).name
        r, g, b, opacity = (float(part) for part in geom.rgba)
        rotation = Rotation.from_quat(geom.quat, scalar_first=True).as_matrix()
        mesh = transformed(_mesh_of(int(geom.type[0]), geom.size), geom.pos, rotation)
        checked = bool(geom.contype[0])
        groups[link, faces.get(geom.name, ""), (r, g, b, opacity), checked].append(mesh)
    links = _links(model)
    meshes = () if capsules else tuple(_visual_meshes(robot))
    covered = {solid.link for solid in meshes}
    for link, rod in _rods(model, links):
        if link not in covered:
            groups[link, "", rgba(JOINT_COLOUR), False].append(rod)
    solids = [Solid(*key, merged(made), key[0] in covered) for key, made in groups.items()]
    solids += meshes
    return Scene(
        links,
        tuple(solid for solid in solids if solid.link != "world"),
        tuple(solid for solid in solids if solid.link == "world"),
    )


def _visual_meshes(robot: RobotSpec) -> Iterator[Solid]:
    """Yield the visual meshes of the limbs."""
    for limb in range(robot.limbs):
        for mesh in limb_meshes(robot, limb):
            triangles = _with_edges(trimesh.Trimesh(mesh.vertices, mesh.faces))
            yield Solid(body_of(limb, mesh.link), "", mesh.colour(limb), False, triangles)


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Merge several meshes into one."""
    whole = trimesh.util.concatenate(list(meshes))
    assert isinstance(whole, Mesh)
    return whole


def transformed(mesh: Mesh, position: Array, rotation: Array) -> Mesh:
    """Return a mesh rotated by a matrix, shape (3, 3), and then translated [m]."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    copy: Mesh = mesh.copy()
    copy.apply_transform(pose)
    return copy


def box_mesh(half: Sequence[float] | Array) -> Mesh:
    """Return a box about the origin with given half edges [m]."""
    return _with_edges(trimesh.creation.box(2.0 * np.asarray(half)))


def capsule_mesh(radius: float, half: float) -> Mesh:
    """Return a capsule along z about the origin; `half` is half the length of its axis [m]."""
    capsule = trimesh.creation.capsule(2.0 * half, radius, (ROUND // 2, ROUND))
    return transformed(capsule, -capsule.bounds.mean(axis=0), np.eye(3))


def cylinder_mesh(radius: float, half: float) -> Mesh:
    """Return a cylinder along z about the origin; `half` is half its height [m]."""
    return _with_edges(trimesh.creation.cylinder(radius, 2.0 * half, sections=ROUND))


def rod_mesh(start: Array, end: Array, radius: float) -> Mesh:
    """Return a capsule between two positions, shapes (3,) [m]."""
    along = end - start
    size = float(np.linalg.norm(along))
    rotation = np.eye(3)
    if size > 1e-9:
        rotation = Rotation.align_vectors((along / size)[None], [[0.0, 0.0, 1.0]])[0].as_matrix()
    return transformed(capsule_mesh(radius, 0.5 * size), 0.5 * (start + end), rotation)


def _with_edges(mesh: Mesh) -> Mesh:
    """Split the vertices of a mesh at sharp edges, so that these stay sharp when shaded."""
    shaded: Mesh = trimesh.graph.smooth_shade(mesh, angle=0.25 * np.pi)
    return shaded


def _mesh_of(kind: int, size: Array) -> Mesh:
    """Return the mesh of a geom, which is a box, a capsule or a cylinder."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return box_mesh(size)
    make = capsule_mesh if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else cylinder_mesh
    return make(float(size[0]), float(size[1]))


def _links(model: Any) -> tuple[Link, ...]:
    """Return the links of the robot in a compiled scene."""
    links = []
    for k in range(1, model.nbody):
        body = model.body(k)
        hinge = next(
            (
                model.joint(j).name
                for j in range(model.njnt)
                if model.jnt_bodyid[j] == k and model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
            ),
            None,
        )
        joint = None
        if hinge is not None:
            limb, number = hinge.split("/")
            joint = int(limb.removeprefix("limb")), int(number.removeprefix("joint")) - 1
        parent = model.body(int(body.parentid[0])).name
        links.append(Link(body.name, parent, body.pos.copy(), body.quat.copy(), joint))
    return tuple(links)


def _rods(model: Any, links: Sequence[Link]) -> Iterator[tuple[str, Mesh]]:
    """Yield rods, each with its link, that connect the joints of a link to its nearest capsule."""
    axes: dict[str, list[Array]] = defaultdict(list)
    for k in range(model.ngeom):
        if model.geom_type[k] == mujoco.mjtGeom.mjGEOM_CAPSULE:
            geom = model.geom(k)
            axes[model.body(int(geom.bodyid[0])).name].append(_axis_samples(geom))
    for link in links:
        if link.name not in axes:
            continue
        nearby = np.concatenate(axes[link.name])
        first = [np.zeros(3)] if link.joint else []
        ends = [other.position for other in links if other.parent == link.name and other.joint]
        for position in (*first, *ends):
            nearest = nearby[np.argmin(np.linalg.norm(nearby - position, axis=1))]
            yield link.name, rod_mesh(position, nearest, ROD_RADIUS)


def _axis_samples(geom: Any) -> Array:
    """Sample the axis of a capsule in the frame of its link, shape (k, 3) [m]."""
    along = Rotation.from_quat(geom.quat, scalar_first=True).as_matrix()[:, 2] * geom.size[1]
    samples: Array = geom.pos + np.linspace(-1.0, 1.0, 41)[:, None] * along
    return samples
