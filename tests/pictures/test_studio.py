"""The photographed scene is the simulated one with lamps and, round a module, a hull."""

import mujoco
import numpy as np

from mlivr_gym import robot_spec
from mlivr_gym.pictures.studio import studio_spec
from mlivr_gym.simulation.scene import scene_spec


def test_physics_are_those_of_the_scene(jem):
    """Masses, joints, shapes that meet and their names; a step goes the same way."""
    robot = robot_spec("mlivr2")
    plain, lit = (make(jem, robot).compile() for make in (scene_spec, studio_spec))
    hull = [lit.geom(k).name for k in range(lit.ngeom) if lit.geom(k).name.startswith("studio/")]
    assert len(hull) == 6
    assert all(lit.geom(name).contype == lit.geom(name).conaffinity == 0 for name in hull)
    meshes = [k for k in range(lit.ngeom) if lit.geom_type[k] == mujoco.mjtGeom.mjGEOM_MESH]
    assert meshes
    assert not lit.geom_contype[meshes].any()
    assert not lit.geom_conaffinity[meshes].any()
    assert lit.ngeom == plain.ngeom + 6 + len(meshes)
    assert lit.body_mass.sum() == plain.body_mass.sum()
    ended = []
    for model in (plain, lit):
        data = mujoco.MjData(model)
        data.qpos[0], data.qvel[:] = 4.0, 0.3
        for _ in range(50):
            mujoco.mj_step(model, data)
        ended.append(data.qpos.copy())
    np.testing.assert_array_equal(*ended)
