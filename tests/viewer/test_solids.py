"""The scene as triangles, compared with the MuJoCo model that it is made from."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.simulation.scene import compile_spec, scene_spec, set_configuration

pytest.importorskip("trimesh", reason="the extra 'viewer' is not installed")

from mlivr_gym.viewer.solids import scene_solids


@pytest.mark.parametrize("name", ["mlivr2", "mlivr4"])
def test_links_are_where_the_whole_scene_has_them(jem, name):
    robot, rng = robot_spec(name), np.random.default_rng(0)
    scene, model = scene_solids(jem, robot), compile_spec(scene_spec(jem, robot))
    data = mujoco.MjData(model)
    for _ in range(5):
        quaternion = rng.normal(size=4)
        quaternion /= np.linalg.norm(quaternion)
        shown = rng.normal(size=3), quaternion, rng.uniform(-3, 3, (robot.limbs, 6))
        set_configuration(model, data, *shown)
        poses = scene.link_poses(shown)
        assert len(poses) == model.nbody - 1
        for k in range(1, model.nbody):
            place, turn = poses[model.body(k).name]
            np.testing.assert_allclose(place, data.xpos[k], atol=1e-9)
            rotation = Rotation.from_quat(turn, scalar_first=True).as_matrix()
            np.testing.assert_allclose(rotation.ravel(), data.xmat[k], atol=1e-9)


def test_every_geom_is_drawn_in_its_colour_and_size(jem):
    """Bounds of all shapes of a link and colour are those of MuJoCo's geoms."""
    robot = robot_spec("mlivr2")
    scene = scene_solids(jem, robot, capsules=True)
    model = compile_spec(scene_spec(jem, robot))
    solids = (*scene.robot, *scene.surroundings)
    rounded = {(s.link, tuple(np.float32(s.colour).tolist())): [] for s in solids}
    for s in solids:
        rounded[s.link, tuple(np.float32(s.colour).tolist())].append(s.mesh.vertices)
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


def test_what_is_not_checked_is_told_apart(jem):
    scene = scene_solids(jem, robot_spec("mlivr2"), capsules=True)
    unchecked = [solid for solid in scene.robot if not solid.checked]
    assert {solid.link for solid in unchecked} >= {"base", "limb0/upper_arm", "limb1/forearm"}
    assert all(solid.checked for solid in scene.robot if solid.link.endswith("gripper"))


def test_meshes_are_drawn_in_the_place_of_collision_shapes(jem):
    """Of a UR10e no meshes ship, so limb 0 keeps its capsules and rods."""
    for name, limbs in (("mlivr2", {"limb0", "limb1"}), ("mlivr2-unequal", {"limb1"})):
        scene = scene_solids(jem, robot_spec(name))
        covered = {solid.link for solid in scene.robot if solid.covered}
        assert {link.split("/")[0] for link in covered} == limbs
        for limb in limbs:
            assert {f"{limb}/shoulder", f"{limb}/forearm", f"{limb}/wrist_3"} <= covered
            assert f"{limb}/gripper" not in covered
        for link in covered:
            own = [solid for solid in scene.robot if solid.link == link]
            assert any(not solid.checked for solid in own)
            assert all(solid.covered == solid.checked for solid in own)
