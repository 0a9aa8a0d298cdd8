"""The plain definition of contacts, compared with MuJoCo and Coal."""

import mujoco
import numpy as np
import pytest
from coal_ruler import Ruler, behind
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, robot_spec
from mlivr_gym.collisions.contacts import capsule_ends, contacts
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.simulation.scene import scene_spec, set_configuration

ROBOT = robot_spec("mlivr2")


SHAPES = LimbShapes(ROBOT)


def test_capsules_lie_where_mujoco_has_them(jem):
    model = scene_spec(jem, ROBOT).compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(5):
        turn = Rotation.random(None, rng).as_quat(scalar_first=True)
        here = (
            rng.uniform(-1, 1, 3),
            turn if turn[0] > 0 else -turn,
            rng.uniform(-np.pi, np.pi, (2, 6)),
        )
        set_configuration(model, data, *here)
        ends = capsule_ends(ROBOT, SHAPES, here)
        for i in range(2):
            for c, name in enumerate(SHAPES.names):
                geom = model.geom(f"limb{i}/{name}/0").id
                axis = data.geom_xmat[geom].reshape(3, 3)[:, 2] * model.geom_size[geom, 1]
                found = np.stack([data.geom_xpos[geom] - axis, data.geom_xpos[geom] + axis])
                order = np.argsort(np.linalg.norm(found - ends[i, c, 0], axis=1))
                np.testing.assert_allclose(found[order], ends[i, c], atol=1e-7)
                assert model.geom_size[geom, 0] == pytest.approx(SHAPES.radii[c])


def test_the_plain_definition_measures_what_coal_measures():
    """All pairs of shapes closer than 0.3 m are found, a rotated box among them, and no others."""
    rng, ruler = np.random.default_rng(6), Ruler(ROBOT)
    met = set()
    for _ in range(40):
        turn = Rotation.random(None, rng).as_quat(scalar_first=True)
        here = (rng.uniform(-1.0, 1.0, 3), turn, rng.uniform(-3.0, 3.0, (2, 6)))
        axes = Rotation.random(None, rng).as_matrix()
        half = tuple(rng.uniform(0.01, 0.3, 3))
        middle = tuple(here[0] + rng.normal(0.0, 0.25, 3))
        box = Box("box", "obstacle", middle, half, Box.rows(axes))
        found = contacts(ROBOT, (box,), here, 0.3)
        ours = {frozenset((c.first, c.second.removeprefix("box/"))): c.distance for c in found}
        theirs = ruler.among([box]).measured(here, below=0.3)
        assert {frozenset(pair) for _, *pair in theirs} == set(ours)
        for gap, *pair in theirs:
            if gap > 1e-6:
                assert ours[frozenset(pair)] == pytest.approx(gap, abs=1e-6)
                met |= {name for name in pair if "box" in pair}
            else:
                assert ours[frozenset(pair)] <= 1e-6
    assert {"body", "limb0/base/0", "limb1/forearm/0"} <= met


def test_at_a_grasp_a_gripper_may_come_close_to_what_coal_leaves_out_too():
    """The farthest corner of rotated boxes at the gripper protrudes a little, or not."""
    rng, ruler, left_out = np.random.default_rng(7), Ruler(ROBOT), 0
    for k in range(60):
        turn = Rotation.random(None, rng).as_quat(scalar_first=True)
        here = (rng.uniform(-1.0, 1.0, 3), turn, rng.uniform(-3.0, 3.0, (2, 6)))
        place = capsule_ends(ROBOT, SHAPES, here)[0, -1].mean(axis=0)
        normal, axes = (Rotation.random(None, rng).as_matrix() for _ in range(2))
        box = Box("box", "obstacle", tuple(place), tuple(rng.uniform(0.01, 0.2, 3)), Box.rows(axes))
        highest = np.abs(normal[0] @ axes) @ box.half
        grasp = 0, place + (highest + (-0.001, -0.003)[k % 2]) * normal[0], normal[0]
        left_out += behind(box, *grasp[1:])
        found = contacts(ROBOT, (box,), here, 0.05, [grasp])
        theirs = ruler.among([box]).measured(here, [grasp], below=0.05)
        ours = {frozenset((c.first, c.second.removeprefix("box/"))) for c in found}
        assert ours == {frozenset(pair) for _, *pair in theirs}
    assert left_out == 30
