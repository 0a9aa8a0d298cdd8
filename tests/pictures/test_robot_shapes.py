"""The robot that figures draw is the one of the scene, and hangs together."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest

from mlivr_gym.pictures.limb_meshes import JOINT_RADIUS
from mlivr_gym.pictures.robot_shapes import geom_corners, outline, robot_parts
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.simulation.scene import compile_spec, scene_spec, set_configuration


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
