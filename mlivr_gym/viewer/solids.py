"""Conversion of the MuJoCo scene to triangle meshes, link by link, for the page."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.pictures.limb_meshes import show_meshes
from mlivr_gym.pictures.robot_shapes import JOINT_COLOUR
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import (
    COLOURS,
    compile_spec,
    rgba,
    robot_alone,
    set_configuration,
)
from mlivr_gym.world.boxes import Box
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
    """Its colour; a shape in whose place a visual mesh is drawn has opacity 0."""
    checked: bool
    """Whether it is a collision shape."""
    mesh: Mesh
    """Its triangles in the frame of the link."""

    @property
    def covered(self) -> bool:
        """Whether a visual mesh of the link is drawn in its place."""
        return self.colour[3] == 0.0


class Scene(NamedTuple):
    """The robot's MuJoCo model, which says where its links are, and the shapes that are drawn."""

    model: mujoco.MjModel
    """Model of the robot alone."""
    data: mujoco.MjData
    """Its configuration."""
    robot: tuple[Solid, ...]
    """Shapes of the robot."""
    surroundings: tuple[Solid, ...]
    """Shapes that do not move; those of the same face and colour are merged."""

    def link_poses(self, configuration: Configuration) -> dict[str, tuple[Array, Array]]:
        """Return position [m] and quaternion w, x, y, z of each link in the world."""
        set_configuration(self.model, self.data, *configuration)
        names = [self.model.body(k).name for k in range(1, self.model.nbody)]
        poses = zip(self.data.xpos[1:].copy(), self.data.xquat[1:].copy(), strict=True)
        return dict(zip(names, poses, strict=True))


def scene_solids(grasp_map: GraspMap, robot: RobotSpec, capsules: bool = False) -> Scene:
    """Return the scene of a robot in a module, with visual meshes where they ship.

    Limbs without meshes, or all with `capsules`, have rods for joints, which MuJoCo's scene omits.
    Raises a `SceneError` if MuJoCo refuses the robot.
    """
    spec = robot_alone(robot)
    if not capsules:
        show_meshes(spec, robot)
    model = compile_spec(spec)
    groups: dict[tuple[str, str, Colour, bool], list[Mesh]] = defaultdict(list)
    for box in grasp_map.boxes:
        groups["world", box.face, COLOURS[box.kind], True].append(mesh_of_box(box))
    covered = set()
    for k in range(model.ngeom):
        geom = model.geom(k)
        link, (r, g, b, opacity) = model.body(int(geom.bodyid[0])).name, geom.rgba.tolist()
        rotation = Rotation.from_quat(geom.quat, scalar_first=True).as_matrix()
        mesh = transformed(_mesh_of(model, k), geom.pos, rotation)
        groups[link, "", (r, g, b, opacity), bool(geom.contype[0])].append(mesh)
        if geom.type[0] == mujoco.mjtGeom.mjGEOM_MESH:
            covered.add(link)
    for link, rod in _rods(model):
        if link not in covered:
            groups[link, "", rgba(JOINT_COLOUR), False].append(rod)
    solids = [Solid(*key, merged(made)) for key, made in groups.items()]
    return Scene(
        model,
        mujoco.MjData(model),
        tuple(solid for solid in solids if solid.link != "world"),
        tuple(solid for solid in solids if solid.link == "world"),
    )


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


def mesh_of_box(box: Box) -> Mesh:
    """Return the mesh of a box in the world."""
    return transformed(box_mesh(box.half), np.array(box.centre), np.array(box.rotation))


def _mesh_of(model: mujoco.MjModel, k: int) -> Mesh:
    """Return the mesh of a geom, which is a mesh, a box, a capsule or a cylinder."""
    kind, size = model.geom_type[k], model.geom_size[k]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.mesh(int(model.geom_dataid[k]))
        vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
        faces = model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]]
        return _with_edges(trimesh.Trimesh(vertices, faces))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return box_mesh(size)
    make = capsule_mesh if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else cylinder_mesh
    return make(float(size[0]), float(size[1]))


def _rods(model: mujoco.MjModel) -> Iterator[tuple[str, Mesh]]:
    """Yield rods, each with its link, that connect the joints of a link to its nearest capsule."""
    hinges = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE]
    for link in range(1, model.nbody):
        geoms = np.flatnonzero(
            (model.geom_bodyid == link) & (model.geom_type == mujoco.mjtGeom.mjGEOM_CAPSULE)
        )
        if not len(geoms):
            continue
        nearby = np.concatenate([_axis_samples(model.geom(int(k))) for k in geoms])
        joints = [np.zeros(3)] if link in hinges else []
        joints += [model.body_pos[k] for k in hinges if model.body_parentid[k] == link]
        for position in joints:
            nearest = nearby[np.argmin(np.linalg.norm(nearby - position, axis=1))]
            yield model.body(link).name, rod_mesh(position, nearest, ROD_RADIUS)


def _axis_samples(geom: Any) -> Array:
    """Sample the axis of a capsule in the frame of its link, shape (k, 3) [m]."""
    along = Rotation.from_quat(geom.quat, scalar_first=True).as_matrix()[:, 2] * geom.size[1]
    samples: Array = geom.pos + np.linspace(-1.0, 1.0, 41)[:, None] * along
    return samples
