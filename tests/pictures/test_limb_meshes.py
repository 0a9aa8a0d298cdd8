"""Visual meshes lie where the maker's lengths have the links, and take no part in physics."""

import mujoco
import numpy as np
import pytest

from mlivr_gym import robot_spec
from mlivr_gym.pictures.limb_meshes import limb_meshes
from mlivr_gym.pictures.studio import studio_spec
from mlivr_gym.robot.capsules import LINKS

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
