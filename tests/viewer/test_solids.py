"""The scene as triangles, compared with the MuJoCo model that it is made from."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym.pictures.limb_meshes import COLOURS, JOINT_COLOUR
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.simulation.scene import compile_spec, scene_spec

pytest.importorskip("trimesh", reason="the extra 'viewer' is not installed")

from mlivr_gym.viewer.solids import geom_mesh, scene_solids


def test_every_geom_is_drawn_in_its_colour_and_size(jem):
    """Bounds of all shapes of a link and colour are those of MuJoCo's geoms."""
    robot = robot_spec("mlivr2")
    _, solids = scene_solids(jem, robot, capsules=True)
    model = compile_spec(scene_spec(jem, robot))
    rounded = {(s.link, s.colour): [] for s in solids}
    for s in solids:
        rounded[s.link, s.colour].append(s.mesh.vertices)
    for k in range(model.ngeom):
        geom = model.geom(k)
        link = model.body(int(geom.bodyid[0])).name
        colour = tuple(float(part) for part in geom.rgba)
        corners = np.concatenate(rounded[link, colour])
        turn = Rotation.from_quat(geom.quat, scalar_first=True).as_matrix()
        if geom.type[0] == mujoco.mjtGeom.mjGEOM_BOX:
            reach = np.abs(turn) @ geom.size
        elif geom.type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER:
            across = np.sqrt(1.0 - turn[:, 2] ** 2)
            reach = geom.size[0] * across + np.abs(turn[:, 2]) * geom.size[1]
        else:
            reach = geom.size[0] + np.abs(turn[:, 2]) * geom.size[1]
        assert (corners.min(axis=0) <= geom.pos - 0.97 * reach + 1e-9).all()
        assert (corners.max(axis=0) >= geom.pos + 0.97 * reach - 1e-9).all()


def test_triangles_of_primitives_close_them_and_edges_of_boxes_stay_sharp(jem):
    """Volume and outward normals; no vertex of a box has faces of two sides."""
    text = """<mujoco><worldbody><geom type="box" size="0.1 0.2 0.3"/>
    <geom type="cylinder" size="0.1 0.2"/><geom type="capsule" size="0.1 0.2"/></worldbody>
    </mujoco>"""
    model, tube = mujoco.MjModel.from_xml_string(text), np.pi * 0.1**2 * 0.4
    for k, volume in enumerate((0.048, tube, tube + 4.0 / 3.0 * np.pi * 0.1**3)):
        mesh = geom_mesh(model, k)
        assert mesh.volume == pytest.approx(volume, rel=0.03)
        assert (np.einsum("fi,fi->f", mesh.face_normals, mesh.triangles_center) > 0.0).all()
    box = geom_mesh(model, 0)
    np.testing.assert_allclose(np.abs(box.vertex_normals).max(axis=1), 1.0)


def test_walls_are_those_of_their_face(jem):
    _, solids = scene_solids(jem, robot_spec("mlivr2"))
    for face in {box.face for box in jem.boxes}:
        corners = [s.mesh.bounds for s in solids if s.link == "world" and s.face == face]
        bounds = np.array([box.bounds for box in jem.boxes if box.face == face])
        np.testing.assert_allclose(np.min(corners, axis=(0, 1)), bounds[:, 0].min(axis=0))
        np.testing.assert_allclose(np.max(corners, axis=(0, 1)), bounds[:, 1].max(axis=0))


def test_meshes_are_drawn_in_the_place_of_collision_shapes(jem):
    """Of a UR10e no meshes ship, so limb 0 keeps its capsules, with rods."""
    _, solids = scene_solids(jem, robot_spec("mlivr2-unequal"))
    colours = {f"limb{i}": {s.colour for s in solids if s.link == f"limb{i}/forearm"}
               for i in range(2)}  # fmt: skip
    assert {tuple(np.float32(JOINT_COLOUR).tolist())} < colours["limb0"]
    drawn = {tuple(np.float32((*COLOURS["LinkGrey"],)).tolist())}
    assert drawn & colours["limb1"]
    assert not drawn & colours["limb0"]
