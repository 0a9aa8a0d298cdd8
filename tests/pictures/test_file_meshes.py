"""Visual meshes of URDF and MJCF files, against where MuJoCo has them in the file itself."""

import mujoco
import numpy as np
import pytest
import trimesh
from robot_texts import IIWA14, one_arm

from mlivr_gym import RobotSpec
from mlivr_gym.pictures.limb_meshes import limb_meshes, show_limbs
from mlivr_gym.simulation.scene import compile_spec, robot_alone

SEEN = """<visual><origin xyz="0.02 -0.01 0.03" rpy="0.3 -0.2 1.1"/><geometry>
<mesh filename="{file}" scale="0.5 0.5 0.25"/></geometry><material name="red"/></visual>"""
EXTRA = '<mujoco><compiler strippath="false" discardvisual="false" fusestatic="false"/></mujoco>'
RED = '<material name="red"><color rgba="1 0 0 1"/></material>'


@pytest.fixture
def folder(tmp_path):
    """A package with a tetrahedron as a mesh."""
    points = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.3]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    (tmp_path / "arms" / "meshes").mkdir(parents=True)
    trimesh.Trimesh(points, faces, process=False).export(tmp_path / "arms" / "meshes" / "link.stl")
    return tmp_path / "arms"


def written(folder, file="package://arms/meshes/link.stl", links=range(1, 8)):
    """A URDF of an iiwa in other conventions, of which some links have a mesh."""
    text = one_arm(frames=IIWA14, seed=3).replace("</robot>", f"{RED}</robot>")
    for k in links:
        link = f'<link name="link{k}">'
        text = text.replace(link, link + SEEN.format(file=file))
    path = folder / "arm.urdf"
    path.write_text(text)
    return path


def points_of_file(path, folder, angles, held):
    """Vertices of the meshes seen from the tool, as MuJoCo has them in the file."""
    text = path.read_text().replace("package://arms", str(folder))
    model = mujoco.MjModel.from_xml_string(text.replace("</robot>", EXTRA + "</robot>"))
    data = mujoco.MjData(model)
    data.qpos[:] = np.insert(angles, held[0] - 1, held[1])
    mujoco.mj_kinematics(model, data)
    tool, out = data.body("tool0"), []
    for geom in range(model.ngeom):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            world = model.mesh_vert @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            out.append((world - tool.xpos) @ tool.xmat.reshape(3, 3))
    return np.array(out)


@pytest.mark.parametrize("held", [(5, -0.4), (1, 0.3)])
def test_meshes_are_where_the_file_has_them(folder, held):
    """Seen from the flange, whatever joint is locked, at drawn joint angles."""
    path = written(folder)
    options = {"locked_joint": f"joint{held[0]}", "locked_angle": held[1], "capsules": "ur5e"}
    robot = RobotSpec.from_urdf(path, **options)
    spec = robot_alone(robot)
    show_limbs(spec, robot)
    model = compile_spec(spec)
    data, angles = mujoco.MjData(model), np.random.default_rng(0).uniform(-2.0, 2.0, 6)
    data.qpos[3] = 1.0
    data.qpos[7:13] = angles
    mujoco.mj_kinematics(model, data)
    flange, found = data.site("limb0/flange"), []
    for geom in range(model.ngeom):
        if model.geom(geom).name.startswith("limb0/mesh/"):
            k = model.geom_dataid[geom]
            start = model.mesh_vertadr[k]
            points = model.mesh_vert[start : start + model.mesh_vertnum[k]]
            world = points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            found.append((world - flange.xpos) @ flange.xmat.reshape(3, 3))
            np.testing.assert_allclose(model.geom_rgba[geom], (1.0, 0.0, 0.0, 1.0))
    expected = points_of_file(path, folder, angles, held)
    assert len(found) == len(expected) == 7
    for theirs in expected:
        apart = [np.abs(theirs[:, None] - mine).sum(axis=2).min(axis=1).max() for mine in found]
        assert min(apart) < 1e-6


def test_a_robot_with_meshes_is_written_as_json_and_plans_as_without(folder):
    path = written(folder)
    robot = RobotSpec.from_urdf(path, locked_angle=0.8, capsules="ur5e")
    assert len(robot.visuals) == 7
    assert RobotSpec.from_dict(robot.to_dict()) == robot
    bare = RobotSpec.from_urdf(written(folder, links=()), locked_angle=0.8, capsules="ur5e")
    assert bare.visuals is None
    assert bare.fingerprint == robot.fingerprint
    assert not limb_meshes(bare, 0)


@pytest.mark.parametrize("file", ["package://arms/meshes/none.stl", "meshes/link.dae"])
def test_a_mesh_that_is_missing_is_one_warning_and_its_link_has_capsules(folder, file):
    (folder / "meshes" / "link.dae").write_text("<COLLADA/>")
    robot = RobotSpec.from_urdf(written(folder, file), locked_angle=0.8, capsules="ur5e")
    told = "7 of 7 visual meshes are not found or not STL or OBJ, the first is"
    with pytest.warns(UserWarning, match=told) as caught:
        assert limb_meshes(robot, 0) == ()
    assert len(caught) == 1


def test_meshes_of_mjcf_are_those_of_the_urdf(folder):
    path = written(folder)
    text = path.read_text().replace("package://arms", str(folder))
    spec = mujoco.MjSpec.from_string(text.replace("</robot>", EXTRA + "</robot>"))
    spec.compile()
    other = folder / "arm.xml"
    other.write_text(spec.to_xml())
    options = {"locked_angle": 0.8, "capsules": "ur5e", "speed_limits": 2.0, "torque_limits": 50.0}
    first = RobotSpec.from_urdf(path, **options)
    second = RobotSpec.from_mjcf(other, tool_frame="tool0", **options)
    assert len(second.visuals) == 7
    for a, b in zip(first.visuals, second.visuals, strict=True):
        assert a.link == b.link
        np.testing.assert_allclose(a.position, b.position, atol=1e-5)  # six digits in the text
        np.testing.assert_allclose(a.quaternion, b.quaternion, atol=1e-5)
        np.testing.assert_allclose(a.scale, b.scale)
        assert a.file == b.file
