"""The MuJoCo scene as triangles, link by link, for a page that draws meshes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.pictures.robot_shapes import JOINT_COLOUR
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import compiled, rgba, scene_spec
from mlivr_gym.world.boxes import BOX, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

ROUND = 20
"""Number of faces round a capsule or a cylinder."""

ROD_RADIUS = 0.038
"""Radius of the rods that stand for joints between the shapes of the links [m]."""

Mesh = trimesh.Trimesh
"""Triangles, anticlockwise seen from outside."""

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, from 0 to 1."""


class Solid(NamedTuple):
    """A shape of one colour that is fixed to a link, or to the world."""

    link: str
    """The link's name in the MuJoCo scene, `"world"` for what does not move."""
    face: str
    """The cabin face that it belongs to, `""` for none."""
    colour: Colour
    """Its colour."""
    checked: bool
    """Whether collisions are checked with it."""
    mesh: Mesh
    """Its triangles in the frame of the link."""


class Link(NamedTuple):
    """A link of the robot."""

    name: str
    """Its name in the MuJoCo scene."""
    parent: str
    """The name of the link that it is joined to, `"world"` for the base."""
    position: Array
    """Its origin in the frame of the parent, shape (3,) [m]."""
    quaternion: Array
    """Its turn in that frame at joint angle 0, w, x, y, z."""
    joint: tuple[int, int] | None
    """Limb and number of the joint that turns it about z, None if it is fixed."""

    def orientation(self, joints: Array) -> Array:
        """Its turn in the frame of the parent, w, x, y, z, at joint angles (N, 6) [rad]."""
        if self.joint is None:
            return self.quaternion
        w, x, y, z = self.quaternion
        half = 0.5 * float(joints[self.joint])
        c, s = np.cos(half), np.sin(half)
        return np.array([w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s])


class Scene(NamedTuple):
    """What a page draws."""

    links: tuple[Link, ...]
    """Links of the robot, parents first."""
    robot: tuple[Solid, ...]
    """Shapes of the robot."""
    surroundings: tuple[Solid, ...]
    """Shapes that do not move, those of one face and colour together."""


def scene_solids(grasp_map: GraspMap, robot: RobotSpec, obstacles: Sequence[Box] = ()) -> Scene:
    """The scene of a robot in a cabin, with rods for the joints that the scene leaves out.

    Raises
    ------
    SceneError
        If MuJoCo refuses it.
    """
    model = compiled(scene_spec(grasp_map, robot, obstacles))
    faces = {scene_name(BOX, box.id): box.face for box in (*grasp_map.boxes, *obstacles)}
    found: dict[tuple[str, str, Colour, bool], list[Mesh]] = defaultdict(list)
    for k in range(model.ngeom):
        geom = model.geom(k)
        link = model.body(int(geom.bodyid[0])).name
        r, g, b, opacity = (float(part) for part in geom.rgba)
        turn = Rotation.from_quat(geom.quat, scalar_first=True).as_matrix()
        mesh = transformed(_mesh_of(int(geom.type[0]), geom.size), geom.pos, turn)
        checked = bool(geom.contype[0])
        found[link, faces.get(geom.name, ""), (r, g, b, opacity), checked].append(mesh)
    links = _links(model)
    for link, rod in _rods(model, links):
        found[link, "", rgba(JOINT_COLOUR), False].append(rod)
    solids = [Solid(*key, merged(meshes)) for key, meshes in found.items()]
    return Scene(
        links,
        tuple(solid for solid in solids if solid.link != "world"),
        tuple(solid for solid in solids if solid.link == "world"),
    )


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one."""
    whole = trimesh.util.concatenate(list(meshes))
    assert isinstance(whole, Mesh)
    return whole


def transformed(mesh: Mesh, position: Array, rotation: Array) -> Mesh:
    """A mesh turned by a rotation, shape (3, 3), and then moved by a position [m]."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    there: Mesh = mesh.copy()
    there.apply_transform(pose)
    return there


def box_mesh(half: Sequence[float] | Array) -> Mesh:
    """A box about the origin by its half edges [m]."""
    return _with_edges(trimesh.creation.box(2.0 * np.asarray(half)))


def capsule_mesh(radius: float, half: float) -> Mesh:
    """A capsule along z about the origin; `half` is half the length of its axis [m]."""
    capsule = trimesh.creation.capsule(2.0 * half, radius, (ROUND // 2, ROUND))
    return transformed(capsule, -capsule.bounds.mean(axis=0), np.eye(3))


def cylinder_mesh(radius: float, half: float) -> Mesh:
    """A cylinder along z about the origin; `half` is half its height [m]."""
    return _with_edges(trimesh.creation.cylinder(radius, 2.0 * half, sections=ROUND))


def rod_mesh(start: Array, end: Array, radius: float) -> Mesh:
    """A capsule between two places, shapes (3,) [m]."""
    along = end - start
    size = float(np.linalg.norm(along))
    turn = np.eye(3)
    if size > 1e-9:
        turn = Rotation.align_vectors((along / size)[None], [[0.0, 0.0, 1.0]])[0].as_matrix()
    return transformed(capsule_mesh(radius, 0.5 * size), 0.5 * (start + end), turn)


def _with_edges(mesh: Mesh) -> Mesh:
    """A mesh whose sharp edges stay sharp: no corner is shared across one."""
    shaded: Mesh = trimesh.graph.smooth_shade(mesh, angle=0.25 * np.pi)
    return shaded


def _mesh_of(kind: int, size: Array) -> Mesh:
    """The mesh of a geom of the scene, which has boxes, capsules and cylinders."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return box_mesh(size)
    make = capsule_mesh if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else cylinder_mesh
    return make(float(size[0]), float(size[1]))


def _links(model: Any) -> tuple[Link, ...]:
    """The links of the robot in a compiled scene."""
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
    """Rods, fixed to each link, from its joint and from the next one to its nearest capsule."""
    axes: dict[str, list[Array]] = defaultdict(list)
    for k in range(model.ngeom):
        if model.geom_type[k] == mujoco.mjtGeom.mjGEOM_CAPSULE:
            geom = model.geom(k)
            axes[model.body(int(geom.bodyid[0])).name].append(_axis_places(geom))
    for link in links:
        if link.name not in axes:
            continue
        nearby = np.concatenate(axes[link.name])
        first = [np.zeros(3)] if link.joint else []
        ends = [other.position for other in links if other.parent == link.name and other.joint]
        for place in (*first, *ends):
            nearest = nearby[np.argmin(np.linalg.norm(nearby - place, axis=1))]
            yield link.name, rod_mesh(place, nearest, ROD_RADIUS)


def _axis_places(geom: Any) -> Array:
    """Places along the axis of a capsule in the frame of its link, shape (k, 3) [m]."""
    along = Rotation.from_quat(geom.quat, scalar_first=True).as_matrix()[:, 2] * geom.size[1]
    places: Array = geom.pos + np.linspace(-1.0, 1.0, 41)[:, None] * along
    return places
