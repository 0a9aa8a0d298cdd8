"""The robot that figures draw is the one of the scene, and hangs together."""

from itertools import pairwise

import numpy as np
import pytest

from mlivr_gym.pictures.robot_shapes import (
    JOINT_RADIUS,
    capsule_faces,
    outline,
    robot_parts,
)
from mlivr_gym.robot.specification import robot_spec


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


@pytest.mark.parametrize("length", [0.0, 0.3])
def test_the_faces_of_a_capsule_lie_on_it_all_round(length):
    ends = np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.3]])
    ends[1] += length * np.array([2.0, -1.0, 2.0]) / 3.0
    places = capsule_faces(ends, 0.05, 40).reshape(-1, 3)
    np.testing.assert_allclose(axis_distances(places, ends), 0.05, atol=1e-12)
    along = np.array([2.0, -1.0, 2.0]) / 3.0
    assert np.ptp(places @ along) == pytest.approx(length + 0.1, abs=1e-3)


def test_the_outline_of_a_capsule_has_its_area():
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.4, 0.0]])
    edge = outline(capsule_faces(ends, 0.06, 96), np.eye(3)[[0, 1]])
    x, y = edge.T
    area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    assert area == pytest.approx(np.pi * 0.06**2 + 0.12 * 0.4, rel=2e-3)


@pytest.mark.parametrize("name", ["mlivr2", "mlivr3"])
def test_parts_are_where_mujoco_has_the_shapes_of_their_names(ladder, name):
    import mujoco

    from mlivr_gym.simulation.scene import compile_spec, scene_spec, set_configuration

    robot = robot_spec(name)
    model = compile_spec(scene_spec(ladder, robot))
    data = mujoco.MjData(model)
    for configuration in configurations(robot.limbs):
        set_configuration(model, data, *configuration)
        parts = {part.name: part for part in robot_parts(robot, configuration)}
        named = {model.geom(k).name for k in range(model.ngeom)}
        shapes = {n for n in named if n == "body" or n.startswith("limb")}
        assert shapes == {n for n in parts if "/joint/" not in n}
        for shape in shapes - {"body"}:
            geom = data.geom(shape)
            half = float(model.geom(shape).size[1]) * geom.xmat.reshape(3, 3)[:, 2]
            ends = np.stack([geom.xpos - half, geom.xpos + half])
            np.testing.assert_allclose(axis_distances(parts[shape].axes[0], ends), 0.0, atol=1e-8)
            assert parts[shape].radius == pytest.approx(float(model.geom(shape).size[0]))
        corners = parts["body"].faces.reshape(-1, 3) - data.geom("body").xpos
        seen = np.abs(corners @ data.geom("body").xmat.reshape(3, 3))
        np.testing.assert_allclose(seen, 0.5 * robot.body_size, atol=1e-9)


def test_a_limb_hangs_together_from_the_body_to_the_gripper():
    """Each part touches the one before: without the rods for the joints, links float apart."""
    robot = robot_spec("mlivr2")
    for configuration in configurations(2, 20):
        parts = {part.name: part for part in robot_parts(robot, configuration)}
        for limb in range(2):
            links = [n for n in parts if n.startswith(f"limb{limb}/") and "/base/" not in n]
            rods = [n for n in links if "/joint/" in n]
            links = [n for n in links if "/joint/" not in n]
            assert len(rods) == len(links)
            for rod, (before, after) in zip(rods[1:], pairwise(links), strict=True):
                ends = parts[rod].axes[0]
                assert axis_distances(ends[:1], parts[before].axes[0])[0] < 0.01
                assert axis_distances(ends[1:], parts[after].axes[0])[0] < 0.01
                assert parts[rod].radius == JOINT_RADIUS
            root = parts[rods[0]].axes[0]
            assert np.linalg.norm(root[0] - configuration[0]) <= robot.mount_radius + 1e-9
            assert axis_distances(root[1:], parts[links[0]].axes[0])[0] < 0.01
