import itertools
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mlivr_gym import Box, GraspMap, Limb, Settings, robot_spec, stance_graph
from mlivr_gym.errors import RenderError, SceneError, ShapeError
from mlivr_gym.pictures.rendering import SceneRenderer, SceneWindow
from mlivr_gym.simulation.dynamics import dynamics_spec
from mlivr_gym.simulation.scene import compile_spec, scene_spec


@pytest.fixture(scope="module")
def model(jem):
    return scene_spec(jem, robot_spec("mlivr2")).compile()


def test_scene_holds_tracks_handrails_points_and_robot(jem, model):
    assert all(model.site(f"point/{point}") is not None for point in jem.ids)
    boxes = model.geom_type == mujoco.mjtGeom.mjGEOM_BOX
    tracks = (
        boxes
        & np.isclose(model.geom_size[:, 0], 0.8763, atol=1e-4)
        & np.isclose(model.geom_size[:, 1], 0.0128)
    )
    assert tracks.sum() == 46
    rails = boxes & (np.abs(model.geom_rgba - (0.10, 0.35, 0.75, 1)).max(axis=1) < 1e-6)
    assert rails.sum() == 18
    assert model.nv == 6 + 12
    assert (model.opt.gravity == 0.0).all()


@pytest.mark.parametrize("make_spec", [scene_spec, dynamics_spec])
def test_joint_limits_are_the_robots_in_radians_also_after_export(jem, make_spec):
    limits = ((-6.2, 6.2), (-3.1, 0.5), (-2.8, 2.8), (-1, 3), (0.1, 3.1), (-9, 9))
    robot = replace(robot_spec("mlivr2"), limb=Limb(joint_limits=limits))
    spec = make_spec(jem, robot)
    model = spec.compile()
    for found in (model, mujoco.MjModel.from_xml_string(spec.to_xml())):
        for limb, k in itertools.product(range(2), range(6)):
            joint = found.joint(f"limb{limb}/joint{k + 1}")
            np.testing.assert_allclose(joint.range, limits[k], atol=1e-4)
            assert found.jnt_limited[joint.id] == (make_spec is scene_spec)


NAMES = (
    "body",
    "base",
    "limb0",
    "limb0/flange",
    "limb0/gripper/0",
    "limb0/anchor",
    "world",
    "sky",
    "R0",
    "P",
    'a<b>&"c',
)


def named_map():
    """A map whose points and boxes are called like parts of the scene, and like each other."""
    return GraspMap.from_dict(
        {
            "name": 'a "map" <with> marks & more',
            "points": [
                {
                    "id": name,
                    "face": "deck",
                    "position": [0.3 * k, 0, 0],
                    "normal": [0, 0, 1],
                    "rail": [0, 1, 0],
                }
                for k, name in enumerate(NAMES)
            ],
            "boxes": [
                {"id": name, "min": [k, 5, 0], "max": [k + 1, 6, 1]} for k, name in enumerate(NAMES)
            ],
        }
    )


def test_no_name_of_a_map_collides_with_one_of_the_scene():
    spec = dynamics_spec(named_map(), robot_spec("mlivr2"))
    model = spec.compile()
    for k, name in enumerate(NAMES):
        np.testing.assert_allclose(model.site(f"point/{name}").pos, [0.3 * k, 0, 0])
        np.testing.assert_allclose(model.geom(f"box/{name}").pos, [k + 0.5, 5.5, 0.5])
    # The robot's own shapes keep theirs.
    assert model.geom("body").bodyid[0] == model.body("base").id
    assert model.site("limb0/flange").bodyid[0] == model.body("limb0/wrist_3").id
    again = mujoco.MjModel.from_xml_string(spec.to_xml())
    assert again.ngeom == model.ngeom
    assert again.site('point/a<b>&"c').id == model.site('point/a<b>&"c').id


def test_a_box_that_is_there_twice_is_named(ladder):
    box = Box.between("R0", "obstacle", (5, 5, 5), (6, 6, 6))
    with pytest.raises(ShapeError, match="box 'R0' appears more than once"):
        scene_spec(ladder, robot_spec("mlivr2"), [box])
    graph = stance_graph(ladder, settings=Settings(limb_threshold=0.05))
    with pytest.raises(ShapeError, match="a box 'R0' already exists"):
        graph.add_obstacles([box])


def test_what_mujoco_refuses_is_told_as_that_and_not_as_missing_gl(ladder, monkeypatch):
    def refused(*_):
        spec = scene_spec(ladder, robot_spec("mlivr2"))
        spec.worldbody.add_geom(name="nothing", size=[0, 0, 0])
        return spec

    with pytest.raises(SceneError, match=r"MuJoCo cannot build scene 'ladder-mlivr2': .*size"):
        compile_spec(refused())
    for module in ("pictures.studio", "simulation.scene"):  # the first imports the second
        monkeypatch.setattr(f"mlivr_gym.{module}.scene_spec", refused)
    with pytest.raises(SceneError, match="cannot build scene"):
        SceneRenderer(ladder, robot_spec("mlivr2"))
    monkeypatch.setenv("DISPLAY", ":0")
    with pytest.raises(SceneError, match="cannot build scene"):
        SceneWindow(ladder, robot_spec("mlivr2"))


def test_a_window_without_a_screen_is_one_clear_error(jem, graph, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RenderError, match="needs a screen"):
        SceneWindow(jem, graph.robot)
