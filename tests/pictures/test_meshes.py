"""Meshes and shapes of the robot are where its maker, its file and MuJoCo have them."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from robot_texts import IIWA14, one_arm

from mlivr_gym import RobotSpec, robot_spec
from mlivr_gym.pictures.limb_meshes import JOINT_RADIUS, limb_meshes, show_limbs
from mlivr_gym.pictures.robot_shapes import geom_corners, outline, robot_parts
from mlivr_gym.pictures.studio import studio_spec
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.simulation.scene import compile_spec, robot_alone, scene_spec, set_configuration

LENGTHS = {"mlivr2": (-0.425, -0.3922), "mlivr2-ur3e": (-0.24355, -0.2132)}
"""Lengths a2 and a3 of the maker's DH table [m]."""

WIDEST = {"mlivr2": 0.0755, "mlivr2-ur3e": 0.0645}
"""Radius of the widest part, the base [m]: half the footprints of 149 and 128 mm, rounded up."""


@pytest.mark.parametrize("name", WIDEST)
def test_links_reach_from_joint_to_joint(name):
    """From the base plate to the flange, along the lengths of the maker's DH table."""
    widest = WIDEST[name]
    meshes = limb_meshes(robot_spec(name), 0)
    assert {mesh.link for mesh in meshes} == set(LINKS[:-1])
    low, high = {}, {}
    for mesh in meshes:
        vertices, faces = mesh.shape["uservert"].reshape(-1, 3), mesh.shape["userface"]
        assert faces.min() >= 0
        assert faces.max() < len(vertices)
        bounds = vertices.min(axis=0), vertices.max(axis=0)
        low[mesh.link] = np.minimum(bounds[0], low.get(mesh.link, np.inf))
        high[mesh.link] = np.maximum(bounds[1], high.get(mesh.link, -np.inf))
    assert low["base"][2] == pytest.approx(0.0, abs=2e-3)
    assert high["wrist_3"][2] == pytest.approx(0.0, abs=2e-3)
    for link, length in zip(("upper_arm", "forearm"), LENGTHS[name], strict=True):
        assert length - widest < low[link][0] < length
        assert 0.0 < high[link][0] < widest
    for link in ("shoulder", "wrist_1", "wrist_2", "wrist_3"):  # about their joint
        assert (np.maximum(-low[link], high[link]) < widest + 2e-3).all()
    for link in LINKS[:-1]:
        assert -widest - 1e-3 < low[link][1] < 0.0 < high[link][1] < widest + 2e-3


def test_capsules_may_be_drawn_in_their_place(ladder):
    """Also where no meshes ship; a capsule that is covered is not seen."""
    for name, count in (("mlivr2", 2), ("mlivr2-unequal", 1), ("mlivr2-ur10e", 0)):
        robot = robot_spec(name)
        for capsules in (False, True):
            model = studio_spec(ladder, robot, capsules=capsules).compile()
            shown = {
                model.geom(k).name.split("/mesh/")[0]
                for k in range(model.ngeom)
                if model.geom_type[k] == mujoco.mjtGeom.mjGEOM_MESH
            }
            assert len(shown) == (0 if capsules else count)
            seen = [model.geom(f"limb{i}/forearm/0").rgba[3] for i in range(2)]
            assert sum(seen) == 2 - len(shown)
            assert all(model.geom(f"limb{i}/gripper/0").rgba[3] == 1.0 for i in range(2))


SEEN = """<visual><origin xyz="0.02 -0.01 0.03" rpy="0.3 -0.2 1.1"/><geometry>
<mesh filename="{file}" scale="0.5 0.5 0.25"/></geometry><material name="red"/></visual>"""
EXTRA = '<mujoco><compiler strippath="false" discardvisual="false" fusestatic="false"/></mujoco>'
RED = '<material name="red"><color rgba="1 0 0 1"/></material>'


@pytest.fixture
def folder(tmp_path):
    """A package with a tetrahedron as a mesh."""
    trimesh = pytest.importorskip("trimesh")
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


def configurations(limbs, count=4):
    rng = np.random.default_rng(5)
    for _ in range(count):
        turn = rng.normal(size=4)
        yield (
            rng.uniform(-1.0, 1.0, 3),
            turn / np.linalg.norm(turn),
            rng.uniform(-3.0, 3.0, (limbs, 6)),
        )


def axis_distances(places, ends):
    along = ends[1] - ends[0]
    size = max(float(along @ along), 1e-300)
    share = np.clip((places - ends[0]) @ along / size, 0.0, 1.0)
    return np.linalg.norm(places - ends[0] - share[:, None] * along, axis=1)


def corners_of(shape, size):
    text = f'<mujoco><worldbody><geom type="{shape}" size="{size}"/></worldbody></mujoco>'
    return geom_corners(mujoco.MjModel.from_xml_string(text), 0)


@pytest.mark.parametrize(
    ("shape", "size", "area"),
    [
        ("capsule", "0.06 0.2", np.pi * 0.06**2 + 0.12 * 0.4),
        ("cylinder", "0.06 0.2", 0.12 * 0.4),
        ("box", "0.1 0.2 0.3", 0.2 * 0.6),
    ],
)
def test_the_outline_of_a_shape_has_its_area(shape, size, area):
    x, y = outline(corners_of(shape, size), np.eye(3)[[0, 2]]).T
    found = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    assert found == pytest.approx(area, rel=0.03)


@pytest.mark.parametrize("name", ["mlivr2", "mlivr3"])
def test_parts_are_where_mujoco_has_the_shapes_and_rods_join_them(ladder, name):
    """Corners lie on the capsules of MuJoCo; a rod comes as near to the axes of both its links."""
    robot = robot_spec(name)
    model = compile_spec(scene_spec(ladder, robot))
    data = mujoco.MjData(model)
    for configuration in configurations(robot.limbs):
        set_configuration(model, data, *configuration)
        parts = {p.name: p.corners for p in robot_parts(robot, configuration)}
        named = {model.geom(k).name for k in range(model.ngeom)}
        shapes = {n for n in named if n == "body" or n.startswith("limb")}
        assert shapes == {n for n in parts if n and "/joint/" not in n}
        axes = {}
        for shape in shapes - {"body"}:
            geom, (radius, half, _) = data.geom(shape), model.geom(shape).size
            along = half * geom.xmat.reshape(3, 3)[:, 2]
            axes[shape] = np.stack([geom.xpos - along, geom.xpos + along])
            np.testing.assert_allclose(axis_distances(parts[shape], axes[shape]), radius, atol=1e-6)
        corners = parts["body"] - data.geom("body").xpos
        seen = np.abs(corners @ data.geom("body").xmat.reshape(3, 3))
        np.testing.assert_allclose(seen, np.tile(0.5 * robot.body_edges, (8, 1)), atol=1e-9)
        for limb in range(robot.limbs):
            joints = np.array([data.joint(f"limb{limb}/joint{j}").xanchor for j in range(1, 7)])
            rods = [corners for n, corners in parts.items() if n.startswith(f"limb{limb}/joint/")]
            links = [n for n in axes if n.startswith(f"limb{limb}/")]
            for joint, pair in zip(joints, pairwise(LINKS[:-1]), strict=True):
                for link in pair:
                    of_link = [axes[n] for n in links if n.split("/")[1] == link]
                    apart = min(axis_distances(joint[None], one)[0] for one in of_link)
                    meets = [
                        np.linalg.norm(rod - joint, axis=1).min() < JOINT_RADIUS + 1e-6
                        and min(axis_distances(rod, one).min() for one in of_link)
                        < JOINT_RADIUS + 0.01
                        for rod in rods
                    ]
                    assert apart <= JOINT_RADIUS + 1e-6 or any(meets)
