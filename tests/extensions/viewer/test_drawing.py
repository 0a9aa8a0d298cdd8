"""The scene as triangles, compared with the MuJoCo model that it is made from."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym.pictures.limb_meshes import COLOURS, JOINT_COLOUR
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.simulation.scene import compile_spec, scene_spec

pytest.importorskip("viser", reason="the extra 'viewer' is not installed")

import trimesh

from mlivr_gym.extensions.viewer.drawing import geom_mesh, scene_solids


def test_every_geom_is_drawn_in_its_colour_and_size(jem):
    """Bounds of all shapes of a link and colour are those of MuJoCo's geoms."""
    robot = robot_spec("mlivr2")
    _, solids = scene_solids(jem, robot, capsules=True)
    model = compile_spec(scene_spec(jem, robot))
    walls = {f"box/{box.id}": f"module/{box.face or 'rest'}" for box in jem.boxes}
    for k in range(model.ngeom):
        geom = model.geom(k)
        link = model.body(int(geom.bodyid[0])).name
        colour = tuple(float(part) for part in geom.rgba)
        node = walls.get(geom.name, f"robot/{link.replace('/', '.')}")
        corners = np.concatenate([mesh.vertices for mesh in solids[node, colour]])
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


def test_triangles_of_primitives_close_them_and_face_outwards():
    text = """<mujoco><worldbody><geom type="box" size="0.1 0.2 0.3"/>
    <geom type="cylinder" size="0.1 0.2"/><geom type="capsule" size="0.1 0.2"/></worldbody>
    </mujoco>"""
    model, tube = mujoco.MjModel.from_xml_string(text), np.pi * 0.1**2 * 0.4
    for k, volume in enumerate((0.048, tube, tube + 4.0 / 3.0 * np.pi * 0.1**3)):
        mesh = geom_mesh(model, k)
        assert mesh.volume == pytest.approx(volume, rel=0.03)
        assert (np.einsum("fi,fi->f", mesh.face_normals, mesh.triangles_center) > 0.0).all()


def test_edges_of_a_box_stay_sharp(page):
    """No vertex has faces of two sides."""
    page.mesh("box", trimesh.creation.box((1.0, 2.0, 3.0)), (1.0, 0.0, 0.0, 1.0))
    node = page.nodes["box"]
    drawn = trimesh.Trimesh(node.vertices, node.faces, process=False)
    assert len(drawn.vertices) == 24
    np.testing.assert_allclose(np.abs(drawn.vertex_normals).max(axis=1), 1.0)


def test_meshes_are_drawn_in_the_place_of_collision_shapes(jem):
    """Of a UR10e no meshes ship, so limb 0 keeps its capsules, with rods."""
    _, solids = scene_solids(jem, robot_spec("mlivr2-unequal"), capsules=False)
    for limb, expected in enumerate((JOINT_COLOUR, COLOURS["LinkGrey"])):
        node = f"robot/limb{limb}.forearm"
        for colour in (JOINT_COLOUR, COLOURS["LinkGrey"]):
            key = node, tuple(np.float32(colour).tolist())
            assert (key in solids) == (colour == expected)
